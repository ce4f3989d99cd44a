// SPDX-License-Identifier: Apache-2.0
#include "host/config/json_cursor.h"

#include <locale.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "host/config/hex.h"

namespace urgengo::config {
namespace {

using Json = nlohmann::json;

/// nlohmann-json reads numbers with strtod, which obeys the locale of the program that we are
/// loaded into. Changes the calling thread's locale only.
class ScopedCLocale {
  public:
    ScopedCLocale() : c_locale_(newlocale(LC_ALL_MASK, "C", nullptr)) {
        if (c_locale_) previous_ = uselocale(c_locale_);
    }
    ScopedCLocale(const ScopedCLocale&) = delete;
    ScopedCLocale& operator=(const ScopedCLocale&) = delete;
    ~ScopedCLocale() {
        if (!c_locale_) return;
        uselocale(previous_);
        freelocale(c_locale_);
    }

  private:
    locale_t c_locale_;
    locale_t previous_ = nullptr;
};

std::string position(std::string_view text, std::size_t byte) {
    const std::string_view before = text.substr(0, std::min(byte > 0 ? byte - 1 : 0, text.size()));
    const auto line = 1 + std::count(before.begin(), before.end(), '\n');
    const std::size_t line_start = before.rfind('\n') + 1;  // npos + 1 is 0: the first line
    return std::to_string(line) + ":" + std::to_string(before.size() - line_start + 1);
}

/// nlohmann's message without its prefix "[json.exception...] parse error at line 1, column 2: ".
std::string syntax_complaint(const std::string& what) {
    const std::size_t start = what.find(": ");
    return start == std::string::npos ? what : what.substr(start + 2);
}

std::string shown(const Json& value) {
    if (value.is_object()) return "an object";
    if (value.is_array()) return "an array";
    return "'" + value.dump(-1, ' ', false, Json::error_handler_t::replace) + "'";
}

template <typename T>
std::string range_text(const char* what, T min, T max) {
    return std::string(what) + " from " + Json(min).dump() + " to " + Json(max).dump();
}

}  // namespace

Result<Json> parse_json(std::string_view text, const std::string& file) {
    const ScopedCLocale c_locale;
    try {
        return Json::parse(text);
    } catch (const Json::parse_error& e) {
        return Error{file + ":" + position(text, e.byte) +
                     ": not valid JSON: " + syntax_complaint(e.what())};
    } catch (const Json::exception& e) {  // a number out of range
        return Error{file + ": not valid JSON: " + e.what()};
    }
}

JsonCursor::JsonCursor(const Json& root, JsonFault& fault) : JsonCursor(&root, &fault, "$") {}

JsonCursor::JsonCursor(const Json* value, JsonFault* fault, std::string path)
    : value_(value), fault_(fault), path_(std::move(path)) {}

JsonCursor JsonCursor::at(std::string_view key) const {
    if (auto member = find(key)) return *member;
    const JsonCursor missing(nullptr, fault_, path_ + "." + std::string(key));
    if (fault_->message.empty()) {
        fault_->message = fault_->file + ": " + missing.path_ + ": missing, and required";
    }
    return missing;
}

std::optional<JsonCursor> JsonCursor::find(std::string_view key) const {
    if (!value_) return std::nullopt;
    if (!value_->is_object()) {
        fail("an object");
        return std::nullopt;
    }
    const auto member = value_->find(key);
    if (member == value_->end()) return std::nullopt;
    return JsonCursor(&*member, fault_, path_ + "." + std::string(key));
}

std::vector<JsonCursor> JsonCursor::items() const {
    std::vector<JsonCursor> cursors;
    if (!value_) return cursors;
    if (!value_->is_array()) {
        fail("an array");
        return cursors;
    }
    cursors.reserve(value_->size());
    for (const Json& element : *value_) {
        cursors.push_back({&element, fault_, path_ + "[" + std::to_string(cursors.size()) + "]"});
    }
    return cursors;
}

std::string JsonCursor::text() const {
    if (value_ && value_->is_string()) return value_->get<std::string>();
    fail("a string");
    return {};
}

std::string JsonCursor::name() const {
    std::string name = text();
    if (name.empty()) fail("a string that is not empty");
    return name;
}

std::int64_t JsonCursor::integer(std::int64_t min, std::int64_t max) const {
    // An unsigned value above INT64_MAX would wrap in get<int64_t>().
    const bool fits = value_ && value_->is_number_integer() &&
                      (!value_->is_number_unsigned() ||
                       value_->get<std::uint64_t>() <= static_cast<std::uint64_t>(INT64_MAX));
    const std::int64_t number = fits ? value_->get<std::int64_t>() : min;
    if (!fits || number < min || number > max) {
        fail(range_text("an integer", min, max));
        return min;
    }
    return number;
}

double JsonCursor::number(double min, double max) const {
    const bool is_number = value_ && value_->is_number();
    const double number = is_number ? value_->get<double>() : min;
    if (!is_number || !(number >= min && number <= max)) {
        fail(range_text("a number", min, max));
        return min;
    }
    return number;
}

bool JsonCursor::boolean() const {
    if (value_ && value_->is_boolean()) return value_->get<bool>();
    fail("true or false");
    return false;
}

std::uint64_t JsonCursor::hash() const {
    const auto value = from_hex(text());
    if (!value) fail("16 hexadecimal digits");
    return value.value_or(0);
}

nanoseconds JsonCursor::time_ns(std::int64_t min_ns, std::int64_t max_ns) const {
    return nanoseconds(integer(min_ns, max_ns));
}

void JsonCursor::fail(const std::string& accepted) const {
    if (!value_ || !fault_->message.empty()) return;
    fault_->message =
        fault_->file + ": " + path_ + ": found " + shown(*value_) + ", accepted: " + accepted;
}

}  // namespace urgengo::config
