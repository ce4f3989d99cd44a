// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/governed_marks.h"

#include <algorithm>

#include "host/config/progress_choice.h"

namespace urgengo::sim {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
using abi::TaskSlot;

/// What a mark takes of its stream, and of the thread.
struct MarkCost {
    nanoseconds gpu, cpu;
};
/// @source measured on an H200, per mark in a chain of 400 kernels: a one-thread kernel with
///         programmatic serialisation, a write of mapped memory, an event without timing
MarkCost cost_of(config::ProgressSource source) {
    switch (config::choose_source(source)) {
        case config::ProgressSource::kMemop:
            return {nanoseconds{2'000}, nanoseconds{700}};
        case config::ProgressSource::kEvent:
            return {nanoseconds{0}, nanoseconds{300}};
        case config::ProgressSource::kKernel:
        case config::ProgressSource::kAuto:
            break;
    }
    return {nanoseconds{830}, nanoseconds{2'200}};
}

std::int64_t tag_of(const SimTask& task, std::uint32_t sequence) {
    return std::int64_t{task.index + 1} << 32 | sequence;
}

std::uint16_t instance_tag(const TaskSlot& slot) {
    return static_cast<std::uint16_t>(slot.instance.load(kRelaxed));
}

}  // namespace

nanoseconds GovernedMarks::every(const SimTask& task, nanoseconds now) const {
    const nanoseconds every =
        config::mark_every(program_.scheduler(), config::ProgressSource::kKernel);
    return program_.governor.ahead().mark_spacing.between(task, every, now);
}

bool GovernedMarks::is_due(const SimTask& task, nanoseconds now) const {
    switch (program_.scheduler().progress.tracking) {
        case config::Tracking::kProgress:
            return task.work.launched - task.work.looked >= every(task, now);
        case config::Tracking::kSync: {
            const std::uint32_t issued = task.slot->marks_issued.load(kRelaxed);
            return task.run.position != task.run.position_at_mark[issued % abi::kMarkRing];
        }
        case config::Tracking::kBatched:
        case config::Tracking::kOverlapped:
        case config::Tracking::kAsync:
            break;
    }
    return task.work.launched - task.work.marked >= program_.scheduler().progress.eval_interval;
}

bool GovernedMarks::marks_at_once(const SimTask& task, nanoseconds last) const {
    return !are_followed() || !program_.governor.company().is_alone() ||
           last >= program_.governor.ahead().mark_spacing.long_unit(task);
}

nanoseconds GovernedMarks::emit(SimTask& task, nanoseconds now) {
    TaskSlot& slot = *task.slot;
    const std::uint32_t sequence = slot.marks_issued.load(kRelaxed) + 1;
    const int chain = static_cast<int>(task.chain->index);
    if (!are_followed()) {
        const MarkCost cost = cost_of(config::ProgressSource::kEvent);
        port_->mark(chain, task.branch, cost.gpu, tag_of(task, sequence));
        issue(task, sequence, now);
        return cost.cpu;
    }
    if (sched::MarkSpacing::ring_is_full(slot)) return nanoseconds{0};
    const MarkCost cost = cost_of(program_.scheduler().progress.source);
    port_->mark(chain, task.branch, cost.gpu, tag_of(task, sequence));
    if (slot.marks_done.load(kRelaxed) == sequence - 1)
        slot.progress_ns.store(now.count(), kRelaxed);
    issue(task, sequence, now);
    sched::GovernedRun& run = task.run;
    run.mark.at = now;
    run.mark.waited = run.waited.paced + run.waited.held;
    program_.governor.estimates().sees_launchers(task, now);
    return cost.cpu;
}

void GovernedMarks::issue(SimTask& task, std::uint32_t sequence, nanoseconds now) {
    TaskSlot& slot = *task.slot;
    task.run.position_at_mark[sequence % abi::kMarkRing] = task.run.position;
    slot.launched_at_mark_ns[sequence % abi::kMarkRing].store(task.work.launched.count(), kRelaxed);
    if (!are_followed() && task.published == sequence - 1)
        slot.progress_ns.store(now.count(), kRelaxed);
    slot.marks_issued.store(sequence, kRelaxed);
    task.work.marks_all();
}

GovernedMarks::Ended GovernedMarks::ended(std::int64_t tag, nanoseconds now) {
    SimTask& task = program_.task(static_cast<int>(tag >> 32) - 1);
    task.ended = static_cast<std::uint32_t>(tag);
    if (are_followed()) on_the_way_.push_back({now + late_, tag});
    return {task, task.ended};
}

void GovernedMarks::deliver(nanoseconds now) {
    for (; !on_the_way_.empty() && on_the_way_.front().at <= now; on_the_way_.pop_front()) {
        const auto [at, tag] = on_the_way_.front();
        write(program_.task(static_cast<int>(tag >> 32) - 1), static_cast<std::uint32_t>(tag),
              at - late_);
    }
}

void GovernedMarks::write(SimTask& task, std::uint32_t sequence, nanoseconds time) {
    task.mark_line.word[0] = ug_mark_word0(task.run.position_at_mark[sequence % abi::kMarkRing],
                                           instance_tag(*task.slot), sequence);
    task.mark_line.word[1] = ug_mark_word1(static_cast<std::uint64_t>(time.count()), sequence);
}

// --- batches

std::int64_t GovernedMarks::batch_to_wait_for(SimTask& task, bool is_held, nanoseconds now) {
    if (are_followed()) return 0;
    const bool may_overlap =
        program_.scheduler().progress.tracking == config::Tracking::kOverlapped;
    const std::uint32_t still_open = may_overlap && !is_held ? 1 : 0;
    const std::uint32_t issued = task.slot->marks_issued.load(kRelaxed);
    if (issued - task.published <= still_open) return 0;
    task.awaited_batch = issued - still_open;
    if (task.ended < task.awaited_batch) return tag_of(task, task.awaited_batch);
    batch_ended(task, now);
    return 0;
}

void GovernedMarks::batch_ended(SimTask& task, nanoseconds now) {
    task.published = task.awaited_batch;
    task.awaited_batch = 0;
    write(task, task.published, now);
}

void GovernedMarks::segment_ended(SimTask& task, nanoseconds now) {
    if (are_followed()) return;
    std::uint32_t sequence = task.slot->marks_issued.load(kRelaxed);
    if (sequence == task.published) issue(task, ++sequence, now);
    task.published = task.ended = sequence;
    write(task, sequence, now);
}

}  // namespace urgengo::sim
