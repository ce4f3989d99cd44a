// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/chain_model.h"

#include <utility>

#include "tools/sim/workloads.h"

namespace urgengo::sim {
namespace {

/// Of a kernel that waits for what never comes.
constexpr nanoseconds kForever = std::chrono::hours(1);

}  // namespace

int ChainTraits::num_branches() const {
    int last = 0;
    for (const TaskTraits& task : tasks) {
        for (const LaunchTraits& one : task.launches) {
            last = std::max(last, one.branch);
            for (const int other : one.after) last = std::max(last, other);
        }
        for (const int other : task.joins) last = std::max(last, other);
    }
    return last + 1;
}

ChainModel::ChainModel(const chains::Chain& chain, int thread,
                       std::vector<chains::PlannedFrame> frames, nanoseconds deadline,
                       const ChainTraits& traits, ChainSurroundings& surroundings, Subject& subject)
    : chain_(chain),
      thread_(thread),
      frames_(std::move(frames)),
      deadline_(deadline),
      traits_(traits),
      surroundings_(surroundings),
      subject_(subject),
      at_{thread, 0, 0},
      records_(frames_.size()) {
    for (std::size_t i = 0; i < frames_.size(); ++i) records_[i].arrival = frames_[i].arrival;
    for (const chains::Task& task : chain.tasks) {
        std::vector<KernelWork> works;
        for (const chains::Kernel& kernel : task.kernels)
            works.push_back(work_of(kernel, surroundings.gpu_shape()));
        works_.push_back(std::move(works));
    }
}

void ChainModel::go_on(nanoseconds now) {
    switch (state_) {
        case State::kBegin:
            return next_frame(now);
        case State::kAsleep:
            subject_.arrived(thread_, frames_[frame_].arrival, now);
            at_.task = 0;
            return begin_task(now);
        case State::kComputing:
            return computed(now);
        case State::kLocked:
            return next_launch(now);
        case State::kStepping:
        case State::kHeld:
            return ask(now);
        case State::kLaunching:
            return launched(now);
        case State::kWaiting:
            return task_done(now);
    }
}

// Of the frames that are left, as many as have come.
std::size_t ChainModel::num_arrived(nanoseconds now) const {
    std::size_t count = 0;
    while (frame_ + count < frames_.size() && frames_[frame_ + count].arrival <= now) ++count;
    return count;
}

void ChainModel::next_frame(nanoseconds now) {
    if (traits_.most_waiting > 0)
        for (std::size_t n = num_arrived(now); n > traits_.most_waiting; --n)
            records_[frame_++].outcome = chains::Outcome::kDropped;
    if (is_done()) return;
    const nanoseconds arrival = frames_[frame_].arrival;
    state_ = State::kAsleep;
    surroundings_.wake_at(thread_, std::max(arrival, now), arrival > now);
}

void ChainModel::begin_task(nanoseconds now) {
    const chains::PlannedFrame& frame = frames_[frame_];
    at_.kernel = 0;
    if (subject_.exits(at_, frame.arrival, now)) return end_frame(chains::Outcome::kExited, now);
    subject_.task_begins(at_, frame.arrival, now);
    state_ = State::kComputing;
    surroundings_.compute(thread_, frame.cpu[static_cast<std::size_t>(at_.task)]);
}

void ChainModel::computed(nanoseconds now) {
    if (task().kernels.empty()) return task_done(now);
    state_ = State::kLocked;
    const bool locks = traits_.lock != ChainTraits::kNoLock;
    if (!locks || surroundings_.take(thread_, traits_.lock)) next_launch(now);
}

const LaunchTraits& ChainModel::launch_traits() const {
    static const LaunchTraits kPlain;
    const auto task = static_cast<std::size_t>(at_.task);
    if (task >= traits_.tasks.size() || at_.kernel >= traits_.tasks[task].launches.size())
        return kPlain;
    return traits_.tasks[task].launches[at_.kernel];
}

const std::vector<int>& ChainModel::joins() const {
    static const std::vector<int> kNone;
    const auto task = static_cast<std::size_t>(at_.task);
    return task < traits_.tasks.size() ? traits_.tasks[task].joins : kNone;
}

void ChainModel::next_launch(nanoseconds now) {
    at_.branch = launch_traits().branch;
    for (const int other : launch_traits().after) join(at_.branch, other, now);
    if (step().count() == 0) return ask(now);
    state_ = State::kStepping;
    surroundings_.compute_launch(thread_, step());
}

void ChainModel::join(int branch, int other, nanoseconds now) {
    surroundings_.join(thread_, branch, other);
    subject_.joined(at_, branch, other, now);
}

void ChainModel::ask(nanoseconds now) {
    answer_ = subject_.launch(at_, now);
    if (!answer_.goes) {
        state_ = State::kHeld;
        if (answer_.until_mark != 0)
            return surroundings_.wait_for_mark(thread_, answer_.until_mark);
        return surroundings_.wake_at(thread_, answer_.look_at, true);
    }
    state_ = State::kLaunching;
    surroundings_.compute_launch(thread_, traits_.launch + answer_.cpu);
}

void ChainModel::launched(nanoseconds now) {
    const std::size_t task_index = static_cast<std::size_t>(at_.task);
    KernelWork work = works_[task_index][at_.kernel];
    if (const double size = frames_[frame_].size[task_index]; size != 1)
        work.blocks =
            static_cast<std::uint32_t>(chains::scaled_grid(task().kernels[at_.kernel], size));
    work.priority = answer_.priority;
    if (traits_.never_ends) work = {.is_mark = true, .mark = kForever};
    surroundings_.launch(thread_, at_.branch, work);
    subject_.launched(at_, now);
    if (at_.task == 0 && at_.kernel == 0) {
        chains::InstanceRecord& record = records_[frame_];
        record.begin = now - traits_.launch;
        record.first_launched = now;
        record.thread = thread_ + 1;
    }
    if (++at_.kernel < task().kernels.size()) return next_launch(now);
    if (traits_.lock != ChainTraits::kNoLock) surroundings_.release(traits_.lock);
    for (const int other : joins()) join(0, other, now);
    subject_.wait_begins(at_, now);
    state_ = State::kWaiting;
    if (surroundings_.wait(thread_)) task_done(now);
}

void ChainModel::task_done(nanoseconds now) {
    subject_.task_ends(at_, now);
    if (static_cast<std::size_t>(++at_.task) < chain_.tasks.size()) return begin_task(now);
    chains::InstanceRecord& record = records_[frame_];
    record.end = now;
    end_frame(record.latency() <= deadline_ ? chains::Outcome::kOnTime : chains::Outcome::kLate,
              now);
}

void ChainModel::end_frame(chains::Outcome outcome, nanoseconds now) {
    records_[frame_].outcome = outcome;
    if (outcome != chains::Outcome::kExited)
        subject_.frame_ended(thread_, now - frames_[frame_].arrival, now);
    ++frame_;
    next_frame(now);
}

}  // namespace urgengo::sim
