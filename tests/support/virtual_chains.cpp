// SPDX-License-Identifier: Apache-2.0
#include "tests/support/virtual_chains.h"

#include <algorithm>

#include "host/model/urgency.h"
#include "host/sched/admission.h"
#include "host/sched/policies/feasible.h"

namespace urgengo::testing {
namespace {

using model::SlotView;

constexpr nanoseconds kStep = kVirtualStep;
constexpr nanoseconds kPlanEvery{200'000};
constexpr nanoseconds kHorizon{60'000'000};

enum class State { kIdle, kCpu, kGpu };

/// A chain's thread and its stream.
struct Thread {
    const VirtualChain* chain = nullptr;
    int index = 0;
    VirtualOutcome outcome{};
    State state = State::kIdle;
    nanoseconds next_arrival{0};
    nanoseconds arrival{0};
    std::size_t task = 0;
    nanoseconds cpu_until{0};
    nanoseconds launched{0}, executed{0};  ///< of the task's GPU time
    nanoseconds progress{0};               ///< when `executed` moved, or work came to an idle GPU
    nanoseconds held{0};                   ///< in this instance

    const VirtualTask& now_at() const { return chain->tasks[task]; }
    bool has_work() const { return launched > executed; }

    SlotView view(nanoseconds now) const {
        SlotView v;
        v.task = index;
        v.active = state != State::kIdle;
        if (!v.active) return v;
        for (std::size_t i = task + 1; i < chain->tasks.size(); ++i) {
            v.later_gpu += chain->tasks[i].gpu;
            v.later_cpu += chain->tasks[i].cpu;
        }
        v.deadline = arrival + chain->deadline;
        v.relative_deadline = chain->deadline;
        v.period = chain->period;
        v.release = state == State::kCpu ? cpu_until : now;
        v.remaining_gpu = now_at().gpu - executed + v.later_gpu;
        v.remaining_cpu = v.release - now + v.later_cpu;
        v.laxity = model::laxity({v.deadline, v.remaining_gpu, v.remaining_cpu}, now);
        v.utilization = v.mean_utilization = now_at().utilization;
        v.launched = launched - executed;
        v.criticality = chain->criticality;
        v.static_rank = index;
        v.ranked = state == State::kGpu;
        v.overdue = has_work() && now - progress > 2 * v.launched + model::kOverdue;
        v.blocking = v.ranked && !v.overdue;
        v.started = launched.count() > 0;
        v.demoted = chain->on_late == config::OnLate::kDemote && v.laxity.count() < 0;
        for (const VirtualTask& t : chain->tasks) {
            v.chain_gpu += t.gpu;
            v.chain_cpu += t.cpu;
        }
        return v;
    }
};

class World {
  public:
    World(const std::vector<VirtualChain>& chains, const VirtualSettings& settings)
        : settings_(settings) {
        for (const VirtualChain& chain : chains) {
            Thread t;
            t.chain = &chain;
            t.index = static_cast<int>(threads_.size());
            t.next_arrival = chain.phase;
            threads_.push_back(t);
        }
    }

    std::vector<VirtualOutcome> run() {
        for (; now_ < settings_.duration; now_ += kStep) {
            for (Thread& thread : threads_) act(thread);
            execute();
        }
        std::vector<VirtualOutcome> outcomes;
        for (Thread& thread : threads_) {
            // What is due and has not ended has missed, too.
            if (thread.state != State::kIdle && now_ > thread.arrival + thread.chain->deadline)
                finish(thread, true);
            outcomes.push_back(thread.outcome);
        }
        return outcomes;
    }

  private:
    double load() const {
        double load = 0;
        for (const Thread& thread : threads_)
            for (const VirtualTask& t : thread.chain->tasks)
                load += static_cast<double>(t.gpu.count()) /
                        static_cast<double>(thread.chain->period.count());
        return load;
    }
    void finish(Thread& thread, bool missed) {
        ++thread.outcome.instances;
        thread.outcome.missed += missed;
        thread.outcome.longest_hold = std::max(thread.outcome.longest_hold, thread.held);
        thread.state = State::kIdle;
    }

    void begin_task(Thread& thread, std::size_t task) {
        thread.task = task;
        thread.launched = thread.executed = nanoseconds{0};
        thread.state = State::kCpu;
        thread.cpu_until = now_ + thread.now_at().cpu;
        if (thread.chain->on_late != config::OnLate::kExit || thread.view(now_).laxity.count() >= 0)
            return;
        ++thread.outcome.exited;
        finish(thread, true);
    }

    void act(Thread& thread) {
        if (thread.state == State::kIdle && thread.next_arrival <= now_) {
            thread.arrival = thread.next_arrival;
            thread.next_arrival += thread.chain->period;
            thread.held = nanoseconds{0};
            begin_task(thread, 0);
        }
        if (thread.state == State::kCpu && thread.cpu_until <= now_) {
            thread.state = State::kGpu;
            thread.progress = now_;
        }
        if (thread.state != State::kGpu) return;
        launch(thread);
        if (thread.executed < thread.now_at().gpu) return;
        if (thread.task + 1 < thread.chain->tasks.size())
            return begin_task(thread, thread.task + 1);
        finish(thread, now_ > thread.arrival + thread.chain->deadline);
    }

    // As Runtime::hold_until_admitted(): for others no longer than the bound.
    void launch(Thread& thread) {
        const std::chrono::duration<double, std::nano> bound =
            thread.chain->deadline * settings_.scheduler.hold_max_deadlines;
        while (thread.launched < thread.now_at().gpu &&
               thread.launched - thread.executed <= settings_.scheduler.run_ahead) {
            if (thread.held < bound && !admits(thread)) {
                thread.held += kStep;
                return;
            }
            if (!thread.has_work()) thread.progress = now_;
            thread.launched +=
                std::min(thread.now_at().kernel, thread.now_at().gpu - thread.launched);
        }
    }

    bool admits(const Thread& thread) {
        std::vector<SlotView> active, ranked{thread.view(now_)};
        for (const Thread& other : threads_) {
            const SlotView v = other.view(now_);
            if (v.active) active.push_back(v);
            if (v.ranked && &other != &thread) ranked.push_back(v);
        }
        const std::size_t num_active = active.size();
        if (now_ - planned_ >= kPlanEvery || num_active != num_planned_) {
            for (const Thread& other : threads_)
                if (other.next_arrival <= now_ + kHorizon) active.push_back(expected(other));
            plan_ = sched::make_plan(now_, active, settings_.scheduler.plan_margin,
                                     settings_.scheduler.share_slack, load());
            planned_ = now_;
            num_planned_ = num_active;
        }
        sched::Snapshot snapshot{now_, ranked, plan_};
        snapshot.num_chains = static_cast<int>(threads_.size());
        snapshot.num_levels = 6;
        return sched::decide(settings_.scheduler, snapshot).admit;
    }

    // The chain's next frame, as Runtime::expected() has it.
    SlotView expected(const Thread& thread) const {
        Thread next;
        next.chain = thread.chain;
        next.index = SlotView::kExpected;
        next.state = State::kCpu;
        next.arrival = std::max(thread.next_arrival, now_);
        next.cpu_until = next.arrival + next.now_at().cpu;
        SlotView v = next.view(next.arrival);
        v.release = next.cpu_until;
        return v;
    }

    void execute() {
        double wanted = 0;
        for (const Thread& t : threads_)
            if (t.has_work() && !t.chain->is_dead) wanted += t.now_at().utilization;
        for (Thread& t : threads_) {
            if (!t.has_work() || t.chain->is_dead) continue;
            const double speed = 1 / std::max(1.0, wanted);
            const nanoseconds done(static_cast<std::int64_t>(speed * double(kStep.count())));
            t.executed = std::min(t.launched, t.executed + done);
            t.progress = now_;
        }
    }

    const VirtualSettings& settings_;
    std::vector<Thread> threads_;
    nanoseconds now_{0}, planned_{-1'000'000'000};
    std::size_t num_planned_ = 0;
    sched::Plan plan_;
};

}  // namespace

std::vector<VirtualOutcome> run_virtual(const std::vector<VirtualChain>& chains,
                                        const VirtualSettings& settings) {
    return World(chains, settings).run();
}

double mean_miss_ratio(const std::vector<VirtualOutcome>& outcomes) {
    double sum = 0;
    for (const VirtualOutcome& o : outcomes) sum += o.miss_ratio();
    return outcomes.empty() ? 0 : sum / static_cast<double>(outcomes.size());
}

}  // namespace urgengo::testing
