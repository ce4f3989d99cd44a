// SPDX-License-Identifier: Apache-2.0
#include "tools/report/html_template.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

bool is_section_tag(std::string_view tag) {
    return tag.substr(0, 3) == "{{#" || tag.substr(0, 3) == "{{/";
}

/// The page without the line ends behind tags of sections that stand alone in their lines.
std::string joined_lines(std::string_view page) {
    std::string joined;
    while (!page.empty()) {
        const std::string_view line = page.substr(0, page.find('\n'));
        const bool stands_alone = is_section_tag(line) && line.find("}}") == line.size() - 2;
        joined += line;
        page.remove_prefix(line.size());
        if (page.empty()) break;
        page.remove_prefix(1);
        if (!stands_alone) joined += '\n';
    }
    return joined;
}

class Filler {
  public:
    Filler(std::string_view page, const Json& data) : rest_(page) { scopes_.push_back(&data); }

    std::string fill() {
        fill_section(true);
        return std::move(filled_);
    }

  private:
    /// Goes on behind the end of the section, or to the end of the page.
    /// @param shown  false: only passes over it
    void fill_section(bool shown) {
        for (;;) {
            const std::string_view text = take_until("{{");
            if (shown) filled_ += text;
            if (rest_.empty()) return;
            const std::string_view tag = take_until("}}");
            if (tag.front() == '/') return;
            if (tag.front() == '#')
                fill_each(tag.substr(1), shown);
            else if (shown)
                filled_ += html_escape(as_text(find(tag)));
        }
    }

    void fill_each(std::string_view name, bool shown) {
        const Json& value = shown ? find(name) : nothing();
        const bool is_nothing = value.is_null() || value == false || value == Json::array();
        const std::string_view section = rest_;
        const auto fill_with = [&](const Json& item) {
            rest_ = section;
            scopes_.push_back(&item);
            fill_section(!is_nothing);
            scopes_.pop_back();
        };
        if (is_nothing || !value.is_array()) return fill_with(value);
        for (const Json& item : value) fill_with(item);
    }

    /// @returns what comes before it; goes on behind it
    std::string_view take_until(std::string_view end) {
        const std::string_view taken = rest_.substr(0, rest_.find(end));
        rest_.remove_prefix(std::min(taken.size() + end.size(), rest_.size()));
        return taken;
    }

    const Json& find(std::string_view name) const {
        if (name == ".") return *scopes_.back();
        for (auto scope = scopes_.rbegin(); scope != scopes_.rend(); ++scope) {
            if (!(*scope)->is_object()) continue;
            const auto found = (*scope)->find(std::string(name));
            if (found != (*scope)->end()) return *found;
        }
        return nothing();
    }
    static const Json& nothing() {
        static const Json null;
        return null;
    }
    static std::string as_text(const Json& value) {
        if (value.is_null()) return "";
        return value.is_string() ? value.get<std::string>() : value.dump();
    }

    std::string_view rest_;
    std::vector<const Json*> scopes_;  ///< the innermost last
    std::string filled_;
};

}  // namespace

std::string html_escape(std::string_view text) {
    std::string escaped;
    for (const char c : text) {
        switch (c) {
            case '&':
                escaped += "&amp;";
                break;
            case '<':
                escaped += "&lt;";
                break;
            case '>':
                escaped += "&gt;";
                break;
            case '"':
                escaped += "&quot;";
                break;
            default:
                escaped += c;
        }
    }
    return escaped;
}

std::string fill_template(std::string_view page, const Json& data) {
    const std::string joined = joined_lines(page);
    return Filler(joined, data).fill();
}

}  // namespace urgengo::cli
