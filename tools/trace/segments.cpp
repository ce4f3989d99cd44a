// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/segments.h"

#include "host/observe/wait_name.h"

#include <algorithm>
#include <optional>
#include <set>

namespace urgengo::trace {
namespace {

/// Where a thread that never waits is cut: longer than a driver call takes, shorter than a frame.
constexpr std::int64_t kUnwaitedGapNs = 2'000'000;
constexpr std::int64_t kNsPerUs = 1000;
constexpr std::uint64_t kFollowedHint = std::uint64_t{1} << 63;

bool is_covering_wait(const TraceRecord& event) {
    return event.kind == TraceKind::kWait && (event.flags & abi::kTraceCovers);
}

/// The tasks of which the runtime followed hints, wherever those came from.
std::set<int> hinted_tasks(const Trace& trace) {
    std::set<int> tasks;
    for (const ThreadTrace& thread : trace.threads()) {
        for (const TraceRecord* event : thread.events) {
            const bool begin =
                event->kind == TraceKind::kInstanceBegin && (event->flags & abi::kTraceHinted);
            if (begin) tasks.insert(event->task);
        }
    }
    return tasks;
}

/// Adds up the time between two segments: on the CPU, off it, and in waits, which is neither.
class CpuMeter {
  public:
    /// @param at_ns  when the thread's CPU time was `cpu_us`
    void restart(std::int64_t at_ns, std::uint32_t cpu_us) {
        state_ = State::kKnown;
        begin_ns_ = at_ns, cpu_us_ = cpu_us;
        cpu_ns_ = waited_ns_ = 0;
    }

    /// All that follows counts as off the CPU.
    void restart_without_cpu(std::int64_t at_ns) {
        restart(at_ns, 0);
        state_ = State::kNoCpu;
    }

    /// Of a wait's CPU time only what it took from its call to its end can be its own: waits that
    /// spin use all of that.
    void wait(const TraceRecord& event) {
        if (state_ == State::kNothing) return;
        const std::int64_t in_wait = std::max<std::int64_t>(0, event.wait.end_ns - event.time_ns);
        add_cpu(event.cpu_us, in_wait);
        waited_ns_ += in_wait;
    }

    void fill(Segment& segment, const TraceRecord& launch) {
        if (state_ == State::kNothing) return;
        if (launch.cpu_us != 0) add_cpu(launch.cpu_us, 0);
        segment.gap_ns = std::max<std::int64_t>(0, launch.time_ns - begin_ns_ - waited_ns_);
        segment.cpu_ns = std::min(cpu_ns_, segment.gap_ns);
        segment.idle_ns = segment.gap_ns - segment.cpu_ns;
    }

  private:
    enum class State { kNothing, kNoCpu, kKnown };

    void add_cpu(std::uint32_t cpu_us, std::int64_t not_counted_ns) {
        if (state_ != State::kKnown) return;
        // 32 bits, so that the difference is right when they wrap.
        const std::int64_t used = std::int64_t{cpu_us - cpu_us_} * kNsPerUs;
        cpu_ns_ += std::max<std::int64_t>(0, used - not_counted_ns);
        cpu_us_ = cpu_us;
    }

    State state_ = State::kNothing;
    std::int64_t begin_ns_ = 0;
    std::int64_t cpu_ns_ = 0;
    std::int64_t waited_ns_ = 0;
    std::uint32_t cpu_us_ = 0;
};

/// Walks one thread's events.
class ThreadWalk {
  public:
    ThreadWalk(const ThreadTrace& thread, std::size_t index, const TaskMatcher& tasks,
               const std::set<int>& hinted)
        : thread_(thread), index_(index), tasks_(tasks), hinted_(hinted) {}

    std::vector<Segment> run() {
        never_waits_ = std::none_of(thread_.events.begin(), thread_.events.end(),
                                    [](const auto* event) { return is_covering_wait(*event); });
        for (const TraceRecord* event : thread_.events) step(*event);
        close(nullptr);
        return std::move(segments_);
    }

  private:
    /// An NVTX range that the thread is in.
    struct Range {
        int task = kNoTask;
        std::uint64_t instance = 0;
    };

    /// What a launch belongs to.
    struct Owner {
        int task = kNoTask;
        std::uint64_t instance = 0;
        bool begins_task = false;
    };

    void step(const TraceRecord& event) {
        switch (event.kind) {
            case TraceKind::kLaunch:
                return launch(event);
            case TraceKind::kWait:
                return wait(event);
            case TraceKind::kTaskBegin:
                close(nullptr);
                hint_ = Owner{event.task, next_instance(), false};
                return meter_.restart(event.time_ns, event.cpu_us);
            case TraceKind::kTaskEnd:
                close(nullptr);
                hint_.reset();
                return;
            case TraceKind::kRangePush:
                return push(event);
            case TraceKind::kRangePop:
                if (ranges_.empty()) return;
                if (ranges_.back().task != kNoTask) close(nullptr);
                return ranges_.pop_back();
            default:
                return;
        }
    }

    void push(const TraceRecord& event) {
        Range range;
        range.task = tasks_.by_range(event.hash, thread_.name_at(event.time_ns));
        if (range.task != kNoTask) {
            close(nullptr);
            // A range within one of the same task is part of the same instance.
            const bool nested = !ranges_.empty() && ranges_.back().task == range.task;
            range.instance = nested ? ranges_.back().instance : next_instance();
        } else if (!ranges_.empty()) {
            range = ranges_.back();
        }
        ranges_.push_back(range);
    }

    std::uint64_t next_instance() { return (std::uint64_t{index_ + 1} << 32) | ++num_instances_; }

    /// @returns what tells instances apart that the runtime followed by hints; 0 if it did not
    std::uint64_t followed_instance(const TraceRecord& event) const {
        if (hinted_.count(event.task) == 0) return 0;
        const auto task = static_cast<std::uint64_t>(event.task);
        return kFollowedHint | task << 32 | event.instance;
    }

    Owner owner(const TraceRecord& event) {
        if (hint_) {
            // Helper threads launch for the same instance, and only the runtime counts across.
            const std::uint64_t followed = event.task == hint_->task ? followed_instance(event) : 0;
            return {hint_->task, followed != 0 ? followed : hint_->instance, false};
        }
        const std::string_view name = thread_.name_at(event.time_ns);
        const int begun = tasks_.by_kernel(event, name);
        if (event.task >= 0 && event.task < tasks_.num_tasks()) {
            return {event.task, followed_instance(event), begun == event.task};
        }
        if (!ranges_.empty() && ranges_.back().task != kNoTask) {
            return {ranges_.back().task, ranges_.back().instance, false};
        }
        if (begun != kNoTask) begun_ = begun;
        if (begun_ != kNoTask) return {begun_, 0, begun == begun_};
        return {tasks_.by_thread(name), 0, false};
    }

    void launch(const TraceRecord& event) {
        const Owner its = owner(event);
        if (open_) {
            const bool other = open_->task != its.task || open_->instance != its.instance;
            const bool paused = never_waits_ && event.time_ns - open_->end_ns > kUnwaitedGapNs;
            if (other || paused) close(nullptr);
        }
        if (!open_) {
            open_.emplace();
            open_->task = its.task;
            open_->thread = index_;
            open_->first_launch = num_launches_;
            open_->first = &event;
            open_->begin_ns = event.time_ns;
            open_->begins_task = its.begins_task;
            open_->instance = its.instance;
            meter_.fill(*open_, event);
        }
        open_->end_ns = event.time_ns;
        ++open_->num_launches;
        ++num_launches_;
    }

    void wait(const TraceRecord& event) {
        if (!is_covering_wait(event)) {
            if (!open_) meter_.wait(event);
            return;
        }
        if (open_) {
            close(&event);
        } else if (event.wait.launches > 0 && !segments_.empty() && !segments_.back().closed_by) {
            // The wait for launches that a hint or a range had already ended.
            segments_.back().closed_by = &event;
            segments_.back().end_ns = event.wait.end_ns;
        } else {
            return meter_.wait(event);
        }
        meter_.restart(event.wait.end_ns, event.cpu_us);
    }

    void close(const TraceRecord* wait) {
        if (!open_) return;
        open_->closed_by = wait;
        if (wait) open_->end_ns = wait->wait.end_ns;
        if (!wait) meter_.restart_without_cpu(open_->end_ns);
        segments_.push_back(*open_);
        open_.reset();
    }

    const ThreadTrace& thread_;
    const std::size_t index_;
    const TaskMatcher& tasks_;
    const std::set<int>& hinted_;

    bool never_waits_ = false;
    std::optional<Owner> hint_;
    std::vector<Range> ranges_;
    int begun_ = kNoTask;
    std::uint64_t num_instances_ = 0;
    std::size_t num_launches_ = 0;
    CpuMeter meter_;
    std::optional<Segment> open_;
    std::vector<Segment> segments_;
};

}  // namespace

std::string_view Segment::closed_by_name() const {
    return closed_by ? observe::wait_name(closed_by->wait.function) : "none";
}

std::vector<std::vector<Segment>> find_segments(const Trace& trace, const TaskMatcher& tasks) {
    const std::set<int> hinted = hinted_tasks(trace);
    std::vector<std::vector<Segment>> segments;
    for (std::size_t i = 0; i < trace.threads().size(); ++i) {
        segments.push_back(ThreadWalk(trace.threads()[i], i, tasks, hinted).run());
    }
    return segments;
}

}  // namespace urgengo::trace
