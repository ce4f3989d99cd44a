// SPDX-License-Identifier: Apache-2.0
#include "host/progress/batch_tracking.h"

#include <optional>

#include "host/base/memory_orders.h"

namespace urgengo::progress {
namespace {

using config::Tracking;

/// About 1 ms, longer than most batches. In that time a sleep would be noticed.
constexpr int kAsksWithoutPause = 10'000;
/// Batches that were never seen to end take no more than so many places of the ring.
constexpr std::uint32_t kMaxOpen = abi::kMarkRing / 2;

}  // namespace

bool BatchTracking::is_due(const BatchedTask& task) const {
    if (task.batches.waited_in_vain) return false;
    switch (tracking_) {
        case Tracking::kSync: {
            const std::uint32_t issued = task.slot.marks_issued.load(kRelaxed);
            return task.position != task.position_at_mark[issued % abi::kMarkRing];
        }
        case Tracking::kBatched:
        case Tracking::kOverlapped:
            return task.launched - task.marked >= batch_;
        case Tracking::kAsync:
        case Tracking::kProgress:
            break;
    }
    return false;
}

void BatchTracking::begin_segment(const BatchedTask& task) const {
    __atomic_store_n(&task.line.clock, UG_MARK_CLOCK_HOST, __ATOMIC_RELEASE);
    if (tracking_ != Tracking::kAsync) return;
    // The program's wait for the last segment may never have been seen: then that batch goes on.
    std::uint32_t batch = task.slot.marks_issued.load(kRelaxed);
    if (batch == task.batches.published) ++batch;
    task.slot.launched_at_mark_ns[(batch - 1) % abi::kMarkRing].store(task.launched.count(),
                                                                      kRelaxed);
    issue(task, batch);
}

// What the segment is thought to take is kept as the open batch's estimate, so that it is late only
// when the whole of it is.
void BatchTracking::launched(const BatchedTask& task, nanoseconds estimate) const {
    if (tracking_ != Tracking::kAsync) return;
    const std::uint32_t open = task.slot.marks_issued.load(kRelaxed);
    auto& executed = task.slot.launched_at_mark_ns[(open - 1) % abi::kMarkRing];
    auto& end = task.slot.launched_at_mark_ns[open % abi::kMarkRing];
    const std::int64_t segment =
        end.load(kRelaxed) - executed.load(kRelaxed) + std::int64_t{estimate.count()};
    executed.store(task.launched.count() - 1, kRelaxed);
    end.store(task.launched.count() - 1 + segment, kRelaxed);
    task.position_at_mark[(open - 1) % abi::kMarkRing] = task.position;
    task.marked = task.launched;
}

BatchTracking::Outcome BatchTracking::end_batch(const BatchedTask& task, BatchEnds& ends,
                                                nanoseconds bound) const {
    if (tracking_ == Tracking::kAsync || task.batches.waited_in_vain) return Outcome::kFine;
    const std::uint32_t issued = task.slot.marks_issued.load(kRelaxed);
    const std::uint32_t batch = issued - task.batches.published < kMaxOpen ? issued + 1 : issued;
    if (!ends.are_wanted() && issued != task.batches.published &&
        ends.ask(issued) == BatchEnds::Seen::kYes)
        publish(task, issued);
    if (!ends.record(batch)) return Outcome::kRefused;
    issue(task, batch);
    return tracking_ == Tracking::kOverlapped ? Outcome::kFine : wait_for(task, batch, ends, bound);
}

void BatchTracking::end_segment(const BatchedTask& task) const {
    const std::uint32_t issued = task.slot.marks_issued.load(kRelaxed);
    const std::uint32_t batch = issued == task.batches.published ? issued + 1 : issued;
    issue(task, batch);
    publish(task, batch);
}

void BatchTracking::issue(const BatchedTask& task, std::uint32_t batch) const {
    abi::TaskSlot& slot = task.slot;
    task.position_at_mark[batch % abi::kMarkRing] = task.position;
    slot.launched_at_mark_ns[batch % abi::kMarkRing].store(task.launched.count(), kRelaxed);
    if (task.batches.published == batch - 1) slot.progress_ns.store(clock_.now().count(), kRelaxed);
    task.log.marked(nanoseconds(slot.look_ns.load(kRelaxed)), batch);
    slot.marks_issued.store(batch, std::memory_order_release);
    task.marked = task.launched;
}

bool BatchTracking::must_wait(const BatchedTask& task, std::uint32_t still_open) const {
    return tracking_ == Tracking::kOverlapped && !task.batches.waited_in_vain &&
           task.slot.marks_issued.load(kRelaxed) - task.batches.published > still_open;
}

BatchTracking::Outcome BatchTracking::wait(const BatchedTask& task, std::uint32_t still_open,
                                           BatchEnds& ends, nanoseconds bound) const {
    return wait_for(task, task.slot.marks_issued.load(kRelaxed) - still_open, ends, bound);
}

BatchTracking::Outcome BatchTracking::wait_for(const BatchedTask& task, std::uint32_t batch,
                                               BatchEnds& ends, nanoseconds bound) const {
    if (ends.are_wanted()) task.batches.num_waits.fetch_add(1, kRelaxed);
    const nanoseconds begin = clock_.now();
    std::optional<FineTimerSlack> slack;
    for (int asked = 1;; ++asked) {
        const BatchEnds::Seen seen = ends.ask(batch);
        if (seen == BatchEnds::Seen::kYes) {
            publish(task, batch);
            return Outcome::kFine;
        }
        if (seen == BatchEnds::Seen::kRefused) return Outcome::kRefused;
        if (!ends.are_wanted()) return Outcome::kFine;
        if (asked < kAsksWithoutPause) continue;
        const nanoseconds waited = clock_.now() - begin;
        if (waited >= bound) {
            task.batches.waited_in_vain = true;
            return Outcome::kWaitedInVain;
        }
        if (!slack) slack.emplace();
        clock_.sleep_for(asking_interval(waited));
    }
}

// As a mark writes it: first the word that says what, then the one that says when.
void BatchTracking::publish(const BatchedTask& task, std::uint32_t batch) const {
    const auto time_ns = static_cast<std::uint64_t>(clock_.now().count());
    const auto instance =
        static_cast<std::uint16_t>(task.slot.instance.load(std::memory_order_relaxed));
    const std::uint64_t word0 =
        ug_mark_word0(task.position_at_mark[batch % abi::kMarkRing], instance, batch);
    __atomic_store_n(&task.line.word[0], word0, __ATOMIC_RELEASE);
    __atomic_store_n(&task.line.word[1], ug_mark_word1(time_ns, batch), __ATOMIC_RELEASE);
    task.batches.published = batch;
}

}  // namespace urgengo::progress
