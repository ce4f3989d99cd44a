// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/frame_causes.h"

#include <algorithm>

#include "host/base/memory_orders.h"

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

nanoseconds longest_kernel(const TaskState& task) {
    nanoseconds longest{0};
    for (std::size_t i = 0; i < task.plan.num_kernels(); ++i)
        longest = std::max(longest, task.plan.at(i).gpu_time);
    return longest;
}

nanoseconds end_of(const GpuWindows::Segment& segment, nanoseconds now) {
    return segment.end.count() != 0 ? segment.end : now;
}

/// A segment of the task, as far as it has come.
observe::GpuWindow window_of(const TaskState& task, const GpuWindows::Segment& segment,
                             nanoseconds now) {
    const double factor = task.slot->factor_ppm.load(kRelaxed) * 1e-6;
    const auto corrected = [&](nanoseconds time) {
        return factor > 0 ? nanoseconds(static_cast<std::int64_t>(
                                factor * static_cast<double>(time.count())))
                          : time;
    };
    const bool is_over = segment.end.count() != 0;
    const nanoseconds end = end_of(segment, now);
    return {.begin = segment.begin,
            .end = end,
            .gpu = is_over ? corrected(segment.gpu) : end - segment.begin,
            .deadline = segment.deadline,
            .utilization = task.slot->mean_utilization_ppm.load(kRelaxed) * 1e-6,
            .longest_kernel =
                task.plan.is_empty() ? end - segment.begin : corrected(task.facts.longest_kernel),
            .first_priority = segment.first_priority,
            .last_priority = segment.last_priority};
}

}  // namespace

void FrameCauses::take_roster() {
    chains_ = std::vector<Chain>(roster_.chains().size());
    for (Chain& chain : chains_)
        chain.counted =
            std::vector<std::atomic<std::uint64_t>>(observe::kNumCauses * (chains_.size() + 1));
    for (const auto& task : roster_.tasks()) {
        if (task->plan.is_empty()) continue;
        task->facts.cpu_times = task->plan.cpu_segments();
        task->facts.longest_kernel = longest_kernel(*task);
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
    task.facts.run.held_at_segment = task.run.waited.held;
    task.facts.windows.begin(task.tracked.arrival, deadline_of(task), now);
}

void FrameCauses::segment_ended(TaskState& task, bool idle, nanoseconds now) const {
    RunFacts& facts = task.facts.run;
    const sched::GovernedRun& run = task.run;
    const nanoseconds estimated = task.work.launched - run.segment.launched;
    task.facts.windows.end(now, estimated);
    note_given_up(task, now);
    if (!idle) return;
    const nanoseconds took = now - run.segment.time - (run.waited.held - facts.held_at_segment);
    if (task.plan.is_empty()) {
        facts.gpu_took += took;
        return;
    }
    const std::vector<model::PlannedSegment>& segments = task.plan.segments();
    const std::size_t segment = task.tracker.segment();
    const nanoseconds latency =
        segment < segments.size() ? segments[segment].latency : nanoseconds{0};
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
    // At least what is more than all of the CPU segment, of the wait, and of our holds.
    const nanoseconds known = facts.cpu_took + (now - run.wait_begin) + run.waited.held +
                              run.waited.paced - run.segment.held;
    add_cpu(facts, by_launching, positive(slept_since(facts.cpu_begin, by_launching, now) - known));
    const nanoseconds by_gpu = longer - by_launching;
    const double factor = task.slot->factor_ppm.load(kRelaxed) * 1e-6;
    facts.gpu_longer += by_gpu;
    if (factor > 1)
        facts.gpu_by_factor +=
            std::min(by_gpu, nanoseconds(static_cast<std::int64_t>(
                                 (factor - 1) * static_cast<double>(estimated.count()))));
}

void FrameCauses::held(TaskState& task, int behind, nanoseconds time, nanoseconds now) const {
    const int chain = behind < 0 ? -1 : static_cast<int>(governor_.tasks()[behind].chain->index);
    task.facts.run.held.add(chain, time);
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
    // What was held at gates: behind whom its launch stood last.
    const int behind = task.slot->queue_behind.load(kRelaxed);
    if (const nanoseconds rest = task.run.waited.held - facts.held.total(); rest.count() > 0)
        held(task, behind < static_cast<int>(roster_.tasks().size()) ? behind : -1, rest, now);
    facts.was_off |= !is_acted_on(task);

    const std::lock_guard lock(mutex_);
    Frame& frame = find(chains_[task.chain->index], task.tracked.arrival);
    // How long the frame lay between two tasks: its next thread came later than is usual.
    if (frame.last_end.count() != 0)
        facts.cpu_longer += task.facts.start.saw(positive(task.tracked.begin - frame.last_end));
    frame.last_end = now;
    observe::FrameFacts& sum = frame.facts;
    sum.was_off |= facts.was_off;
    if (!sum.given_up) sum.given_up = facts.given_up;
    sum.beside_bystanders |= task.run.estimate.beside_bystanders;
    sum.began_late += facts.began_late;
    sum.cpu_longer += facts.cpu_longer;
    sum.outside += facts.outside;
    sum.gpu_longer += facts.gpu_longer;
    sum.gpu_by_factor += facts.gpu_by_factor;
    sum.gpu_expected += facts.gpu_expected;
    sum.held.add(facts.held);
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

// Tasks of the same chain work on other frames of it: they are of one rank, and no others.
void FrameCauses::add_others(const ChainState& chain, Frame& frame, nanoseconds now) const {
    observe::FrameFacts& facts = frame.facts;
    std::vector<observe::GpuWindow> own;
    for (const int index : chain.tasks) {
        const TaskState& task = roster_.task(index);
        task.facts.windows.for_each([&](const GpuWindows::Segment& segment) {
            if (segment.arrival == frame.arrival) own.push_back(window_of(task, segment, now));
        });
    }
    for (const auto& other : roster_.tasks()) {
        if (other->chain == &chain) continue;
        const auto index = static_cast<int>(other->chain->index);
        other->facts.windows.for_each([&](const GpuWindows::Segment& segment) {
            const observe::GpuWindow times{.begin = segment.begin, .end = end_of(segment, now)};
            const auto is_beside = [&](const observe::GpuWindow& mine) {
                return observe::overlap(times, mine).count() > 0;
            };
            if (std::none_of(own.begin(), own.end(), is_beside)) return;  // as most are
            const observe::GpuWindow window = window_of(*other, segment, now);
            for (const observe::GpuWindow& mine : own) {
                if (index == frame.waits_for) {
                    facts.waited.add(index, observe::overlap(window, mine));
                    continue;
                }
                const observe::Taken taken = observe::taken_by(window, mine);
                facts.beside += observe::work_beside(window, mine);
                facts.shared.add(index, taken.by_urgent);
                facts.kernels.add(index, taken.by_kernel);
                facts.priority.add(index, taken.by_priority);
            }
        });
    }
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
    if (facts.gpu_longer.count() > 0) add_others(chain, frame, now);
    const observe::Cause cause = observe::cause_of(facts);
    count(chain, cause);
    return cause;
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
