// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/sim_mixes.h"

#include <map>
#include <set>

namespace urgengo::cli {
namespace {

using config::JsonCursor;

constexpr double kMost = 1e6;
constexpr char kProgram[] = "network_mixes.py", kPriorities[] = "priorities",
               kUrgengo[] = "urgengo";

/// @param keys  of `scheduler:`, as --priorities takes them: "admission: none, guard: off"
/// @returns the row's name: urgengo+admission=none+guard=off
std::string row_with(const std::string& keys) {
    std::string row = kUrgengo;
    std::string word;
    for (const char c : keys + ",") {
        if (c == ',' && !word.empty()) row += "+" + word;
        if (c == ',')
            word.clear();
        else if (c != ' ')
            word += c == ':' ? '=' : c;
    }
    return row;
}

std::vector<sim::ChainTimes> times_of(const JsonCursor& run) {
    std::vector<sim::ChainTimes> times;
    for (const JsonCursor& network : run.at("networks").items())
        times.push_back({network.at("name").text(), network.at("period_ms").number(0, kMost),
                         network.at("deadline_ms").number(0, kMost)});
    return times;
}

/// Means by chain, over runs with true profiles.
class Paces {
  public:
    void add(const JsonCursor& run) {
        for (const JsonCursor& chain : run.at("scheduler_stats").at("chains").items()) {
            Sum& sum = sums_[chain.at("name").text()];
            sum.pace += chain.at("launch_pace").number(0, kMost);
            ++sum.count;
        }
    }
    void set(std::vector<sim::ChainTimes>& times) const {
        for (sim::ChainTimes& its : times)
            if (const auto sum = sums_.find(its.name); sum != sums_.end())
                its.pace = sum->second.pace / sum->second.count;
    }

  private:
    struct Sum {
        double pace = 0;
        int count = 0;
    };
    std::map<std::string, Sum> sums_;
};

bool are_of(const std::vector<sim::ChainTimes>& times, const std::vector<std::string>& names) {
    std::set<std::string> found;
    for (const sim::ChainTimes& its : times) found.insert(its.name);
    return found == std::set<std::string>(names.begin(), names.end());
}

}  // namespace

bool has_mixes(const JsonCursor& root) {
    const auto program = root.find("program");
    return program && program->text().ends_with(kProgram);
}

void read_mixes(const JsonCursor& root, const std::vector<std::string>& names,
                bool beside_bystander, Measured& measured) {
    const JsonCursor options = root.at("options");
    measured.warmup = options.at("warmup").number(0, kMost);
    measured.seconds = options.at("seconds").number(0, kMost) + measured.warmup;
    const std::string priorities = row_with(options.at("priorities").text());
    Paces paces;
    for (const JsonCursor& run : root.at("runs").items()) {
        const std::string row = run.at("row").text();
        if (row == kUrgengo || row == kPriorities) paces.add(run);
        if (run.at("bystander").boolean() != beside_bystander) continue;
        const double load = run.at("load").number(0, kMost);
        const auto times = times_of(run);
        if (!are_of(times, names)) continue;
        measured.times.emplace(load, times);
        measured.runs.push_back({row == kPriorities ? priorities : row, load,
                                 static_cast<std::uint32_t>(run.at("seed").integer(0, UINT32_MAX)),
                                 run.at("overall_miss_pct").number(0, 100)});
    }
    for (auto& [load, times] : measured.times) paces.set(times);
    if (measured.runs.empty()) root.at("runs").fail("a run of networks with the workload's names");
}

}  // namespace urgengo::cli
