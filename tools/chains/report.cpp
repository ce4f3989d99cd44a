// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include <fmt/format.h>

namespace urgengo::chains {

namespace {

using Json = nlohmann::ordered_json;

double to_ms(std::chrono::nanoseconds time) {
    return double(time.count()) / 1e6;
}

const char* outcome_name(Outcome outcome) {
    switch (outcome) {
        case Outcome::kOnTime:
            return "on_time";
        case Outcome::kLate:
            return "late";
        case Outcome::kExited:
            return "exited";
        case Outcome::kDropped:
            return "dropped";
        case Outcome::kNotRun:
            break;
    }
    return "not_run";
}

std::optional<LatencySummary> summarize_latencies(std::vector<double> latencies_ms) {
    if (latencies_ms.empty()) return std::nullopt;
    std::sort(latencies_ms.begin(), latencies_ms.end());
    const double sum = std::accumulate(latencies_ms.begin(), latencies_ms.end(), 0.0);
    return LatencySummary{sum / double(latencies_ms.size()), percentile(latencies_ms, 0.50),
                          percentile(latencies_ms, 0.95), percentile(latencies_ms, 0.99),
                          latencies_ms.back()};
}

Json latency_json(const std::optional<LatencySummary>& latency) {
    if (!latency) return nullptr;
    return {{"mean", latency->mean_ms},
            {"p50", latency->p50_ms},
            {"p95", latency->p95_ms},
            {"p99", latency->p99_ms},
            {"max", latency->max_ms}};
}

Json calls_json(const std::vector<CallReport>& calls) {
    Json list = Json::array();
    for (const CallReport& call : calls)
        list.push_back({{"call", call.name},
                        {"count", call.count},
                        {"p50_us", call.p50_us},
                        {"p99_us", call.p99_us},
                        {"max_us", call.max_us}});
    return list;
}

/// Times on CLOCK_MONOTONIC, so that they can be compared with a trace of the run.
Json instances_json(const std::vector<InstanceRecord>& records, std::chrono::nanoseconds start) {
    const auto time_ns = [start](std::chrono::nanoseconds time) { return (start + time).count(); };
    Json list = Json::array();
    for (const InstanceRecord& record : records) {
        if (record.outcome == Outcome::kNotRun) continue;
        Json json = {{"outcome", outcome_name(record.outcome)},
                     {"arrival_ns", time_ns(record.arrival)}};
        if (record.thread != 0) {
            json["thread"] = record.thread;
            json["begin_ns"] = time_ns(record.begin);
            json["first_launched_ns"] = time_ns(record.first_launched);
        }
        if (record.completed()) {
            json["end_ns"] = time_ns(record.end);
            json["latency_ms"] = to_ms(record.latency());
        }
        list.push_back(std::move(json));
    }
    return list;
}

}  // namespace

double percentile(const std::vector<double>& sorted, double fraction) {
    // Less a hair, so that 0.95 of 20 values is the 19th although 0.95 is not exact in binary.
    const double rank = std::ceil(fraction * double(sorted.size()) - 1e-9);
    return sorted[static_cast<std::size_t>(std::clamp(rank, 1.0, double(sorted.size()))) - 1];
}

void summarize(ChainReport& report, std::vector<InstanceRecord> records) {
    std::vector<double> latencies_ms;
    report.instances = report.missed = report.exited = report.dropped = 0;
    for (const InstanceRecord& record : records) {
        if (record.outcome == Outcome::kNotRun) continue;
        report.instances++;
        report.missed += record.outcome != Outcome::kOnTime;
        report.exited += record.outcome == Outcome::kExited;
        report.dropped += record.outcome == Outcome::kDropped;
        if (record.completed()) latencies_ms.push_back(to_ms(record.latency()));
    }
    report.latency = summarize_latencies(std::move(latencies_ms));
    report.records = std::move(records);
}

double RunReport::overall_miss_ratio() const {
    double sum = 0;
    int counted = 0;
    for (const ChainReport& chain : chains) {
        if (chain.instances == 0) continue;
        sum += chain.miss_ratio();
        counted++;
    }
    return counted == 0 ? 0 : sum / counted;
}

int RunReport::finished_in_time() const {
    int finished = 0;
    for (const ChainReport& chain : chains) {
        for (const InstanceRecord& record : chain.records)
            finished += record.completed() && record.end <= arrivals_for;
    }
    return finished;
}

double RunReport::instances_per_s() const {
    const double seconds = std::chrono::duration<double>(arrivals_for).count();
    return seconds > 0 ? finished_in_time() / seconds : 0;
}

std::string format_overall(const RunReport& report) {
    return fmt::format("overall deadline miss ratio: {:.2f} %\n",
                       report.overall_miss_ratio() * 100);
}

std::string format_table(const RunReport& report) {
    std::string text = fmt::format("{:<6} {:>8} {:>9} {:>7} {:>7} {:>7} {:>7}  {}\n", "chain",
                                   "deadline", "instances", "missed", "miss %", "exited", "dropped",
                                   "latency ms: p50      p95      p99      max");
    for (const ChainReport& chain : report.chains) {
        text += fmt::format("{:<6} {:>8.1f} {:>9} {:>7} {:>7.1f} {:>7} {:>7}  ", chain.name,
                            chain.deadline_ms, chain.instances, chain.missed,
                            chain.miss_ratio() * 100, chain.exited, chain.dropped);
        if (chain.latency) {
            text +=
                fmt::format("{:>15.1f} {:>8.1f} {:>8.1f} {:>8.1f}\n", chain.latency->p50_ms,
                            chain.latency->p95_ms, chain.latency->p99_ms, chain.latency->max_ms);
        } else {
            text += fmt::format("{:>15} {:>8} {:>8} {:>8}\n", "-", "-", "-", "-");
        }
    }
    text += fmt::format("\ngpu: {}; CPU segments: {}; CPU: {:.2f} cores on average; UrgenGo: {}\n",
                        report.gpu, report.cpu_segments, report.cpu_cores, report.urgengo);
    text += fmt::format("finished while frames arrived: {:.2f} instances/s\n",
                        report.instances_per_s());
    text += fmt::format("results: {}{}\n", report.results,
                        report.results_detail.empty() ? "" : " (" + report.results_detail + ")");
    for (const CallReport& call : report.disturber)
        text +=
            fmt::format("disturber: {:<28} {:>6} times, us: p50 {:.0f}, p99 {:.0f}, max {:.0f}\n",
                        call.name, call.count, call.p50_us, call.p99_us, call.max_us);
    if (report.interrupted) {
        text +=
            fmt::format("interrupted after {:.1f} s: frames that had not begun are not counted\n",
                        report.wall_s);
    }
    return text + format_overall(report);
}

std::string format_json(const RunReport& report, bool with_instances) {
    Json parameters = Json::object();
    for (const auto& [name, value] : report.parameters) parameters[name] = value;
    Json json = {
        {"format_version", 1},
        {"program", "urgengo-chains"},
        {"version", report.version},
        {"commit", report.commit},
        {"date_utc", report.date_utc},
        {"command_line", report.command_line},
        {"parameters", std::move(parameters)},
        {"gpu", report.gpu},
        {"num_sms", report.num_sms},
        {"cuda_driver_version", report.cuda_driver_version},
        {"kernel_driver_version",
         report.kernel_driver_version.empty() ? Json(nullptr) : Json(report.kernel_driver_version)},
        {"cpu_segments", report.cpu_segments},
        {"urgengo", report.urgengo},
        {"interrupted", report.interrupted},
        {"start_ns", report.start.count()},
        {"wall_s", report.wall_s},
        {"cpu_cores", report.cpu_cores},
        {"results", report.results},
        {"results_detail", report.results_detail},
        {"checksum", fmt::format("{:016x}", report.checksum)},
        {"overall_miss_ratio", report.overall_miss_ratio()},
        {"throughput",
         {{"arrivals_s", std::chrono::duration<double>(report.arrivals_for).count()},
          {"finished", report.finished_in_time()},
          {"instances_per_s", report.instances_per_s()}}},
        {"chains", Json::array()}};
    for (const ChainReport& chain : report.chains) {
        Json entry = {{"name", chain.name},
                      {"period_ms", chain.period_ms},
                      {"deadline_ms", chain.deadline_ms},
                      {"tight", chain.tight},
                      {"instances", chain.instances},
                      {"missed", chain.missed},
                      {"miss_ratio", chain.miss_ratio()},
                      {"exited", chain.exited},
                      {"dropped", chain.dropped},
                      {"latency_ms", latency_json(chain.latency)}};
        if (with_instances) entry["records"] = instances_json(chain.records, report.start);
        json["chains"].push_back(std::move(entry));
    }
    if (!report.disturber.empty()) json["disturber"] = calls_json(report.disturber);
    return json.dump(1) + "\n";
}

}  // namespace urgengo::chains
