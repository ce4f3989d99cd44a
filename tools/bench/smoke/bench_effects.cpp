// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bench_effects.h"

#include <algorithm>
#include <map>
#include <random>

#include "tools/bench/smoke/bench_plan.h"

namespace urgengo::cli {
namespace {

/// The same seed of all rows, in the order of rows.
using Peers = std::vector<const RunResult*>;

std::vector<Peers> peers_at(const BenchResults& results, double f_a) {
    std::map<std::uint32_t, std::map<std::string, const RunResult*>> by_seed;
    for (const RunResult& run : results.runs)
        if (run.f_a == f_a) by_seed[run.seed][run.row] = &run;
    std::vector<Peers> all;
    for (const auto& [seed, by_row] : by_seed) {
        Peers peers;
        for (const std::string& row : results.rows) {
            const auto run = by_row.find(row);
            if (run == by_row.end() || run->second->num_blocks() == 0) return {};
            peers.push_back(run->second);
        }
        all.push_back(std::move(peers));
    }
    return all;
}

double miss_pct(const RunResult& run, const std::vector<std::size_t>& drawn) {
    double sum = 0;
    int counted = 0;
    for (const ChainResult& chain : run.chains) {
        unsigned frames = 0, missed = 0;
        for (const std::size_t block : drawn) {
            if (block >= chain.blocks.size()) continue;
            frames += chain.blocks[block].frames;
            missed += chain.blocks[block].missed;
        }
        if (frames == 0) continue;
        sum += static_cast<double>(missed) / frames;
        ++counted;
    }
    return counted == 0 ? 0 : 100 * sum / counted;
}

/// @returns of each row, the mean over as many runs as there are, drawn
std::vector<double> draw(const std::vector<Peers>& all, std::mt19937_64& random) {
    std::vector<double> means(all.front().size());
    std::vector<std::size_t> drawn;
    for (std::size_t i = 0; i < all.size(); ++i) {
        const Peers& peers = all[random() % all.size()];
        std::size_t num_blocks = 0;
        for (const RunResult* run : peers) num_blocks = std::max(num_blocks, run->num_blocks());
        drawn.resize(num_blocks);
        for (std::size_t& block : drawn) block = random() % num_blocks;
        for (std::size_t row = 0; row < peers.size(); ++row)
            means[row] += miss_pct(*peers[row], drawn) / static_cast<double>(all.size());
    }
    return means;
}

Interval interval(double value, std::vector<double> draws) {
    std::sort(draws.begin(), draws.end());
    const auto at = [&](double share) {
        return draws[static_cast<std::size_t>(share * static_cast<double>(draws.size() - 1) + 0.5)];
    };
    return {value, at(0.025), at(0.975)};
}

void add_level(const BenchResults& results, double f_a, std::vector<Effect>& list) {
    const std::vector<Peers> all = peers_at(results, f_a);
    if (all.empty()) return;
    std::mt19937_64 random(1);
    std::vector<std::vector<double>> draws;
    for (int i = 0; i < kResamples; ++i) draws.push_back(draw(all, random));
    const auto mean = [&](std::size_t row) {
        double sum = 0;
        for (const Peers& peers : all) sum += peers[row]->miss_pct;
        return sum / static_cast<double>(all.size());
    };
    const auto of_draws = [&](const auto& value) {
        std::vector<double> values;
        for (const std::vector<double>& one : draws) values.push_back(value(one));
        return values;
    };
    const std::string reference = reference_row(results);
    const auto base = static_cast<std::size_t>(
        std::find(results.rows.begin(), results.rows.end(), reference) - results.rows.begin());
    for (std::size_t row = 0; row < results.rows.size(); ++row) {
        Effect effect{results.rows[row],
                      f_a,
                      interval(mean(row), of_draws([&](const auto& one) { return one[row]; })),
                      {}};
        if (!reference.empty() && row != base)
            effect.difference =
                interval(mean(row) - mean(base),
                         of_draws([&](const auto& one) { return one[row] - one[base]; }));
        list.push_back(std::move(effect));
    }
}

}  // namespace

std::string reference_row(const BenchResults& results) {
    for (const std::string& row : results.rows)
        if (!parse_row(row).preset.empty()) return row;
    return {};
}

std::vector<Effect> effects(const BenchResults& results) {
    std::vector<Effect> list;
    for (const double f_a : results.levels) add_level(results, f_a, list);
    return list.size() == results.levels.size() * results.rows.size() ? list
                                                                      : std::vector<Effect>{};
}

}  // namespace urgengo::cli
