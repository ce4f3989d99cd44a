// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/measure/latency_merge.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "tools/bench/smoke/bench_conditions.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

constexpr char kProgram[] = "urgengo bench latency";
const std::set<std::string> kFreeParameters{"seed", "repeats", "workload", "merged"};

/// A histogram's bins: of runs whose counters ticked a little faster or slower they lie between
/// each other.
using Bins = std::map<double, std::uint64_t>;

double percentile(const Bins& bins, std::uint64_t count, double share, double max) {
    // As the histogram: less a hair, so that 0.99 of 100 values is the 99th.
    const double rank = std::max(1.0, std::ceil(share * static_cast<double>(count) - 1e-6));
    std::uint64_t below = 0;
    for (const auto& [middle, values] : bins) {
        below += values;
        if (static_cast<double>(below) >= rank) return std::min(middle, max);
    }
    return 0;
}

Json merge_times(const std::vector<const Json*>& parts) {
    Bins bins;
    std::uint64_t count = 0;
    double sum = 0, max = 0;
    for (const Json* part : parts) {
        const auto values = part->at("count").get<std::uint64_t>();
        const auto middles = part->at("bin_middles").get<std::vector<double>>();
        const Json& counts = part->at("bin_counts");
        for (std::size_t i = 0; i < middles.size(); ++i)
            bins[middles[i]] += counts.at(i).get<std::uint64_t>();
        count += values;
        sum += part->at("mean").get<double>() * static_cast<double>(values);
        max = std::max(max, part->at("max").get<double>());
    }
    std::vector<double> middles;
    std::vector<std::uint64_t> counts;
    for (const auto& [middle, values] : bins) {
        middles.push_back(middle);
        counts.push_back(values);
    }
    return {{"count", count},
            {"mean", count ? sum / static_cast<double>(count) : 0},
            {"p50", percentile(bins, count, 0.5, max)},
            {"p90", percentile(bins, count, 0.9, max)},
            {"p99", percentile(bins, count, 0.99, max)},
            {"p99.99", percentile(bins, count, 0.9999, max)},
            {"max", max},
            {"bin_middles", std::move(middles)},
            {"bin_counts", std::move(counts)}};
}

/// Whatever the library counts, at its place.
Json merge_own_times(const std::vector<const Json*>& parts) {
    const Json& first = *parts.front();
    if (first.is_number()) {
        std::uint64_t sum = 0;
        for (const Json* part : parts) sum += part->get<std::uint64_t>();
        return sum;
    }
    if (first.contains("bin_middles")) return merge_times(parts);
    Json merged = Json::object();
    for (const auto& [key, unused] : first.items()) {
        std::vector<const Json*> values;
        for (const Json* part : parts) values.push_back(&part->at(key));
        merged[key] = merge_own_times(values);
    }
    return merged;
}

/// All runs at one load.
struct Load {
    std::vector<std::uint64_t> seeds;
    std::vector<double> miss_ratios;
    std::vector<const Json*> own_times;
};
using Loads = std::map<double, Load>;

/// @returns what is wrong; empty if nothing is
std::string append(const Json& root, const std::string& file, Loads& loads) {
    for (const Json& run : root.at("runs")) {
        const auto f_a = run.at("f_a").get<double>();
        Load& load = loads[f_a];
        // Of a merged one, several.
        const auto seeds = run.contains("seeds") ? run.at("seeds").get<std::vector<std::uint64_t>>()
                                                 : std::vector{run.at("seed").get<std::uint64_t>()};
        for (const std::uint64_t seed : seeds) {
            if (std::find(load.seeds.begin(), load.seeds.end(), seed) != load.seeds.end())
                return fmt::format("{}: found seed {} at f_a {} again, accepted: each once", file,
                                   seed, f_a);
            load.seeds.push_back(seed);
        }
        const Json& ratios = run.contains("miss_ratios")
                                 ? run.at("miss_ratios")
                                 : Json::array({run.at("report").at("overall_miss_ratio")});
        for (const Json& ratio : ratios) load.miss_ratios.push_back(ratio.get<double>());
        const Json& own_time = run.at("own_time");
        if (!own_time.at("instances").at("added_ns").contains("bin_middles"))
            return file +
                   ": found no histograms, accepted: results of a library that writes them "
                   "(measure again)";
        load.own_times.push_back(&own_time);
    }
    return {};
}

Json runs_of(const Loads& loads) {
    Json runs = Json::array();
    for (const auto& [f_a, load] : loads) {
        Json own_time = Json::object();
        for (const char* part : {"calls", "instances"}) {
            std::vector<const Json*> parts;
            for (const Json* one : load.own_times) parts.push_back(&one->at(part));
            own_time[part] = merge_own_times(parts);
        }
        runs.push_back({{"f_a", f_a},
                        {"seeds", load.seeds},
                        {"miss_ratios", load.miss_ratios},
                        {"own_time", std::move(own_time)}});
    }
    return runs;
}

}  // namespace

Result<Json> merge_latencies(const std::vector<std::string>& texts,
                             const std::vector<std::string>& files) {
    std::vector<Json> roots(texts.size());
    Json merged, wanted;
    std::string lines;
    Loads loads;
    for (std::size_t i = 0; i < texts.size(); ++i) {
        try {
            const Json& root = roots[i] = Json::parse(texts[i]);
            if (root.at("program") != kProgram)
                return Error{files[i] + ": program: found " + root.at("program").dump() +
                             ", accepted: \"" + kProgram + "\""};
            const Json found = conditions(root, kFreeParameters);
            if (i == 0) wanted = found, merged = root;
            const std::string difference = first_difference(wanted, found);
            if (!difference.empty())
                return Error{files[i] + ": " + difference + ", accepted: the same as in " +
                             files[0]};
            const std::string wrong = append(root, files[i], loads);
            if (!wrong.empty()) return Error{wrong};
            lines += (i == 0 ? "" : "; ") + root.at("command_line").get<std::string>();
        } catch (const Json::exception& error) {
            return Error{files[i] + ": found no results of this version of `" + kProgram + "` (" +
                         error.what() + ")"};
        }
    }
    if (loads.empty()) return Error{files.at(0) + ": found no run"};
    try {
        merged["runs"] = runs_of(loads);
    } catch (const Json::exception& error) {
        return Error{std::string("found own times that do not fit together: ") + error.what()};
    }
    merged["command_line"] = lines;
    merged["parameters"].erase("seed");
    merged["parameters"].erase("repeats");
    merged["parameters"]["merged"] = std::to_string(files.size());
    return merged;
}

}  // namespace urgengo::cli
