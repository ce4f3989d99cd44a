// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/report.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "host/base/memory_orders.h"

namespace urgengo::runtime {
namespace {

/// More launches than this share of a chain's that the profile does not know: it is of something
/// else.
constexpr double kUnknownShare = 0.05;
constexpr double kEnoughLaunches = 100;
/// GPU times that were this many times longer or shorter than the profile's: it is worth a new one.
constexpr double kWrongProfile = 1.25;
/// Of the time: bystanders, or cores, that were busy for more are worth a line.
constexpr double kWorthSaying = 0.1;
constexpr std::uint32_t kEnoughWindows = 20;  // of sched::CoreLoad: 5 s in which threads slept
/// So many frames that started late, and this share of all, are worth a word.
constexpr double kManyLateStarts = 10, kLateStartShare = 0.05;

}  // namespace

std::vector<const observe::ChainStatistics*> Report::statistics() {
    around_.instances.drop_late(around_.clock.now());
    const std::vector<const char*> guarded = around_.guard.words();
    const std::vector<sched::GuardedChain> found = around_.guard.found();
    std::vector<const observe::ChainStatistics*> all;
    for (const auto& chain : around_.chains) {
        observe::ChainStatistics& s = chain->statistics;
        s.frames.misses_in_a_row = chain->misses_in_a_row.load(kRelaxed);
        const auto sum = [&](auto& total, auto counter) {
            total = 0;
            for (const int index : chain->tasks)
                total += (around_.tasks[static_cast<std::size_t>(index)]->counters.*counter)
                             .load(kRelaxed);
        };
        sum(s.tasks.launches, &TaskCounters::launches);
        sum(s.tasks.scheduled, &TaskCounters::scheduled);
        s.as_planned = 0;
        s.copies_cut = 0;
        s.synchronisations = 0;
        for (const int index : chain->tasks) {
            const TaskState& task = *around_.tasks[static_cast<std::size_t>(index)];
            s.tasks.launches += task.unasked.uncounted(*task.slot);
            s.tasks.scheduled += task.uncounted_scheduled();
            s.as_planned += task.num_as_planned();
            s.copies_cut += task.copies.num_cut.load(kRelaxed);
            s.synchronisations += task.batches.num_waits.load(kRelaxed);
        }
        s.guard = guarded[chain->index];
        s.guard_found = {sched::to_word(found[chain->index].compared), found[chain->index].last};
        if (around_.causes) s.causes = around_.causes->counts(*chain);
        sum(s.tasks.marks, &TaskCounters::marks);
        sum(s.tasks.marks_refused, &TaskCounters::marks_refused);
        sum(s.tasks.holds, &TaskCounters::holds);
        sum(s.tasks.holds_opened, &TaskCounters::holds_opened);
        sum(s.tasks.held_ns, &TaskCounters::held_ns);
        sum(s.tasks.paced_ns, &TaskCounters::paced_ns);
        sum(s.tasks.unknown, &TaskCounters::unknown);
        sum(s.tasks.implicit_syncs, &TaskCounters::implicit_syncs);
        sum(s.tasks.lent, &TaskCounters::lent);
        all.push_back(&s);
    }
    return all;
}

void Report::lost_streams(Lines& lines) const {
    for (const auto& task : around_.tasks)
        if (task->streams.were_lost.load(kRelaxed))
            lines.push_back(
                fmt::format("warning: task '{}' of chain '{}' uses more than {} streams "
                            "at a time: they are not followed",
                            task->name(), task->chain->config.name, progress::kMaxStreams));
}

void Report::unmatched_tasks(Lines& lines) const {
    std::vector<std::string> unmatched;
    const std::vector<std::string> seen = around_.names.unmatched();
    std::uint64_t launches = 0;
    for (const auto& task : around_.tasks) {
        launches += task->counters.launches.load(kRelaxed);
        if (task->known_by.matched.load(kRelaxed)) continue;
        const config::Task& match = task->known_by.config;
        unmatched.push_back(
            fmt::format("'{}' of chain '{}' ({})", task->name(), task->chain->config.name,
                        !match.thread_glob.empty() ? "thread: '" + match.thread_glob + "'"
                        : !match.nvtx_glob.empty() ? "nvtx: '" + match.nvtx_glob + "'"
                        : !match.kernels.empty()   ? "kernels: '" + match.kernels[0].name_glob + "'"
                                                   : std::string("hints only")));
    }
    if (!unmatched.empty() && (launches > 0 || !seen.empty()))
        lines.push_back(fmt::format(
            "warning: nothing matched task {}; threads that launched and matched nothing: {}",
            fmt::join(unmatched, ", "),
            seen.empty() ? "none" : fmt::format("'{}'", fmt::join(seen, "', '"))));
}

// Why no launch was held for a while, or at all.
void Report::stopped_holding(Lines& lines) const {
    if (around_.guard.has_fallen_back()) lines.push_back("warning: " + around_.guard.summary());
    if (const std::uint32_t ends = around_.governor.polls().num_ends(); ends > 0)
        lines.push_back(fmt::format(
            "warning: looks of held launches took more than {:.0f} % of a core, so no launch was "
            "held for a second: {} times",
            100 * sched::PollBudget::kShare, ends));
    if (const std::uint32_t jumps = num_jumps_.load(kRelaxed); jumps > 0)
        lines.push_back(fmt::format(
            "warning: the program jumped out of a held launch (siglongjmp): {} times", jumps));
}

void Report::of_chain(const observe::ChainStatistics& chain, Lines& lines) {
    const auto scheduled = static_cast<double>(chain.tasks.scheduled.load(kRelaxed));
    const auto unknown = static_cast<double>(chain.tasks.unknown.load(kRelaxed));
    if (const auto implausible = chain.frames.implausible.load(kRelaxed); implausible > 0)
        lines.push_back(fmt::format(
            "warning: {} of {} arrivals that hints told of chain '{}' are implausible (another "
            "clock?): the time of the call was taken instead",
            implausible, chain.frames.instances.load(kRelaxed), chain.name));
    const auto late = static_cast<double>(chain.frames.late_starts.load(kRelaxed));
    if (late >= kManyLateStarts &&
        late > kLateStartShare * static_cast<double>(chain.frames.instances.load(kRelaxed)))
        lines.push_back(fmt::format(
            "warning: {:.0f} of {} frames of chain '{}' started late, by more than their "
            "arrivals vary: a lock, a sensor or a slow thread; misses are counted from a "
            "frame's start",
            late, chain.frames.instances.load(kRelaxed), chain.name));
    if (scheduled < kEnoughLaunches || unknown <= kUnknownShare * scheduled) return;
    lines.push_back(
        fmt::format("warning: the profile does not know {:.0f} % of the launches of chain "
                    "'{}': run `urgengo profile` again",
                    100 * unknown / scheduled, chain.name));
}

void Report::wrong_times(Lines& lines) const {
    for (const auto& task : around_.tasks) {
        const std::uint32_t ppm = task->slot->factor_ppm.load(kRelaxed);
        const double factor = ppm == 0 ? 1 : ppm * 1e-6;
        if (task->plan.is_empty() || (factor < kWrongProfile && factor * kWrongProfile > 1))
            continue;
        lines.push_back(
            fmt::format("warning: GPU times of task '{}' of chain '{}' were {:.2f} times what the "
                        "profile says, "
                        "and were corrected: run `urgengo profile` again",
                        task->name(), task->chain->config.name, factor));
    }
}

void Report::busy_cores(Lines& lines) const {
    if (!around_.cores || around_.has_nice) return;
    const auto [windows, busy] = around_.cores->counts();
    if (windows < kEnoughWindows || busy <= kWorthSaying * windows) return;
    lines.push_back(fmt::format(
        "warning: the host's cores were busy: threads that were held woke up late in {:.0f} % of "
        "the run. `cpu: {{nice: -15}}` lets the threads of chains go before others",
        100.0 * busy / windows));
}

observe::BystanderStatistics Report::bystanders() const {
    const auto counts = around_.governor.bystanders().counts();
    constexpr double kWindow_s = std::chrono::duration<double>(sched::Bystanders::kWindow).count();
    return {counts.windows * kWindow_s, counts.often * kWindow_s, counts.busy * kWindow_s};
}

std::vector<std::string> Report::warnings() {
    Lines lines;
    lost_streams(lines);
    unmatched_tasks(lines);
    stopped_holding(lines);
    for (const observe::ChainStatistics* chain : statistics()) of_chain(*chain, lines);
    wrong_times(lines);
    busy_cores(lines);
    if (const auto seen = bystanders(); seen.busy_s > kWorthSaying * seen.seconds)
        lines.push_back(
            fmt::format("warning: work of no chain kept the GPU busy for {:.0f} % of the time. No "
                        "launch was held then; streams had their priorities alone. Make this work "
                        "a chain of the config to have it give way to others",
                        100 * seen.busy_s / seen.seconds));
    return lines;
}

}  // namespace urgengo::runtime
