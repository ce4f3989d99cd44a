// SPDX-License-Identifier: Apache-2.0
//
// The page: report.html filled in, then Chart.js, the numbers, and miss_view.js and report.js,
// which draw them.
#include <nlohmann/json.hpp>

#include "tools/report/html_template.h"
#include "tools/report/run_report.h"

/// By urgengo_embed_file().
extern "C" const char urgengo_run_report_html[], urgengo_run_report_html_end[];
extern "C" const char urgengo_run_report_js[], urgengo_run_report_js_end[];
extern "C" const char urgengo_miss_view_js[], urgengo_miss_view_js_end[];
extern "C" const char urgengo_chart_js[], urgengo_chart_js_end[];

namespace urgengo::report {
namespace {

using Json = nlohmann::ordered_json;

/// @returns JSON that cannot end the element that it stands in
std::string safe_json(const Json& data) {
    std::string safe;
    for (const char c : data.dump(-1, ' ', false, Json::error_handler_t::replace)) {
        if (c == '<')
            safe += "\\u003c";
        else
            safe += c;
    }
    return safe;
}

std::string title_of(const std::vector<ReportedRun>& runs) {
    std::string title = "UrgenGo: ";
    for (std::size_t i = 0; i < runs.size(); ++i) title += (i > 0 ? ", " : "") + runs[i].label;
    return title;
}

}  // namespace

std::string to_html(const std::vector<ReportedRun>& runs) {
    std::string page = cli::fill_template({urgengo_run_report_html, urgengo_run_report_html_end},
                                          {{"title", title_of(runs)}});
    page += "<script>";
    page.append(urgengo_chart_js, urgengo_chart_js_end);
    page += "</script>\n<script type=\"application/json\" id=\"data\">";
    page += safe_json(to_json(runs, true));
    page += "</script>\n<script>\n";
    page.append(urgengo_miss_view_js, urgengo_miss_view_js_end);
    page.append(urgengo_run_report_js, urgengo_run_report_js_end);
    page += "</script>\n</body></html>\n";
    return page;
}

}  // namespace urgengo::report
