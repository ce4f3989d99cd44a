// SPDX-License-Identifier: Apache-2.0
#include "host/config/yaml_cursor.h"

#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/parser.h>

#include <algorithm>
#include <charconv>
#include <set>
#include <sstream>

#include "host/config/nearest_word.h"

namespace urgengo::config {
namespace {

constexpr std::size_t kMostDocuments = 100;

std::string joined(const std::vector<std::string>& words) {
    std::string list;
    for (const std::string& word : words) list += (list.empty() ? "" : ", ") + word;
    return list;
}

std::string shown(const YAML::Node& node) {
    if (node.IsMap()) return "a map";
    if (node.IsSequence()) return "a list";
    if (node.IsScalar()) return "'" + node.Scalar() + "'";
    return "nothing";
}

std::string shown(double number) {
    char digits[32];
    return std::string(digits, std::to_chars(digits, digits + sizeof digits, number).ptr);
}

/// The whole text as a number, '.' as decimal point in every locale.
template <typename T>
std::optional<T> parse_number(const std::string& text) {
    T value{};
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, value);
    if (error != std::errc{} || stop != end) return std::nullopt;
    return value;
}

/// Nodes made by the parser know their line; others have none and take their parent's.
int line_of(const YAML::Node& node, int otherwise) {
    return node.Mark().is_null() ? otherwise : node.Mark().line + 1;
}

/// Takes a document and keeps nothing of it.
class Passed : public YAML::EventHandler {
  public:
    void OnDocumentStart(const YAML::Mark&) override {}
    void OnDocumentEnd() override {}
    void OnNull(const YAML::Mark&, YAML::anchor_t) override {}
    void OnAlias(const YAML::Mark&, YAML::anchor_t) override {}
    void OnScalar(const YAML::Mark&, const std::string&, YAML::anchor_t,
                  const std::string&) override {}
    void OnSequenceStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                         YAML::EmitterStyle::value) override {}
    void OnSequenceEnd() override {}
    void OnMapStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                    YAML::EmitterStyle::value) override {}
    void OnMapEnd() override {}
};

/// @returns how many documents there are, kMostDocuments at most: of some texts (",") yaml-cpp
/// makes
///          documents for ever, and YAML::LoadAll() keeps them
std::size_t count_documents(const std::string& text) {
    std::istringstream stream(text);
    YAML::Parser parser(stream);
    Passed passed;
    std::size_t count = 0;
    while (count < kMostDocuments && parser.HandleNextDocument(passed)) ++count;
    return count;
}

}  // namespace

Result<YAML::Node> parse_yaml(const std::string& text, const std::string& file) {
    try {
        const std::size_t documents = count_documents(text);
        if (documents == 1) return YAML::Load(text);
        return Error{file + ": found " + (documents == kMostDocuments ? "at least " : "") +
                     std::to_string(documents) + " YAML documents, accepted: one"};
    } catch (const YAML::Exception& e) {
        const std::string where = e.mark.is_null() ? ""
                                                   : ":" + std::to_string(e.mark.line + 1) + ":" +
                                                         std::to_string(e.mark.column + 1);
        return Error{file + where + ": not valid YAML: " + e.msg};
    }
}

YamlCursor::YamlCursor(const YAML::Node& root, YamlFault& fault)
    : YamlCursor(root, &fault, "", line_of(root, 1)) {}

YamlCursor::YamlCursor(YAML::Node node, YamlFault* fault, std::string path, int line)
    : node_(std::move(node)), fault_(fault), path_(std::move(path)), line_(line) {}

std::string YamlCursor::child_path(const std::string& key) const {
    return path_.empty() ? key : path_ + "." + key;
}

void YamlCursor::accept_keys(const std::vector<std::string>& keys) const {
    if (!node_.IsDefined()) return;
    if (!node_.IsMap()) return fail("a map with " + joined(keys));
    std::set<std::string> seen;
    for (const auto& entry : node_) {
        const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : shown(entry.first);
        const YamlCursor value(entry.second, fault_, child_path(key), line_of(entry.first, line_));
        if (std::find(keys.begin(), keys.end(), key) == keys.end()) {
            const std::string nearest = nearest_word(key, keys);
            value.complain("unknown key, accepted: " + joined(keys) +
                           (nearest.empty() ? "" : " (did you mean '" + nearest + "'?)"));
        }
        if (!seen.insert(key).second) value.complain("the key is there twice, accepted: once");
    }
}

YamlCursor YamlCursor::at(const std::string& key) const {
    if (auto value = find(key)) return *value;
    const YamlCursor missing(YAML::Node(YAML::NodeType::Undefined), fault_, child_path(key), line_);
    missing.complain("missing, and required");
    return missing;
}

std::optional<YamlCursor> YamlCursor::find(const std::string& key) const {
    if (!node_.IsDefined() || !node_.IsMap()) return std::nullopt;
    // Not node_[key]: the key's own mark is the line that the user looks for.
    for (const auto& entry : node_) {
        if (!entry.first.IsScalar() || entry.first.Scalar() != key) continue;
        return YamlCursor(entry.second, fault_, child_path(key), line_of(entry.first, line_));
    }
    return std::nullopt;
}

std::vector<YamlCursor> YamlCursor::items(const std::string& accepted) const {
    std::vector<YamlCursor> cursors;
    if (!node_.IsDefined() || !node_.IsSequence()) {
        fail(accepted);
        return cursors;
    }
    for (const auto& element : node_) {
        const std::string path = path_ + "[" + std::to_string(cursors.size()) + "]";
        cursors.push_back(YamlCursor(element, fault_, path, line_of(element, line_)));
    }
    return cursors;
}

std::string YamlCursor::text(const std::string& accepted) const {
    if (node_.IsDefined() && node_.IsScalar()) return node_.Scalar();
    fail(accepted);
    return {};
}

double YamlCursor::positive_number(double max, const std::string& note) const {
    const std::string accepted = "a number > 0" + note;
    const auto value = parse_number<double>(text(accepted));
    if (!value || !(*value > 0)) {
        fail(accepted);
        return max;
    }
    if (*value > max) {
        fail("a number > 0 and at most " + shown(max) + note);
        return max;
    }
    return *value;
}

double YamlCursor::number(double min, double max) const {
    const std::string accepted = "a number from " + shown(min) + " to " + shown(max);
    const auto value = parse_number<double>(text(accepted));
    if (value && *value >= min && *value <= max) return *value;
    fail(accepted);
    return min;
}

std::int64_t YamlCursor::integer(std::int64_t min, std::int64_t max,
                                 const std::string& note) const {
    const std::string accepted =
        "a whole number from " + std::to_string(min) + " to " + std::to_string(max) + note;
    const auto value = parse_number<std::int64_t>(text(accepted));
    if (value && *value >= min && *value <= max) return *value;
    fail(accepted);
    return min;
}

bool YamlCursor::on_off() const {
    const std::string accepted = "on, off, true, false";
    const std::string word = text(accepted);
    if (word == "on" || word == "true") return true;
    if (word != "off" && word != "false") fail(accepted);
    return false;
}

void YamlCursor::fail(const std::string& accepted) const {
    if (!node_.IsDefined()) return;
    complain("found " + shown(node_) + ", accepted: " + accepted);
}

void YamlCursor::complain(const std::string& complaint) const {
    if (!fault_->message.empty()) return;
    const std::string path = path_.empty() ? "" : path_ + ": ";
    fault_->message = fault_->file + ":" + std::to_string(line_) + ": " + path + complaint;
}

}  // namespace urgengo::config
