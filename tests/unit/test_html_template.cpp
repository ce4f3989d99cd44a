// SPDX-License-Identifier: Apache-2.0
#include "tools/report/html_template.h"

#include <nlohmann/json.hpp>

#include "tests/support/catch.h"

namespace urgengo::cli {
namespace {

TEST_CASE("A template has values escaped, and nothing where there is none", "[unit][cli]") {
    CHECK(fill_template("<a href=\"{{to}}\">{{text}}</a>",
                        {{"to", "x\"><script>"}, {"text", "<b> & {{to}}"}}) ==
          "<a href=\"x&quot;&gt;&lt;script&gt;\">&lt;b&gt; &amp; {{to}}</a>");
    CHECK(fill_template("{{number}} {{unknown}}.", {{"number", 3}}) == "3 .");
    CHECK(fill_template("", {{"number", 3}}).empty());
    CHECK(fill_template("a { b: c; } }\n", {{"number", 3}}) == "a { b: c; } }\n");
}

TEST_CASE("A template repeats a section for each item of a list", "[unit][cli]") {
    const nlohmann::ordered_json data{
        {"unit", "ms"},
        {"rows", {{{"name", "a"}, {"cells", {1, 2}}}, {{"name", "b"}, {"unit", "us"}}}}};
    CHECK(fill_template("{{#rows}}{{name}}:{{#cells}} {{.}}{{/cells}} {{unit}};{{/rows}}!", data) ==
          "a: 1 2 ms;b: us;!");
}

TEST_CASE("A template shows a section once for what is true, and not for what is not",
          "[unit][cli]") {
    const std::string page = "<{{#it}}yes {{#inner}}{{name}}{{/inner}}{{/it}}>{{name}}";
    const auto with = [&](const nlohmann::ordered_json& it) {
        return fill_template(page, {{"it", it}, {"name", "n"}});
    };
    CHECK(with(true) == "<yes >n");
    CHECK(with(false) == "<>n");
    CHECK(with(nlohmann::ordered_json::array()) == "<>n");
    CHECK(with({{"inner", {{"name", "x"}}}}) == "<yes x>n");
    CHECK(fill_template(page, {{"name", "n"}}) == "<>n");
}

TEST_CASE("A section's tags leave no empty lines", "[unit][cli]") {
    CHECK(fill_template("a\n{{#rows}}\n<{{.}}>\n{{/rows}}\nb\n\n{{x}}\nc", {{"rows", {1, 2}}}) ==
          "a\n<1>\n<2>\nb\n\n\nc");
    CHECK(fill_template("{{#rows}}{{.}}\n{{/rows}}", {{"rows", {1, 2}}}) == "1\n2\n");
}

}  // namespace
}  // namespace urgengo::cli
