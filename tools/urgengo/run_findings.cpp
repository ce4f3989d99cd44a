// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/run_findings.h"

#include <fmt/format.h>

#include "host/config/file_text.h"
#include "host/config/json_cursor.h"
#include "tools/urgengo/text_table.h"

namespace urgengo::cli {
namespace {

using config::JsonCursor;
using Json = nlohmann::ordered_json;

constexpr double kMost = 1e18;

std::uint64_t count_of(const JsonCursor& chain, const char* key) {
    return static_cast<std::uint64_t>(chain.at(key).number(0, kMost));
}

}  // namespace

Result<RunFindings> read_run_findings(const std::string& file) {
    const auto text = config::read_file(file);
    if (!text) return Error{text.error()};
    const auto document = config::parse_json(*text, file);
    if (!document) return Error{document.error()};
    config::JsonFault fault{file, {}};
    const JsonCursor root(*document, fault);
    RunFindings found{.file = file,
                      .mode = root.at("mode").text(),
                      .tripped = root.at("tripped").text(),
                      .guard = root.at("guard").text(),
                      .warnings = {},
                      .chains = {}};
    if (const auto warnings = root.find("warnings")) {
        for (const JsonCursor& line : warnings->items()) found.warnings.push_back(line.text());
    } else {
        found.has_warnings = false;
    }
    for (const JsonCursor& chain : root.at("chains").items())
        found.chains.push_back({.name = chain.at("name").text(),
                                .guard = chain.at("guard").text(),
                                .instances = count_of(chain, "instances"),
                                .late_starts = count_of(chain, "late_starts"),
                                .early_frames = count_of(chain, "early_frames"),
                                .unknown = count_of(chain, "unknown")});
    if (!fault.message.empty()) return Error{fault.message};
    return found;
}

std::string format_run_findings(const RunFindings& findings) {
    TextTable table;
    table.add_row({"chain", "frames", "late starts", "early", "unknown launches", "guard"});
    for (const ChainFindings& chain : findings.chains)
        table.add_row({chain.name, std::to_string(chain.instances),
                       std::to_string(chain.late_starts), std::to_string(chain.early_frames),
                       std::to_string(chain.unknown), chain.guard});
    std::string text =
        fmt::format("In the run of {}, mode {}:\n{}", findings.file, findings.mode, table.text());
    if (!findings.tripped.empty())
        text += fmt::format("UrgenGo stopped scheduling: {}\n", findings.tripped);
    if (!findings.guard.empty()) text += findings.guard + "\n";
    for (const std::string& warning : findings.warnings) text += warning + "\n";
    if (!findings.has_warnings)
        text += "The version that ran wrote no warnings into its statistics.\n";
    else if (findings.warnings.empty() && findings.tripped.empty() && findings.mode != "off")
        text += "It warned of nothing.\n";
    return text;
}

nlohmann::ordered_json run_findings_json(const RunFindings& findings) {
    Json json = {{"file", findings.file},         {"mode", findings.mode},
                 {"tripped", findings.tripped},   {"guard", findings.guard},
                 {"warnings", findings.warnings}, {"chains", Json::array()}};
    for (const ChainFindings& chain : findings.chains)
        json["chains"].push_back({{"chain", chain.name},
                                  {"guard", chain.guard},
                                  {"frames", chain.instances},
                                  {"late_starts", chain.late_starts},
                                  {"early_frames", chain.early_frames},
                                  {"unknown_launches", chain.unknown}});
    return json;
}

}  // namespace urgengo::cli
