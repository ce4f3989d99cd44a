// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bench_results.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "host/config/json_cursor.h"

namespace urgengo::cli {
namespace {

using config::JsonCursor;

constexpr double kPercent = 100;
constexpr double kLarge = 1e12;

constexpr std::int64_t kBlockNs = 1'000'000'000;

/// @param chain  of a report that lists every instance
void count_blocks(const nlohmann::json& chain, std::int64_t first_ns, std::vector<Block>& blocks) {
    for (const auto& record : chain.at("records")) {
        const std::int64_t since_ns = record.at("arrival_ns").get<std::int64_t>() - first_ns;
        const auto number = static_cast<std::size_t>(since_ns / kBlockNs);
        if (blocks.size() <= number) blocks.resize(number + 1);
        ++blocks[number].frames;
        blocks[number].missed += record.at("outcome") != "on_time";
    }
}

/// @errors none: the program writes all instances or none
void count_blocks(const nlohmann::json& report, RunResult& run) {
    const auto& chains = report.at("chains");
    std::int64_t first_ns = INT64_MAX;
    for (const auto& chain : chains) {
        if (!chain.contains("records")) return;
        for (const auto& record : chain.at("records"))
            first_ns = std::min(first_ns, record.at("arrival_ns").get<std::int64_t>());
    }
    for (std::size_t i = 0; i < run.chains.size(); ++i)
        count_blocks(chains[i], first_ns, run.chains[i].blocks);
}

}  // namespace

std::size_t RunResult::num_blocks() const {
    std::size_t most = 0;
    for (const ChainResult& chain : chains) most = std::max(most, chain.blocks.size());
    return most;
}

Result<RunResult> parse_report(const std::string& json, const std::string& file) {
    const auto document = config::parse_json(json, file);
    if (!document) return Error{document.error()};
    config::JsonFault fault{file, {}};
    const JsonCursor root(*document, fault);

    RunResult run;
    run.gpu = root.at("gpu").text();
    const auto kernel_driver = document->find("kernel_driver_version");
    const bool named = kernel_driver != document->end() && kernel_driver->is_string();
    run.driver =
        named ? kernel_driver->get<std::string>() : "CUDA " + root.at("cuda_driver_version").text();
    run.urgengo = root.at("urgengo").text();
    run.miss_pct = kPercent * root.at("overall_miss_ratio").number(0, 1);
    run.cpu_cores = root.at("cpu_cores").number(0, kLarge);
    for (const JsonCursor& chain : root.at("chains").items()) {
        run.chains.push_back({chain.at("name").name(),
                              chain.at("deadline_ms").number(0, kLarge),
                              kPercent * chain.at("miss_ratio").number(0, 1),
                              {}});
        run.exited += static_cast<double>(chain.at("exited").integer(0, INT32_MAX));
    }
    if (run.chains.empty()) root.at("chains").fail("at least one chain");
    if (!fault.message.empty()) return Error{fault.message};
    count_blocks(*document, run);
    run.report = json;
    return run;
}

Spread spread(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    const std::size_t half = values.size() / 2;
    const double median =
        values.size() % 2 == 1 ? values[half] : (values[half - 1] + values[half]) / 2;
    return {median, values.front(), values.back()};
}

Spread BenchResults::over_repeats(const std::string& row, double f_a,
                                  const std::function<double(const RunResult&)>& value) const {
    std::vector<double> values;
    for (const RunResult& run : runs) {
        if (run.row == row && run.f_a == f_a) values.push_back(value(run));
    }
    return spread(std::move(values));
}

Spread BenchResults::miss_pct(const std::string& row, double f_a) const {
    return over_repeats(row, f_a, [](const RunResult& run) { return run.miss_pct; });
}

Spread BenchResults::chain_miss_pct(const std::string& row, double f_a, std::size_t chain) const {
    return over_repeats(row, f_a,
                        [chain](const RunResult& run) { return run.chains[chain].miss_pct; });
}

const std::vector<ChainResult>& BenchResults::chains(double f_a) const {
    const auto first = std::find_if(runs.begin(), runs.end(),
                                    [f_a](const RunResult& run) { return run.f_a == f_a; });
    return first->chains;
}

}  // namespace urgengo::cli
