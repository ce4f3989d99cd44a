// SPDX-License-Identifier: Apache-2.0
//
// How far a task may be ahead of the GPU, and that a task by itself may be further.
//
// A program that launches long kernels first needs its lead for the short ones behind them: as it
// is no faster than the GPU, what it had to wait is lost (342 launches in 4 ms of CPU and GPU time
// alike: 25 % more; simulated GPU). Who comes overtakes a lead, as it is launched at the second
// priority, but kernel by kernel: a first frame of ten kernels beside others of 0.2 ms took 2.9 ms
// instead of 2.0. So no task leads where a frame of another may be expected.
#include <algorithm>

#include "host/runtime/runtime.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
using abi::TaskSlot;

/// After so long without another task on the GPU, nobody looks at the one that is there.
constexpr nanoseconds kAlone{100'000'000};
/// After so long, and so many periods of each chain, nobody is expected either.
constexpr nanoseconds kSolitary{1'000'000'000};
constexpr int kSolitaryPeriods = 2;
/// Of two levels the other one is everybody's who has none.
constexpr int kFewLevels = 2;
/// Most unknown kernels count for several times what they take: where they are launched slowly, so
/// many times as much may be under way as of known ones.
constexpr int kUnknownSlack = 2;
/// Run-ahead of a launch-bound task, in run_ahead.
constexpr int kLaunchBoundAhead = 4;

}  // namespace

nanoseconds Runtime::solitary_after(const std::vector<config::Chain>& chains) {
    nanoseconds after = kSolitary;
    for (const config::Chain& chain : chains)
        after = std::max(after, kSolitaryPeriods * chain.period);
    return after;
}

// By a task that comes to the GPU. Chains that never meet there are no leaders, either: the next
// frame of the other one may come at any time.
void Runtime::note_who_comes(const TaskState& task, nanoseconds now) {
    const sched::GovernedChain* last = last_chain_.load(kRelaxed);
    if (last != task.chain) last_chain_.store(task.chain, kRelaxed);
    if (last && last != task.chain) others_at_.store(now, kRelaxed);
    note_company(now);
}

void Runtime::note_company(nanoseconds now) {
    if (is_alone()) return;
    shared_at_.store(now, kRelaxed);
    others_at_.store(now, kRelaxed);
}

bool Runtime::nobody_looks(nanoseconds now) const {
    return is_alone() && now - shared_at_.load(kRelaxed) > kAlone;
}

// Only where its launches can be below those of who comes and is more urgent.
bool Runtime::leads(const TaskState& task, nanoseconds now) const {
    return scheduler_.run_ahead_alone > scheduler_.run_ahead &&
           scheduler_.binding == config::Binding::kKernel && is_alone() &&
           now - others_at_.load(kRelaxed) > solitary_after_ && num_levels(task) > kFewLevels;
}

// A fork is not paced, as no mark shows how far it is. So it is taken for a lead from where it
// would have been: else who comes and is more urgent had to wait for all of it.
bool Runtime::forks_ahead(const TaskState& task) const {
    return follows_marks() && !task.graph.vouches() &&
           task.launched - task.marked > task.planned(scheduler_.run_ahead) &&
           scheduler_.binding == config::Binding::kKernel && num_levels(task) > kFewLevels;
}

// Who comes and is less urgent than a leader is its second, at the level of what that one has under
// way, which it must not delay either.
Runtime::Levels Runtime::levels_for(const TaskState& task, const sched::Decision& decision,
                                    int level, int levels, nanoseconds now) {
    if (leads(task, now) || forks_ahead(task)) {
        led_from_.store(task.launched, kRelaxed);
        leader_.store(&task, kRelaxed);
        return {.first = 1, .level = std::max(level, 1)};
    }
    const TaskState* leader = leader_.load(kRelaxed);
    if (leader && decision.before.contains(leader->index) && lead_is_under_way(*leader)) {
        level = std::min(level + 1, levels - 1);
        return {.first = level, .level = level};
    }
    // The last level is that of most programs' streams, and of bystanders.
    if (bystanders_.are_busy() && levels > kFewLevels) level = std::min(level, levels - 2);
    return {.first = 0, .level = level};
}

// What went unasked since the last launch that was asked about may have been launched in the lead.
bool Runtime::lead_is_under_way(const TaskState& leader) const {
    const TaskSlot& slot = *leader.slot;
    const std::uint32_t done = slot.marks_done.load(kRelaxed);
    const nanoseconds executed(slot.launched_at_mark_ns[done % abi::kMarkRing].load(kRelaxed));
    return executed <= led_from_.load(kRelaxed) + leader.planned(scheduler_.run_ahead_alone);
}

// By its plan. The GPU waits for such a program, which is hardly ever ahead of it; so it is not
// made to wait for a mark to tell that (and, in an interpreter, for the other threads' turns).
bool Runtime::is_launch_bound(const TaskState& task) {
    return 2 * task.idle_time_ns.load(kRelaxed) > task.gpu_time_ns.load(kRelaxed);
}

int Runtime::unknown_slack(const TaskState& task) {
    return task.plan.is_empty() ? kUnknownSlack : 1;
}

// A slow program's launches are few at a time on their way to the GPU. When it turns out to be slow
// no more, it is marked, and must not wait for that mark before it has had its time.
nanoseconds Runtime::run_ahead(const TaskState& task, nanoseconds now) const {
    const bool more = is_alone() && (task.is_slow || task.run.was_slow);
    const int times = more                    ? 2 * unknown_slack(task)
                      : is_launch_bound(task) ? kLaunchBoundAhead
                                              : 1;
    const nanoseconds usual = times * scheduler_.run_ahead;
    return task.planned(leads(task, now) ? std::max(usual, scheduler_.run_ahead_alone) : usual);
}

}  // namespace urgengo::runtime
