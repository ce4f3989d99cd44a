// SPDX-License-Identifier: Apache-2.0
//
// Fills in a page: the part of the template language Mustache that a report needs.
//   {{name}}                   the value, escaped
//   {{#name}} ... {{/name}}    for each item of a list, whose own names come first; once for what
//                              is true or an object; not at all for what is false or not there
//   {{.}}                      the item itself
// A line of nothing but a {{#name}} or a {{/name}} leaves no line.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace urgengo::cli {

/// @returns text that is safe inside HTML and inside its attributes
std::string html_escape(std::string_view text);

/// @param page  its sections end in the order in which they begin, inner ones first
/// @param data  an object; what it does not have is left empty
std::string fill_template(std::string_view page, const nlohmann::ordered_json& data);

}  // namespace urgengo::cli
