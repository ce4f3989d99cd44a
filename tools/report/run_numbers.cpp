// SPDX-License-Identifier: Apache-2.0
#include "tools/report/run_numbers.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace urgengo::report {
namespace {

constexpr std::size_t kMostBins = 60;
constexpr double kSteps_s[] = {0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600};

/// A frame that is over.
struct Outcome {
    std::size_t chain;
    std::int64_t arrival_ns, end_ns;
    abi::MissCause cause;

    bool missed() const { return cause != abi::MissCause::kNone; }
};

/// @returns frames that are over, in the order of their arrivals
std::vector<Outcome> outcomes_of(const trace::RunStory& story) {
    std::vector<Outcome> outcomes;
    for (const trace::RunFrame& frame : story.frames)
        if (frame.has_ended)
            outcomes.push_back({frame.chain, frame.arrival_ns, frame.end_ns, frame.cause});
    for (const trace::RunRecord& point : story.points)
        if (point.kind == trace::RunKind::kFrameDropped)
            outcomes.push_back({static_cast<std::size_t>(point.chain), point.time_ns, point.time_ns,
                                abi::MissCause::kDropped});
    std::stable_sort(outcomes.begin(), outcomes.end(), [](const Outcome& a, const Outcome& b) {
        return a.arrival_ns < b.arrival_ns;
    });
    return outcomes;
}

double bin_length_s(double seconds) {
    for (const double step : kSteps_s)
        if (seconds <= step * kMostBins) return step;
    return std::ceil(seconds / kMostBins);
}

std::vector<TimeBin> bins_of(const trace::Run& run, const std::vector<Outcome>& outcomes,
                             double bin_s, double seconds) {
    const auto count = static_cast<std::size_t>(std::max(1.0, std::ceil(seconds / bin_s)));
    std::vector<TimeBin> bins(count);
    std::vector<std::map<abi::MissCause, std::size_t>> missed(count);
    const auto bin_at = [&](std::int64_t ns) {
        const double at_s = 1e-9 * static_cast<double>(ns - run.first_ns());
        return std::min(count - 1, static_cast<std::size_t>(std::max(0.0, at_s / bin_s)));
    };
    for (const Outcome& outcome : outcomes) {
        const std::size_t bin = bin_at(outcome.end_ns);
        ++bins[bin].over;
        if (outcome.missed()) ++missed[bin][outcome.cause];
    }
    for (std::size_t i = 0; i < count; ++i) {
        bins[i].begin_s = static_cast<double>(i) * bin_s;
        bins[i].missed.assign(missed[i].begin(), missed[i].end());
    }
    return bins;
}

/// CPU time of the process at a time, as recorded now and then.
struct CpuUse {
    std::int64_t time_ns, cpu_ns;
};

std::vector<CpuUse> cpu_uses(const trace::RunStory& story) {
    std::vector<CpuUse> uses;
    for (const trace::RunRecord& point : story.points)
        if (point.kind == trace::RunKind::kCpuUse)
            uses.push_back({point.time_ns, point.cpu.used_ns});
    return uses;
}

double cores_between(const CpuUse& a, const CpuUse& b) {
    if (b.time_ns <= a.time_ns || b.cpu_ns < a.cpu_ns) return -1;
    return static_cast<double>(b.cpu_ns - a.cpu_ns) / static_cast<double>(b.time_ns - a.time_ns);
}

/// Each bin's use is that of the two readings around its middle.
void add_cpu_use(const trace::Run& run, const std::vector<CpuUse>& uses, double bin_s,
                 std::vector<TimeBin>& bins) {
    for (TimeBin& bin : bins) {
        const auto middle_ns =
            run.first_ns() + static_cast<std::int64_t>(1e9 * (bin.begin_s + bin_s / 2));
        const auto next = std::find_if(uses.begin(), uses.end(),
                                       [&](const CpuUse& use) { return use.time_ns >= middle_ns; });
        if (next != uses.begin() && next != uses.end())
            bin.cpu_cores = cores_between(*(next - 1), *next);
    }
}

}  // namespace

double ChainNumbers::percentile_ms(double share) const {
    if (latencies_ms.empty()) return 0;
    const auto at = static_cast<std::size_t>(share * static_cast<double>(latencies_ms.size()));
    return latencies_ms[std::min(at, latencies_ms.size() - 1)];
}

RunNumbers measure(const trace::Run& run, const trace::RunStory& story) {
    RunNumbers numbers;
    numbers.seconds = 1e-9 * static_cast<double>(run.last_ns() - run.first_ns());
    std::vector<trace::ChainSummary> summaries = trace::summarize(run, story);
    numbers.chains.resize(summaries.size());
    const std::vector<Outcome> outcomes = outcomes_of(story);
    std::vector<std::vector<bool>> missed(summaries.size());
    std::vector<bool> all_missed;
    for (const Outcome& outcome : outcomes) {
        missed[outcome.chain].push_back(outcome.missed());
        all_missed.push_back(outcome.missed());
    }
    for (const trace::RunFrame& frame : story.frames)
        if (frame.has_ended && !frame.exited)
            numbers.chains[frame.chain].latencies_ms.push_back(trace::to_ms(frame.latency_ns));
    std::size_t with_frames = 0;
    for (std::size_t i = 0; i < summaries.size(); ++i) {
        ChainNumbers& chain = numbers.chains[i];
        chain.summary = std::move(summaries[i]);
        chain.misses = miss_ratio(missed[i]);
        std::sort(chain.latencies_ms.begin(), chain.latencies_ms.end());
        if (missed[i].empty()) continue;
        ++with_frames;
        numbers.mean_miss_ratio += chain.misses.ratio;
    }
    if (with_frames > 0) numbers.mean_miss_ratio /= static_cast<double>(with_frames);
    numbers.misses = miss_ratio(all_missed);
    numbers.bin_s = bin_length_s(numbers.seconds);
    numbers.bins = bins_of(run, outcomes, numbers.bin_s, numbers.seconds);
    numbers.gates = trace::summarize_gates(story);
    const std::vector<CpuUse> uses = cpu_uses(story);
    add_cpu_use(run, uses, numbers.bin_s, numbers.bins);
    if (uses.size() > 1) numbers.cpu_cores = cores_between(uses.front(), uses.back());
    numbers.gpu = gpu_sharing(run, story);
    return numbers;
}

}  // namespace urgengo::report
