// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bench_floor.h"

#include <nlohmann/json.hpp>

#include "host/config/json_cursor.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

/// Of the one chain: since the run's start.
void count_from_start(Json& chain, std::int64_t start_ns) {
    for (Json& record : chain.at("records"))
        for (auto& [key, value] : record.items())
            if (key.ends_with("_ns")) value = value.get<std::int64_t>() - start_ns;
}

/// @returns what is wrong; empty if nothing is
std::string why_not_of(const Json& report, const std::string& chain, const Json& first) {
    const Json& chains = report.at("chains");
    if (chains.size() != 1 || chains[0].at("name") != chain)
        return "found a report of other chains, accepted: of " + chain + " alone";
    for (const char* key : {"gpu", "version", "commit", "urgengo", "cpu_segments"})
        if (report.at(key) != first.at(key))
            return chain + ": " + key + ": found " + report.at(key).dump() +
                   ", accepted: " + first.at(key).dump() + ", as of the first chain";
    return {};
}

void add(Json& sum, const Json& value) {
    if (sum.is_number_integer())
        sum = sum.get<std::int64_t>() + value.get<std::int64_t>();
    else
        sum = sum.get<double>() + value.get<double>();
}

double mean_miss_ratio(const Json& chains) {
    double sum = 0;
    int counted = 0;
    for (const Json& chain : chains) {
        if (chain.at("instances") == 0) continue;
        sum += chain.at("miss_ratio").get<double>();
        ++counted;
    }
    return counted == 0 ? 0 : sum / counted;
}

}  // namespace

Result<std::vector<std::string>> chain_names(const std::string& workload, const std::string& file) {
    const auto document = config::parse_json(workload, file);
    if (!document) return Error{document.error()};
    config::JsonFault fault{file, {}};
    const config::JsonCursor chains = config::JsonCursor(*document, fault).at("chains");
    std::vector<std::string> names;
    for (const config::JsonCursor& chain : chains.items()) names.push_back(chain.at("name").name());
    if (names.empty()) chains.fail("at least one chain");
    if (!fault.message.empty()) return Error{fault.message};
    return names;
}

Result<std::string> combine_reports(const std::vector<std::string>& reports,
                                    const std::vector<std::string>& chains) {
    Json all;
    try {
        for (std::size_t i = 0; i < reports.size(); ++i) {
            Json report = Json::parse(reports[i]);
            const std::string wrong = why_not_of(report, chains.at(i), i == 0 ? report : all);
            if (!wrong.empty()) return Error{wrong};
            count_from_start(report.at("chains")[0], report.at("start_ns").get<std::int64_t>());
            if (i == 0) {
                all = std::move(report);
                continue;
            }
            all.at("chains").push_back(std::move(report.at("chains")[0]));
            for (const char* key : {"wall_s", "cpu_cores"}) add(all.at(key), report.at(key));
            for (const char* key : {"finished", "instances_per_s"})
                add(all.at("throughput").at(key), report.at("throughput").at(key));
        }
        all.at("start_ns") = 0;
        all.at("parameters").at("only") = "each chain alone";
        all.at("overall_miss_ratio") = mean_miss_ratio(all.at("chains"));
    } catch (const Json::exception& error) {
        return Error{std::string("the report of a chain alone: ") + error.what()};
    }
    return all.dump(1) + "\n";
}

}  // namespace urgengo::cli
