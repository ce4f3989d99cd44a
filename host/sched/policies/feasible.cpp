// SPDX-License-Identifier: Apache-2.0
#include "host/sched/policies/feasible.h"

#include <algorithm>
#include <limits>

namespace urgengo::sched {
namespace {

using Job = PlannedJob;
constexpr nanoseconds kNever = nanoseconds::max();
/// For what others have launched, and executes when they are held: their run-ahead, and a kernel.
constexpr nanoseconds kUnderWay{3'000'000};
/// For what a look and a wave of blocks take, where less is under way.
constexpr nanoseconds kLeastSlackToShare{1'000'000};

/// An instance for which the GPU works less of its time is launch-bound, as tasks are
/// (sched/run_ahead.h).
constexpr double kLaunchBoundBelow = 2.0 / 3;

/// Less of the GPU than this is left to no other.
constexpr double kNegligible = 0.02;

PlannedPart make_part(nanoseconds gpu, nanoseconds idle, double margin, double launch_share) {
    gpu += nanoseconds(static_cast<std::int64_t>(margin * static_cast<double>(gpu.count())));
    PlannedPart part{gpu + idle};
    if (idle.count() > 0) {
        part.share = std::max(
            static_cast<double>(gpu.count()) / static_cast<double>(part.time.count()), kNegligible);
        part.launch_share = launch_share;
    }
    return part;
}

Job make_job(const SlotView& v, double margin) {
    Job job;
    job.view = &v;
    job.first = make_part(v.own_gpu(), v.remaining.idle - v.later.idle, margin, v.launching.share);
    job.last = make_part(v.later.gpu, v.later.idle, margin, v.launching.share);
    return job;
}

Job make_late_job(const SlotView& v, double margin) {
    Job job = make_job(v, margin);
    job.may_be_late = job.given_up = true;
    return job;
}

/// What giving up the instance frees for what it costs.
double gain(const SlotView& v) {
    return static_cast<double>(v.remaining.gpu.count()) /
           static_cast<double>(std::max<std::int64_t>(v.period.count(), 1));
}

/// The first instance that would end late, if any, and when that would be.
struct Outcome {
    Job* missed = nullptr;
    nanoseconds time{0};
    nanoseconds slack = kNever;  ///< without a miss: the least time before any deadline
};

/// What comes, executed in deadline order from `now` on.
class Play {
  public:
    Play(nanoseconds now, std::span<Job> jobs, PlanScratch& scratch)
        : now_(now), ready_(scratch.ready), pending_(scratch.pending) {
        ready_.clear();
        pending_.clear();
        for (Job& job : jobs) {
            job.begin();
            if (!job.given_up) pending_.push_back(&job);
        }
    }

    Outcome run() {
        while (!outcome_.missed) {
            const nanoseconds next_ready = take_ready();
            share_out();
            const nanoseconds time = std::min(until_done(), next_ready);
            if (time == kNever) break;
            now_ += time;
            advance(time);
        }
        return outcome_;
    }

  private:
    static bool is_before(const Job* a, const Job* b) {
        return a->due != b->due ? a->due < b->due : a < b;
    }

    /// @returns the time until the next of those that are not ready is; kNever: there is none
    nanoseconds take_ready() {
        nanoseconds next = kNever;
        std::erase_if(pending_, [&](Job* job) {
            if (job->ready > now_) {
                next = std::min(next, job->ready - now_);
                return false;
            }
            ready_.insert(std::upper_bound(ready_.begin(), ready_.end(), job, is_before), job);
            return true;
        });
        return next;
    }

    /// The GPU goes to the ready ones in deadline order, to each as much as it can use; and so does
    /// what those share that slow each other's launching.
    void share_out() {
        double gpu = 1, launching = 1;
        for (Job* job : ready_) {
            job->rate = 0;
            if (gpu <= kNegligible) continue;
            const PlannedPart& part = job->part();
            job->rate = std::min(1.0, gpu / part.share);
            if (part.launch_share > 0)
                job->rate = std::min(job->rate, launching / part.launch_share);
            if (job->rate < kNegligible) job->rate = 0;
            gpu -= job->rate * part.share;
            launching -= job->rate * part.launch_share;
        }
    }

    nanoseconds until_done() const {
        nanoseconds time = kNever;
        for (const Job* job : ready_)
            if (job->rate > 0) time = std::min(time, job->until_done());
        return time;
    }

    void advance(nanoseconds time) {
        std::erase_if(ready_, [&](Job* job) {
            if (job->rate == 0) return false;
            job->advance(time);
            if (job->left.count() > 0) return false;
            if (job->is_last_gpu()) {
                end(*job);
            } else {
                job->begin_last(now_);
                pending_.push_back(job);
            }
            return true;
        });
    }

    void end(Job& job) {
        job.slack = job.due - now_;
        const bool is_missed = job.slack < job.reserve && !job.may_be_late;
        if (!is_missed) {
            outcome_.slack = std::min(outcome_.slack, job.slack);
        } else if (!outcome_.missed || &job < outcome_.missed) {
            outcome_.missed = &job;
            outcome_.time = now_;
        }
    }

    nanoseconds now_;
    std::vector<Job*>&ready_, &pending_;
    Outcome outcome_;
};

/// Plans are kept to within what is under way when a more urgent task arrives. That may cost an
/// instance its deadline, but not for the sake of a less critical one: where none is in the way,
/// there is no reserve.
void keep_reserves(std::span<Job> jobs) {
    constexpr int kShareOfTime = 8;
    int least = std::numeric_limits<int>::max();
    for (const Job& job : jobs) least = std::min(least, job.view->chain.criticality);
    for (Job& job : jobs) {
        const nanoseconds reserve = kUnderWay + job.view->remaining.gpu / kShareOfTime;
        if (job.view->chain.criticality > least) job.reserve = std::min(reserve, job.view->laxity);
    }
}

bool is_launch_bound(const SlotView& v) {
    return v.gpu_share() < kLaunchBoundBelow;
}

/// @returns by how much an instance has to be in time so that the other one may run beside it (4)
nanoseconds slack_to_share(const SlotView& v, const SlotView& beside) {
    const nanoseconds remaining = v.remaining.gpu + v.remaining.idle;
    const int launch_bound = is_launch_bound(v) + is_launch_bound(beside);
    if (launch_bound == 0) return remaining / 2 + kUnderWay;
    if (launch_bound == 1) return std::max(remaining, kLeastSlackToShare);
    const auto share_of = [](const SlotView& its) {
        return std::max(its.gpu_share(), kNegligible);
    };
    const double meet =
        share_of(beside) * std::max(static_cast<double>(v.remaining.gpu.count()),
                                    share_of(v) * static_cast<double>(kLeastSlackToShare.count()));
    return nanoseconds(static_cast<std::int64_t>(meet));
}

/// @param jobs       as they were played without a miss
/// @param late_may   those that are late share with those in time, which all go first
/// @returns the tasks before which only such go that are in time by enough
TaskSet sharers(std::span<const Job> jobs, nanoseconds share_slack, bool late_may) {
    TaskSet slots;
    for (const Job& job : jobs) {
        const bool is_late = job.view->laxity.count() < 0;
        if (is_late ? !job.given_up || !late_may : job.given_up) continue;
        if (job.view->task == SlotView::kExpected) continue;
        const bool fits = std::all_of(jobs.begin(), jobs.end(), [&](const Job& other) {
            // As the ranks are (feasible_key), whatever the margin. One that is late does not mind.
            const bool goes_first =
                !other.given_up && &other != &job && !other.may_be_late &&
                (is_late || segment_deadline(*other.view) <= segment_deadline(*job.view));
            return !goes_first ||
                   other.slack >= std::min(share_slack, slack_to_share(*other.view, *job.view));
        });
        if (fits) slots.insert(job.view->task);
    }
    return slots;
}

/// @returns whether it is late, and should be over by now: keeping it costs the others little. Once
/// it has had more than its time, the GPU has been with others
bool is_almost_over(const SlotView& v) {
    return v.laxity.count() < 0 && v.remaining.gpu.count() <= 0 && v.ahead.launched.count() > 0 &&
           v.ahead.waited <= v.ahead.patience / 2 && !v.state.demoted;
}

/// @returns whether to give up a rather than b
bool goes_before(const SlotView& a, const SlotView& b) {
    return a.chain.criticality != b.chain.criticality ? a.chain.criticality < b.chain.criticality
                                                      : gain(a) > gain(b);
}

}  // namespace

Plan make_plan(nanoseconds now, std::span<const SlotView> active, double margin,
               nanoseconds share_slack, PlanScratch& scratch, const Load& load) {
    std::vector<Job>& storage = scratch.jobs;
    storage.clear();
    scratch.reasons.clear();
    for (const SlotView& v : active)
        if (v.laxity.count() >= 0 && v.remaining.gpu.count() > 0 &&
            storage.size() < storage.capacity())
            storage.push_back(make_job(v, margin));
    const std::size_t num_on_time = storage.size();
    const std::span<Job> on_time(storage.data(), num_on_time);
    // What a chain without a profile needs is not known; while a task waits for all GPU work, that
    // is to drain; and a starved task is in no plan.
    const bool may_share = std::all_of(active.begin(), active.end(), [](const SlotView& v) {
        return !v.state.ranked ||
               (v.chain.gpu.count() > 0 && !v.state.needs_all && !v.state.starved);
    });
    keep_reserves(on_time);
    for (const SlotView& v : active)
        if (v.laxity.count() < 0 && v.remaining.gpu.count() > 0 && !v.state.demoted &&
            storage.size() < storage.capacity())
            storage.push_back(make_late_job(v, margin));
    const std::span<Job> jobs(storage);

    Plan plan;
    const auto play = [&] { return Play(now, jobs, scratch).run(); };
    Outcome outcome = play();
    for (; outcome.missed; outcome = play()) {
        Job& missed = *outcome.missed;
        Job* victim = missed.view->is_supported ? &missed : nullptr;
        for (Job& job : jobs) {
            const bool in_the_way = !job.given_up && job.view->release < outcome.time;
            if (!in_the_way || !job.view->is_supported) continue;
            if (!victim || goes_before(*job.view, *victim->view)) victim = &job;
        }
        if (!victim) {
            missed.may_be_late = true;
            continue;
        }
        if (missed.reserve.count() > 0 &&
            victim->view->chain.criticality >= missed.view->chain.criticality) {
            missed.reserve = nanoseconds{0};
            continue;
        }
        victim->given_up = true;
        plan.given_up.insert(victim->view->task);  // an expected one has no slot
        if (victim->view->task != SlotView::kExpected)
            scratch.reasons.push_back(
                {victim->view->task, missed.view, outcome.time - (missed.due - missed.reserve)});
    }
    const bool has_room = load.leaves_room() && plan.given_up.is_empty();
    const std::span all_late = jobs.subspan(has_room ? on_time.size() : jobs.size());
    for (Job& late : all_late) {
        if (late.view->launching.slowed == model::Launching::kSlowed) continue;  // (3)
        // Kept, before all that are in time, if these are still in time then.
        late.given_up = false;
        late.given_up = play().missed != nullptr;
        if (!late.given_up) plan.late_first.insert(late.view->task);
    }
    if (!all_late.empty()) outcome = play();  // the last one may have been in vain
    if (has_room)
        for (const SlotView& v : active)
            if (is_almost_over(v)) plan.late_first.insert(v.task);
    if (may_share) {
        plan.slack = outcome.slack;
        plan.has_to_share = load.has_to_share();
        plan.launching_is_scarce = load.launching_is_scarce();
        plan.may_share = sharers(jobs, share_slack, has_room);
    }
    return plan;
}

}  // namespace urgengo::sched
