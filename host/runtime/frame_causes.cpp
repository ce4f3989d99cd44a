// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/frame_causes.h"

#include <algorithm>
#include <new>
#include <utility>

#include "host/base/memory_orders.h"
#include "host/runtime/task_pieces.h"

namespace urgengo::runtime {
namespace {

/// Where a CPU segment is longer by less, nothing is asked about it.
constexpr nanoseconds kWorthAsking{500'000};

nanoseconds positive(nanoseconds time) {
    return std::max(time, nanoseconds{0});
}

nanoseconds deadline_of(const TaskState& task) {
    return nanoseconds(task.slot->deadline_ns.load(kRelaxed));
}

/// By the profile, of which the estimate moves away.
nanoseconds cpu_time_of(const TaskState& task, std::size_t segment) {
    const std::vector<nanoseconds>& known = task.facts.cpu_times;
    const nanoseconds profiled = segment < known.size() ? known[segment] : nanoseconds{0};
    return profiled.count() > 0 ? profiled : task.record.cpu.estimate(segment);
}

nanoseconds end_of(const GpuWindows::Segment& segment, nanoseconds now) {
    return segment.end.count() != 0 ? segment.end : now;
}

nanoseconds launched(const TaskState& task) {
    return task.log.end(task.log.count() - 1);
}

/// What measurement multiplies the task's plan by.
double factor_of(const TaskState& task) {
    const double factor = task.slot->factor_ppm.load(kRelaxed) * 1e-6;
    return factor > 0 ? factor : 1;
}

std::vector<GpuWindows::Segment> segments_between(const TaskState& task, nanoseconds begin,
                                                  nanoseconds end) {
    std::vector<GpuWindows::Segment> segments;
    task.facts.windows.for_each([&](const GpuWindows::Segment& segment) {
        if (segment.begin < end && end_of(segment, end) > begin) segments.push_back(segment);
    });
    return segments;
}

/// Neighbours become one, so that all of their work is still known. The last one's instance counts.
void join(std::vector<GpuWindows::Segment>& segments, std::size_t most) {
    if (segments.size() <= most) return;
    const std::size_t each = (segments.size() + most - 1) / most;
    std::size_t num = 0;
    for (std::size_t i = 0; i < segments.size(); ++i) {
        GpuWindows::Segment next = segments[i];
        if (i % each == 0) {
            segments[num++] = next;
            continue;
        }
        GpuWindows::Segment& all = segments[num - 1];
        next.begin = all.begin;
        next.first_work = all.first_work;
        next.first_priority = std::min(next.first_priority, all.first_priority);
        all = next;
    }
    segments.resize(num);
}

}  // namespace

void FrameCauses::take_roster() {
    chains_ = std::vector<Chain>(roster_.chains().size());
    for (Chain& chain : chains_)
        chain.counted =
            std::vector<std::atomic<std::uint64_t>>(observe::kNumCauses * (chains_.size() + 1));
    for (const auto& task : roster_.tasks()) {
        if (!task->plan.is_empty()) task->facts.cpu_times = task->plan.cpu_segments();
    }
}

// --- told

// Without hints the frame has arrived as long before as the thread has computed for it.
void FrameCauses::run_begins(TaskState& task, nanoseconds now) const {
    task.facts.run = {};
    task.facts.waits_for.store(-1, kRelaxed);
    RunFacts& facts = task.facts.run;
    facts.was_off = !is_acted_on(task);
    if (task.stage != 0) return;
    // While its task was at the frame before, nothing of this one could begin.
    const nanoseconds after = now - task.tracked.arrival;
    const nanoseconds busy =
        std::clamp(task.facts.ended_at - task.tracked.arrival, nanoseconds{0}, after);
    facts.began_late = busy;
    if (task.tracked.hinted)
        facts.began_late += task.facts.start.saw(after - busy);
    else
        cpu_segment_ended(task, after - busy, now);
}

void FrameCauses::cpu_segment_begins(TaskState& task, nanoseconds now) const {
    if (task.plan.is_empty()) return;
    task.facts.run.cpu_begin = {now, clock_.thread_use(), pthread_self()};
    task.facts.run.cpu_took = nanoseconds{0};
}

void FrameCauses::cpu_segment_ended(TaskState& task, nanoseconds took, nanoseconds now) const {
    const nanoseconds known = cpu_time_of(task, task.tracker.segment());
    RunFacts& facts = task.facts.run;
    const nanoseconds longer = known.count() > 0 ? positive(took - known) : nanoseconds{0};
    add_cpu(facts, longer, slept_since(facts.cpu_begin, longer, now));
    facts.cpu_took = took;
}

void FrameCauses::add_cpu(RunFacts& facts, nanoseconds longer, nanoseconds slept) {
    const nanoseconds outside = std::min(longer, slept);
    facts.outside += outside;
    facts.cpu_longer += longer - outside;
}

// A thread that has not left its core by itself has lost it to another one: that is the CPU's.
nanoseconds FrameCauses::slept_since(const SegmentUse& begin, nanoseconds longer,
                                     nanoseconds now) const {
    if (begin.time.count() == 0 || longer < kWorthAsking ||
        pthread_equal(begin.thread, pthread_self()) == 0)
        return nanoseconds{0};
    const ThreadUse use = clock_.thread_use();
    if (use.sleeps == begin.use.sleeps) return nanoseconds{0};
    return positive(now - begin.time - (use.cpu - begin.use.cpu));
}

// The first time: later it is short of more, as others have gone before it since.
void FrameCauses::note_given_up(TaskState& task, nanoseconds now) const {
    if (now < deadline_of(task) && !task.facts.run.given_up && governor_.plan().gives_up(task))
        task.facts.run.given_up = governor_.plan().why_given_up(task);
}

void FrameCauses::segment_begins(TaskState& task, nanoseconds now) {
    ++task.facts.run.num_segments;
    task.facts.run.held_at_segment = task.run.waited.held;
    task.facts.windows.begin(task.tracked.arrival, deadline_of(task), launched(task), now);
}

void FrameCauses::segment_ended(TaskState& task, bool idle, nanoseconds now) const {
    RunFacts& facts = task.facts.run;
    const sched::GovernedRun& run = task.run;
    const nanoseconds estimated = task.work.launched - run.segment.launched;
    const std::vector<model::PlannedSegment>& segments = task.plan.segments();
    const std::size_t segment = task.tracker.segment();
    const nanoseconds latency =
        segment < segments.size() ? segments[segment].latency : nanoseconds{0};
    task.facts.windows.end(launched(task), idle, latency, now);
    note_given_up(task, now);
    if (!idle) return;
    const nanoseconds took = now - run.segment.time - (run.waited.held - facts.held_at_segment);
    if (task.plan.is_empty()) {
        facts.gpu_took += took;
        return;
    }
    const nanoseconds expected = std::max(estimated, latency);
    const nanoseconds longer = positive(took - expected);
    facts.gpu_expected += expected;
    // The GPU waited for launches that came later than profiled: the CPU's.
    nanoseconds by_launching{0};
    const nanoseconds launch_time = task.plan.launch_time(task.tracker.position()) -
                                    task.plan.launch_time(run.segment.position + 1);
    if (run.wait_begin.count() != 0 && launch_time.count() > 0) {
        const nanoseconds waited = run.waited.held + run.waited.paced - run.segment.held;
        by_launching = std::min(longer, positive(run.wait_begin - run.segment.time - waited -
                                                 std::max(launch_time, estimated)));
    }
    facts.gpu_beyond += longer - by_launching;
    // At least what is more than all of the CPU segment, of the wait, and of our holds.
    const nanoseconds known = facts.cpu_took + (now - run.wait_begin) + run.waited.held +
                              run.waited.paced - run.segment.held;
    add_cpu(facts, by_launching, positive(slept_since(facts.cpu_begin, by_launching, now) - known));
}

void FrameCauses::held(TaskState& task, int behind, nanoseconds time, nanoseconds now) const {
    const int chain = governor_.tasks().chain_of(behind);
    task.facts.holds.add({task.tracked.arrival, now - time, now, chain});
    note_given_up(task, now);
}

void FrameCauses::waits_for(TaskState& task, const TaskState& other) {
    if (task.chain != other.chain)
        task.facts.waits_for.store(static_cast<int>(other.chain->index), kRelaxed);
}

void FrameCauses::run_ends(TaskState& task, nanoseconds now) {
    RunFacts& facts = task.facts.run;
    task.facts.ended_at = now;
    if (task.plan.is_empty() && facts.gpu_took.count() > 0) {
        const nanoseconds longer = task.facts.gpu.saw(facts.gpu_took);
        facts.gpu_longer += longer;
        facts.gpu_expected += facts.gpu_took - longer;
    }
    if (task.tracked.hinted && task.tracked.cpu_begin.count() > 0) {
        const nanoseconds longer = task.facts.tail.saw(now - task.tracked.cpu_begin);
        add_cpu(facts, longer, slept_since(facts.cpu_begin, longer, now));
    }
    facts.was_off |= !is_acted_on(task);

    const std::lock_guard lock(mutex_);
    Frame& frame = find(chains_[task.chain->index], task.tracked.arrival);
    // How long the frame lay between two tasks: its next thread came later than is usual.
    if (frame.last_end.count() != 0)
        facts.cpu_longer += task.facts.start.saw(positive(task.tracked.begin - frame.last_end));
    frame.last_end = now;
    frame.num_segments += facts.num_segments;
    frame.gpu_beyond += facts.gpu_beyond;
    frame.held += task.run.waited.held;
    observe::FrameFacts& sum = frame.facts;
    sum.was_off |= facts.was_off;
    if (!sum.given_up) sum.given_up = facts.given_up;
    sum.beside_bystanders |= task.run.estimate.beside_bystanders;
    sum.began_late += facts.began_late;
    sum.cpu_longer += facts.cpu_longer;
    sum.outside += facts.outside;
    sum.gpu_longer += facts.gpu_longer;
    sum.gpu_expected += facts.gpu_expected;
    if (const int other = task.facts.waits_for.load(kRelaxed); other >= 0) frame.waits_for = other;
}

// --- asked

FrameCauses::Frame& FrameCauses::find(Chain& chain, nanoseconds arrival) {
    for (Frame& frame : chain.frames)
        if (frame.is_known && frame.arrival == arrival) return frame;
    Frame& frame = chain.frames[chain.next++ % kFrames];
    frame = {};
    frame.arrival = arrival;
    frame.is_known = true;
    return frame;
}

FrameCauses::Frame FrameCauses::take_out(const ChainState& chain, nanoseconds arrival) {
    const std::lock_guard lock(mutex_);
    Frame& frame = find(chains_[chain.index], arrival);
    frame.is_known = false;
    return frame;
}

/// What the frame's own tasks did for it, and were held for.
observe::FramesWork FrameCauses::work_of(const ChainState& chain, const Frame& frame,
                                         nanoseconds now) const {
    observe::FramesWork own;
    own.deadline = frame.arrival + chain.deadline();
    own.last_priority = -GpuWindows::kNone;
    own.waits_for = frame.waits_for;
    own.beside_bystanders = frame.facts.beside_bystanders;
    const std::uint32_t most = TaskPieces::share_of(chain.tasks.size());
    std::uint32_t num_segments = 0;
    nanoseconds held{0};
    for (const int index : chain.tasks) {
        const TaskState& task = roster_.task(index);
        if (task.plan.is_empty()) own.longer = frame.facts.gpu_longer;
        own.factor = std::max(own.factor, factor_of(task));
        const TaskPieces pieces(task, frame.arrival, now, most);
        task.facts.windows.for_each(
            [&](const GpuWindows::Segment& segment) {
                if (segment.arrival != frame.arrival) return;
                ++num_segments;
                own.deadline = segment.deadline;
                own.last_priority = std::max(own.last_priority, segment.last_priority);
                auto its = pieces.of(segment);
                if (!its.empty() && its.back().is_open) its.pop_back();
                own.pieces.insert(own.pieces.end(), its.begin(), its.end());
                const nanoseconds waiting =
                    end_of(segment, now) - segment.begin - observe::took(its);
                if (segment.is_executed)
                    own.gaps += positive(segment.alone - waiting -
                                         (segment.last_work - segment.first_work));
            },
            TaskPieces::segments_of(most));
        task.facts.holds.for_each(
            [&](const HoldSpans::Hold& hold) {
                if (hold.arrival != frame.arrival) return;
                held += hold.end - hold.begin;
                own.holds.push_back(
                    {hold.begin, hold.end, hold.behind < 0 ? observe::kUnknownChain : hold.behind});
            },
            TaskPieces::holds_of(most));
    }
    if (num_segments < frame.num_segments && !own.longer) own.all_longer = frame.gpu_beyond;
    own.held_before = positive(frame.held - held);
    std::sort(own.pieces.begin(), own.pieces.end(),
              [](const auto& a, const auto& b) { return a.begin < b.begin; });
    return own;
}

// Tasks of the same chain work on other frames of it: they are of one rank, and no others.
std::vector<observe::OthersSegment> FrameCauses::others_of(const ChainState& chain,
                                                           nanoseconds begin,
                                                           nanoseconds now) const {
    struct Work {
        TaskState* task;
        std::vector<GpuWindows::Segment> segments;
    };
    std::vector<Work> work;
    for (const auto& other : roster_.tasks()) {
        if (other->chain == &chain) continue;
        governor_.tasks().look(*other, now);  // no thread may have seen its last mark yet
        auto segments = segments_between(*other, begin, now);
        if (!segments.empty()) work.push_back({other.get(), std::move(segments)});
    }
    const std::uint32_t most = TaskPieces::share_of(work.size());
    std::vector<observe::OthersSegment> others;
    for (auto& [other, segments] : work) {
        join(segments, TaskPieces::segments_of(most));
        const TaskPieces pieces(*other, segments.front().begin, now, most);
        const double factor = factor_of(*other);
        for (const GpuWindows::Segment& segment : segments) {
            others.push_back({.chain = static_cast<int>(other->chain->index),
                              .deadline = segment.deadline,
                              .first_priority = segment.first_priority,
                              .pieces = pieces.of(segment)});
            for (observe::ExecutedPiece& piece : others.back().pieces)
                piece.work = nanoseconds(
                    static_cast<std::int64_t>(factor * static_cast<double>(piece.work.count())));
        }
    }
    return others;
}

observe::Cause FrameCauses::frame_ended(const ChainState& chain, nanoseconds arrival,
                                        nanoseconds now, std::optional<nanoseconds> exited) {
    Frame frame = take_out(chain, arrival);
    observe::FrameFacts& facts = frame.facts;
    facts.deadline = chain.deadline();
    facts.latency = now - arrival;
    facts.exited = exited;
    facts.was_off |= !governor_.acts();
    if (!exited && facts.latency <= facts.deadline) return {};
    observe::Cause cause;
    try {
        if (!exited && !facts.was_off) add_lost_time(chain, frame, now);
        cause = observe::cause_of(facts);
    } catch (const std::bad_alloc&) {
        // The frame is to be recorded all the same.
        cause = {observe::MissCause::kUnknown};
    }
    count(chain, cause);
    return cause;
}

void FrameCauses::add_lost_time(const ChainState& chain, Frame& frame, nanoseconds now) const {
    observe::LostTime lost =
        observe::lost_time(work_of(chain, frame, now), others_of(chain, frame.arrival, now));
    frame.facts.gpu_longer = lost.by_itself;
    frame.facts.lost_to = std::move(lost.others);
}

void FrameCauses::count(const ChainState& chain, const observe::Cause& cause) {
    const auto kind = static_cast<std::size_t>(cause.kind);
    const auto behind = static_cast<std::size_t>(cause.behind + 1);
    chains_[chain.index].counted[kind * (chains_.size() + 1) + behind].fetch_add(1, kRelaxed);
}

std::vector<observe::CauseCount> FrameCauses::counts(const ChainState& chain) const {
    std::vector<observe::CauseCount> counts;
    const auto& counted = chains_[chain.index].counted;
    for (std::size_t i = 0; i < counted.size(); ++i) {
        const std::uint64_t count = counted[i].load(kRelaxed);
        if (count == 0) continue;
        const std::size_t behind = i % (chains_.size() + 1);
        counts.push_back({static_cast<observe::MissCause>(i / (chains_.size() + 1)),
                          behind == 0 ? "" : roster_.chains()[behind - 1]->config.name, count});
    }
    std::stable_sort(counts.begin(), counts.end(),
                     [](const auto& a, const auto& b) { return a.count > b.count; });
    return counts;
}

}  // namespace urgengo::runtime
