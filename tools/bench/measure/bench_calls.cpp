// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/measure/bench_calls.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string_view>

#include "tools/bench/smoke/bench_table.h"
#include "tools/urgengo/text_table.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

/// Google Benchmark's name of a case, without what it adds for cases that time themselves.
std::string case_name(std::string name) {
    constexpr std::string_view kSuffix = "/manual_time";
    if (name.ends_with(kSuffix)) name.resize(name.size() - kSuffix.size());
    return name;
}

template <typename Value>
Spread over_rounds(const std::vector<CallTimes>& rounds, const std::string& call, Value&& value) {
    std::vector<double> values;
    for (const CallTimes& times : rounds) {
        const auto found = times.find(call);
        if (found != times.end()) values.push_back(value(found->second));
    }
    return values.empty() ? Spread{} : spread(std::move(values));
}

double time_of(const CallTime& time) {
    return time.ns;
}

}  // namespace

Result<CallTimes> parse_call_times(const std::string& text, const std::string& file) {
    const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
    if (!json.is_object() || !json.contains("benchmarks") || !json["benchmarks"].is_array())
        return Error{file + ": found no list of benchmarks, accepted: Google Benchmark's JSON"};
    CallTimes times;
    for (const Json& entry : json["benchmarks"]) {
        if (entry.value("error_occurred", false))
            return Error{file + ": " + entry.value("name", "a case") +
                         " failed: " + entry.value("error_message", "no reason given")};
        // Processor time where the whole loop is timed: what others do to this machine is not ours.
        const char* time = entry.contains("median_ns") ? "median_ns" : "cpu_time";
        if (!entry.contains(time) || !entry[time].is_number() || !entry.contains("name"))
            return Error{file + ": found a benchmark without name or " + time};
        times[case_name(entry["name"].get<std::string>())] = {entry[time].get<double>(),
                                                              entry.value("driver_calls", 0.0),
                                                              entry.value("nvtx_calls", 0.0)};
    }
    if (times.empty()) return Error{file + ": found no benchmark in it"};
    return times;
}

std::string why_not_scheduled(const std::string& stats, const std::string& chain) {
    const Json json = Json::parse(stats, nullptr, /*allow_exceptions=*/false);
    if (!json.is_object() || !json.contains("chains")) return "UrgenGo wrote no statistics";
    for (const Json& entry : json["chains"]) {
        if (entry.value("name", "") != chain) continue;
        const auto count = [&](const char* name) { return entry.value(name, std::uint64_t{0}); };
        if (count("launches") == 0) return "UrgenGo saw no launch of chain " + chain;
        if (count("scheduled") != count("launches"))
            return fmt::format("{} of {} launches were scheduled", count("scheduled"),
                               count("launches"));
        if (count("holds") != 0) return fmt::format("{} launches were held", count("holds"));
        return "";
    }
    return "UrgenGo's statistics know no chain " + chain;
}

std::string why_not_marked(const CallTimes& times) {
    for (const auto& [call, time] : times)
        if (time.driver_calls < 2)
            return fmt::format("{} makes {:.2f} driver calls, accepted: at least 2", call,
                               time.driver_calls);
    return "";
}

std::string why_not_told(const CallTimes& times) {
    for (const auto& [call, time] : times)
        if (time.nvtx_calls <= 0)
            return call + " makes no call of the NVTX tool, accepted: some in each frame";
    return "";
}

Spread CallBench::own_ns(const std::string& call, std::size_t condition) const {
    const double bare = driver_ns(call).median;
    Spread own = over_rounds(runs[condition], call, time_of);
    own.median -= bare;
    own.min -= bare;
    own.max -= bare;
    return own;
}

Spread CallBench::driver_ns(const std::string& call) const {
    return over_rounds(runs.front(), call, time_of);
}

double CallBench::driver_calls(const std::string& call, std::size_t condition) const {
    return over_rounds(runs[condition], call, [](const CallTime& t) { return t.driver_calls; })
        .median;
}

double CallBench::nvtx_calls(const std::string& call, std::size_t condition) const {
    return over_rounds(runs[condition], call, [](const CallTime& t) { return t.nvtx_calls; })
        .median;
}

double call_goal_ns(const std::string& call) {
    if (call.starts_with("pass_through/")) return 1;
    if (call.starts_with("nothing_to_do/")) return 3;
    if (call.starts_with("scheduled/")) return 200;
    return 0;
}

std::string format_call_table(const CallBench& bench) {
    TextTable table;
    table.add_row({"call", "condition", "own ns", "goal", "", "driver ns", "driver calls"});
    for (const auto& [call, bare] : bench.runs.front().front()) {
        for (std::size_t i = 1; i < bench.conditions.size(); ++i) {
            if (!bench.runs[i].front().contains(call)) continue;
            const Spread own = bench.own_ns(call, i);
            const double goal = call_goal_ns(call);
            table.add_row({call, bench.conditions[i].name, format_spread(own, 1),
                           goal > 0 ? fmt::format("{:g}", goal) : "",
                           goal == 0            ? ""
                           : own.median <= goal ? "met"
                                                : "NOT MET",
                           fmt::format("{:.1f}", bench.driver_ns(call).median),
                           fmt::format("{:.2f}", bench.driver_calls(call, i))});
        }
    }
    return table.text();
}

std::string to_json(const CallBench& bench) {
    Json conditions = Json::array();
    for (std::size_t i = 0; i < bench.conditions.size(); ++i) {
        const CallCondition& c = bench.conditions[i];
        Json calls = Json::object();
        for (const auto& [call, first] : bench.runs[i].front()) {
            Json rounds = Json::array();
            for (const CallTimes& times : bench.runs[i]) rounds.push_back(times.at(call).ns);
            calls[call] = {{"ns", std::move(rounds)},
                           {"driver_calls", bench.driver_calls(call, i)}};
            if (i > 0) calls[call]["own_ns"] = bench.own_ns(call, i).median;
            if (c.nvtx) calls[call]["nvtx_calls"] = bench.nvtx_calls(call, i);
        }
        conditions.push_back(
            {{"condition", c.name},
             {"chains", c.chains},
             {"mark_every_us", c.mark_every_us ? Json(*c.mark_every_us) : Json(nullptr)},
             {"kernel_us", c.kernel_us},
             {"calls", std::move(calls)}});
    }
    const Json root = {{"format_version", 1},
                       {"program", "urgengo bench calls"},
                       {"driver", bench.driver_name},
                       {"cpu", bench.cpu},
                       {"version", bench.version},
                       {"commit", bench.commit},
                       {"date_utc", bench.date_utc},
                       {"command_line", bench.command_line},
                       {"conditions", std::move(conditions)}};
    return root.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace urgengo::cli
