// SPDX-License-Identifier: Apache-2.0
#include "host/sched/policies/feasible.h"

#include <algorithm>
#include <limits>

namespace urgengo::sched {
namespace {

/// Given-up instances rank behind the kept ones and before the late ones; within a step of
/// criticality by their deadline, as far as six days ahead.
constexpr Key kGivenUp = kLate / 2;
constexpr Key kCriticalityStep = Key{1} << 49;
constexpr Key kMostCritical = 2047;

using Job = PlannedJob;
constexpr nanoseconds kNever = nanoseconds::max();

/// Of the GPU segment at hand.
nanoseconds segment_deadline(const SlotView& v) {
    return v.deadline - v.later_gpu - v.later_cpu;
}

Job make_job(const SlotView& v, double margin) {
    const auto longer = [&](nanoseconds time) {
        return time +
               nanoseconds(static_cast<std::int64_t>(margin * static_cast<double>(time.count())));
    };
    Job job;
    job.view = &v;
    job.first_gpu = longer(v.remaining_gpu - v.later_gpu);
    job.last_gpu = longer(v.later_gpu);
    return job;
}

/// What giving up the instance frees for what it costs.
double gain(const SlotView& v) {
    return static_cast<double>(v.remaining_gpu.count()) /
           static_cast<double>(std::max<std::int64_t>(v.period.count(), 1));
}

/// The first instance that would end late, if any, and when that would be.
struct Outcome {
    Job* missed = nullptr;
    nanoseconds time{0};
    nanoseconds slack = kNever;  ///< without a miss: the least time before any deadline
};

Outcome play(nanoseconds now, std::span<Job> jobs) {
    Outcome outcome;
    for (Job& job : jobs) job.begin();
    while (true) {
        Job* next = nullptr;
        nanoseconds next_ready = kNever;
        for (Job& job : jobs) {
            if (job.given_up || job.is_done) continue;
            if (job.ready > now) {
                next_ready = std::min(next_ready, job.ready);
            } else if (!next || job.deadline() < next->deadline()) {
                next = &job;
            }
        }
        if (!next) {
            if (next_ready == kNever) return outcome;
            now = next_ready;
            continue;
        }
        const nanoseconds time = std::min(next->left, next_ready - now);
        now += time;
        next->left -= time;
        if (next->left.count() > 0) continue;
        if (next->is_last_gpu()) {
            if (now > next->deadline() - next->reserve) return {next, now};
            next->slack = next->deadline() - now;
            outcome.slack = std::min(outcome.slack, next->slack);
        }
        next->end_part(now);
    }
}

/// @returns a time by which all of them are done, in whatever order
nanoseconds latest_end(nanoseconds now, std::span<const Job> jobs) {
    nanoseconds release = now, time{0};
    for (const Job& job : jobs) {
        release = std::max(release, job.view->release);
        time += job.first_gpu + job.last_gpu + job.view->later_cpu;
    }
    return release + time;
}

nanoseconds earliest_deadline(std::span<const Job> jobs) {
    nanoseconds deadline = kNever;
    for (const Job& job : jobs) deadline = std::min(deadline, job.view->deadline);
    return deadline;
}

/// Plans are kept to within what is under way when somebody more urgent comes. That may cost an
/// instance its deadline, but not for the sake of a less critical one: where none is in the way,
/// there is no reserve.
void keep_reserves(std::span<Job> jobs) {
    constexpr nanoseconds kReserve{3'000'000};
    constexpr int kShareOfTime = 8;
    int least = std::numeric_limits<int>::max();
    for (const Job& job : jobs) least = std::min(least, job.view->criticality);
    for (Job& job : jobs) {
        const nanoseconds reserve = kReserve + job.view->remaining_gpu / kShareOfTime;
        if (job.view->criticality > least) job.reserve = std::min(reserve, job.view->laxity);
    }
}

/// @param jobs  as they were played without a miss
/// @returns the slots of those before whom only such go that are in time by so much
TaskSet sharers(std::span<const Job> jobs, nanoseconds share_slack) {
    TaskSet slots;
    for (const Job& job : jobs) {
        if (job.given_up || job.view->task == SlotView::kExpected) continue;
        const bool fits = std::all_of(jobs.begin(), jobs.end(), [&](const Job& other) {
            // As the ranks are (feasible_key), whatever the margin.
            const bool goes_first = !other.given_up && &other != &job &&
                                    segment_deadline(*other.view) <= segment_deadline(*job.view);
            return !goes_first || other.slack >= share_slack;
        });
        if (fits) slots.insert(job.view->task);
    }
    return slots;
}

/// @returns whether to give up a rather than b
bool goes_before(const SlotView& a, const SlotView& b) {
    return a.criticality != b.criticality ? a.criticality < b.criticality : gain(a) > gain(b);
}

}  // namespace

Plan make_plan(nanoseconds now, std::span<const SlotView> active, double margin,
               nanoseconds share_slack, PlanScratch& scratch) {
    std::vector<Job>& storage = scratch.jobs;
    storage.clear();
    for (const SlotView& v : active)
        if (v.laxity.count() >= 0 && v.remaining_gpu.count() > 0 &&
            storage.size() < storage.capacity())
            storage.push_back(make_job(v, margin));
    const std::span<Job> jobs(storage);
    // Of a chain without a profile nobody knows what it needs; what somebody waits for to drain is
    // to drain; and who has waited for too long is in no plan.
    const bool may_share = std::all_of(active.begin(), active.end(), [](const SlotView& v) {
        return !v.ranked || (v.chain_gpu.count() > 0 && !v.needs_all && !v.starved);
    });
    // Where there is plenty of time, how much exactly does not matter (admission.cpp).
    const nanoseconds spare = earliest_deadline(jobs) - latest_end(now, jobs);
    if (spare >= kPlenty) return {.slack = may_share ? spare : nanoseconds{0}};
    keep_reserves(jobs);

    Plan plan;
    Outcome outcome = play(now, jobs);
    for (; outcome.missed; outcome = play(now, jobs)) {
        Job* victim = outcome.missed;
        for (Job& job : jobs) {
            const bool in_the_way = !job.given_up && job.view->release < outcome.time;
            if (in_the_way && goes_before(*job.view, *victim->view)) victim = &job;
        }
        Job& missed = *outcome.missed;
        if (missed.reserve.count() > 0 && victim->view->criticality >= missed.view->criticality) {
            missed.reserve = nanoseconds{0};
            continue;
        }
        victim->given_up = true;
        plan.given_up.insert(victim->view->task);  // an expected one has no slot
    }
    if (may_share) {
        plan.slack = outcome.slack;
        plan.may_share = sharers(jobs, share_slack);
    }
    return plan;
}

Key feasible_key(const SlotView& v, const Snapshot& snapshot) {
    const nanoseconds due = segment_deadline(v);
    if (v.laxity.count() < 0) return kLate + v.deadline.count();
    if (!snapshot.plan.given_up.contains(v.task)) return due.count();
    const Key ahead = std::clamp((due - snapshot.now).count(), Key{0}, kCriticalityStep - 1);
    const Key criticality = std::clamp(Key{v.criticality}, Key{0}, kMostCritical);
    return kGivenUp + (kMostCritical - criticality) * kCriticalityStep + ahead;
}

}  // namespace urgengo::sched
