// SPDX-License-Identifier: Apache-2.0
#include "host/progress/positions.h"

#include <algorithm>

#include "host/base/memory_orders.h"
#include "host/model/slot_view.h"

namespace urgengo::progress {
namespace {

// Of async: whatever was launched.
void take_for_executed(model::Position& at, const model::LaunchLog& log, std::uint32_t count) {
    const model::LoggedLaunch newest = log.at(count - 1);
    at = {.launch = count,
          .position = newest.position + 1,
          .instance = newest.instance,
          .executed = log.end(count - 1),
          .uncertain = at.uncertain};
}

}  // namespace

std::optional<Positions::Seen> Positions::saw_mark(const FollowedTask& task,
                                                   const ug_mark_line& line, nanoseconds pending,
                                                   bool shared) {
    const auto mark = model::read_mark(line, task.slot.marks_issued.load(kAcquire));
    if (!mark) return std::nullopt;
    return Seen{*mark, learn_time(task, line, *mark, pending, shared)};
}

std::optional<nanoseconds> Positions::learn_time(const FollowedTask& task, const ug_mark_line& line,
                                                 const model::ExecutedMark& mark,
                                                 nanoseconds pending, bool shared) {
    const nanoseconds seen = clock_.now();  // after the look
    if (mark.stamp == UG_MARK_NO_TIME) return std::nullopt;
    nanoseconds time;
    if (__atomic_load_n(&line.clock, __ATOMIC_ACQUIRE) == UG_MARK_CLOCK_HOST) {
        const auto seen_ns = static_cast<std::uint64_t>(seen.count());
        time = seen - nanoseconds(model::stamp_difference(seen_ns, mark.stamp));
    } else {
        // Marks wait behind work: when a mark was last seen not executed says more of when it ran
        // than when it was launched does.
        const nanoseconds since =
            std::max(task.log.mark_time(mark.sequence), pending - mark_visible_);
        const bool due = seen - fed_.load(std::memory_order_relaxed) >= kFeedClockEvery;
        if ((due || seen - since < kTellsClock) &&
            task.log.still_holds(task.log.count(), mark.sequence)) {
            fed_.store(seen, std::memory_order_relaxed);
            gpu_clock_.add({mark.stamp, since, seen});
        }
        const auto host = gpu_clock_.to_host(mark.stamp);
        if (!host) return std::nullopt;
        time = host->time;
    }
    if (follows_marks_) task.pace.saw(task.log, {mark.sequence, time}, shared);
    return time;
}

// When the newest executed mark ran: by its stamp, else when it was first seen, else just now.
model::SeenMark Positions::last_mark(const FollowedTask& task, bool shared, nanoseconds now) {
    const abi::TaskSlot& slot = task.slot;
    // First, so that it is about the mark after `done`, or about an earlier one.
    const nanoseconds pending(task.pending_ns.load(kAcquire));
    const std::uint32_t done = slot.marks_done.load(kAcquire);
    nanoseconds progress(slot.progress_ns.load(kAcquire));
    // With the first mark after all were seen, the slot forgets when the last of those was. What
    // has been launched since began when it was launched, more often than not.
    if (task.log.last_mark() != done && progress >= task.log.mark_time(done + 1))
        progress = task.log.mark_time(done);
    const ug_mark_line* line = task.line.load(kAcquire);
    const auto mark = line ? model::read_mark(*line, slot.marks_issued.load(kAcquire))
                           : std::optional<model::ExecutedMark>{};
    // Never back: marks of two streams may arrive out of order.
    if (!mark || static_cast<std::int32_t>(done - mark->sequence) > 0)
        return {done, std::min(progress, now)};
    const bool is_new = mark->sequence != done;
    const nanoseconds since = is_new ? pending : nanoseconds{0};
    const nanoseconds seen = is_new ? now : progress;
    const nanoseconds time = learn_time(task, *line, *mark, since, shared).value_or(seen);
    const nanoseconds launched = task.log.mark_time(mark->sequence);
    return {mark->sequence, std::min(std::max(time, launched), now)};
}

std::optional<TaskPosition> Positions::locate(const FollowedTask& task, bool shared,
                                              nanoseconds now) {
    const abi::TaskSlot& slot = task.slot;
    const model::LaunchLog& log = task.log;
    for (int attempt = 0; attempt < 4; ++attempt) {
        const std::uint32_t count = log.count();
        if (count == 0) return std::nullopt;
        const nanoseconds logged = log.end(count - 1);
        // Launches that went as planned are in the slot at once, in the log later.
        const std::uint32_t from = task.planned_from.load(kAcquire);
        const nanoseconds launched(slot.launched_ns.load(kAcquire));
        const nanoseconds head(slot.head_remaining_ns.load(kAcquire));
        const nanoseconds unlogged = std::max(launched - logged, nanoseconds{0});
        const model::SeenMark seen = last_mark(task, shared, now);
        // The paper's ways of tracking know nothing between their synchronisations.
        const nanoseconds unknown = follows_marks_ ? nanoseconds{0} : now - seen.time;
        const model::Tempo tempo{task.pace.expected(shared), unknown, shared};
        auto at = model::locate(log, seen, tempo, now, unlogged);
        if (!at || log.count() != count) continue;
        if (is_async_) take_for_executed(*at, log, count);
        // Which one of them, the plan says.
        if (at->executed > logged) {
            nanoseconds end = logged;
            const std::size_t planned = task.plan.num_kernels();
            for (std::size_t i = from; planned == 0 || i < planned; ++i) {
                end += planned == 0 ? kUnknownKernel : task.plan.at(i).gpu_time;
                if (end > at->executed || end >= launched) break;
                ++at->launch;
                ++at->position;
            }
            if (at->executed >= launched) ++at->launch, ++at->position;  // behind the last
        }
        return TaskPosition{*at, model::corrected(slot, at->unexecuted + head)};
    }
    return std::nullopt;
}

}  // namespace urgengo::progress
