// SPDX-License-Identifier: Apache-2.0
#include "host/sched/policies/feasible.h"

#include <algorithm>
#include <array>
#include <limits>

namespace urgengo::sched {
namespace {

/// Given-up instances rank behind the kept ones and before the late ones; within a step of
/// criticality by their deadline, as far as six days ahead.
constexpr Key kGivenUp = kLate / 2;
constexpr Key kCriticalityStep = Key{1} << 49;
constexpr Key kMostCritical = 2047;

constexpr nanoseconds kNever = nanoseconds::max();

/// Less of the GPU than this is left for nobody.
constexpr double kNegligible = 0.02;

/// GPU work without a pause of the program's, as it is alone.
struct Part {
    nanoseconds time{0};  ///< alone, waits of the GPU for its launches included
    double share = 1;     ///< of that time, in which the GPU works for it
};

/// What remains of an instance: a GPU segment, and all that comes after it.
struct Job {
    const SlotView* view = nullptr;
    bool given_up = false;
    bool may_be_late = false;  ///< nobody whom its deadline would need may be given up
    Part first, last;          ///< with the margin
    nanoseconds reserve{0};    ///< kept free before its deadline
    // Played:
    bool is_last_part = false;
    bool is_done = false;
    double rate = 0;       ///< at which it gets on, of its speed alone
    nanoseconds ready{0};  ///< when the part at hand can begin
    nanoseconds left{0};   ///< of its time alone
    nanoseconds slack{0};  ///< once it is done: the time before its deadline

    const Part& part() const { return is_last_part ? last : first; }
    bool is_last_gpu() const { return is_last_part || last.time.count() == 0; }
    nanoseconds first_deadline() const { return view->deadline - last.time - view->later_cpu; }
    /// Of the part at hand.
    nanoseconds deadline() const { return is_last_part ? view->deadline : first_deadline(); }
    bool waits(nanoseconds now) const { return !given_up && !is_done && rate == 0 && ready <= now; }
    void begin() {
        is_last_part = is_done = false;
        ready = view->release;
        left = first.time;
    }
    void end_part(nanoseconds now) {
        is_done = is_last_gpu();
        is_last_part = true;
        ready = now + view->later_cpu;
        left = last.time;
    }
    nanoseconds until_done() const {
        if (rate >= 1) return left;
        return nanoseconds(static_cast<std::int64_t>(static_cast<double>(left.count()) / rate) + 1);
    }
    void advance(nanoseconds time) {
        if (rate < 1)
            time = nanoseconds(static_cast<std::int64_t>(static_cast<double>(time.count()) * rate));
        left -= time;
    }
};

/// Of the GPU segment at hand.
nanoseconds segment_deadline(const SlotView& v) {
    return v.deadline - v.later_gpu - v.later_idle - v.later_cpu;
}

Part make_part(nanoseconds gpu, nanoseconds idle, double margin) {
    gpu += nanoseconds(static_cast<std::int64_t>(margin * static_cast<double>(gpu.count())));
    Part part{gpu + idle};
    if (idle.count() > 0)
        part.share = std::max(
            static_cast<double>(gpu.count()) / static_cast<double>(part.time.count()), kNegligible);
    return part;
}

Job make_job(const SlotView& v, double margin) {
    Job job;
    job.view = &v;
    job.first = make_part(v.own_gpu(), v.remaining_idle - v.later_idle, margin);
    job.last = make_part(v.later_gpu, v.later_idle, margin);
    return job;
}

Job make_late_job(const SlotView& v, double margin) {
    Job job = make_job(v, margin);
    job.may_be_late = job.given_up = true;
    return job;
}

/// What giving up the instance frees for what it costs.
double gain(const SlotView& v) {
    return static_cast<double>(v.remaining_gpu.count()) /
           static_cast<double>(std::max<std::int64_t>(v.period.count(), 1));
}

/// The GPU goes to the ready ones in deadline order, to each as much as it can use.
/// @returns when the next of those that are not ready is; kNever if there is none
nanoseconds share_out(nanoseconds now, std::span<Job> jobs) {
    nanoseconds next_ready = kNever;
    for (Job& job : jobs) {
        job.rate = 0;
        if (!job.given_up && !job.is_done && job.ready > now)
            next_ready = std::min(next_ready, job.ready);
    }
    double capacity = 1;
    while (capacity > kNegligible) {
        Job* next = nullptr;
        for (Job& job : jobs)
            if (job.waits(now) && (!next || job.deadline() < next->deadline())) next = &job;
        if (!next) break;
        const double share = next->part().share;
        next->rate = std::min(1.0, capacity / share);
        capacity -= next->rate * share;
    }
    return next_ready;
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
        const nanoseconds next_ready = share_out(now, jobs);
        nanoseconds time = next_ready == kNever ? kNever : next_ready - now;
        bool any = false;
        for (const Job& job : jobs) {
            if (job.rate == 0) continue;
            any = true;
            time = std::min(time, job.until_done());
        }
        if (time == kNever) return outcome;
        now += time;
        if (!any) continue;
        for (Job& job : jobs) {
            if (job.rate == 0) continue;
            job.advance(time);
            if (job.left.count() > 0) continue;
            if (job.is_last_gpu()) {
                if (now > job.deadline() - job.reserve && !job.may_be_late) return {&job, now};
                job.slack = job.deadline() - now;
                outcome.slack = std::min(outcome.slack, job.slack);
            }
            job.end_part(now);
        }
    }
}

/// @returns a time by which all of them are done, in whatever order
nanoseconds latest_end(nanoseconds now, std::span<const Job> jobs) {
    nanoseconds release = now, time{0};
    for (const Job& job : jobs) {
        release = std::max(release, job.view->release);
        time += job.first.time + job.last.time + job.view->later_cpu;
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
std::uint64_t sharers(std::span<const Job> jobs, nanoseconds share_slack) {
    std::uint64_t slots = 0;
    for (const Job& job : jobs) {
        if (job.given_up || job.view->task == SlotView::kExpected) continue;
        if (job.view->laxity.count() < 0) continue;  // it goes first anyway
        const bool fits = std::all_of(jobs.begin(), jobs.end(), [&](const Job& other) {
            // As the ranks are (feasible_key), whatever the margin.
            // One that is late does not mind.
            const bool goes_first = !other.given_up && &other != &job && !other.may_be_late &&
                                    segment_deadline(*other.view) <= segment_deadline(*job.view);
            return !goes_first || other.slack >= share_slack;
        });
        if (fits) slots |= std::uint64_t{1} << job.view->task;
    }
    return slots;
}

/// @returns whether all that are kept are still in time if the late one goes before them; then it
/// is
///          kept, too
bool costs_nobody(Job& late, nanoseconds now, std::span<Job> jobs) {
    late.given_up = false;
    late.given_up = play(now, jobs).missed != nullptr;
    return !late.given_up;
}

/// @returns whether to give up a rather than b
bool goes_before(const SlotView& a, const SlotView& b) {
    return a.criticality != b.criticality ? a.criticality < b.criticality : gain(a) > gain(b);
}

}  // namespace

Plan make_plan(nanoseconds now, std::span<const SlotView> active, double margin,
               nanoseconds share_slack, double load) {
    std::array<Job, abi::kMaxTasks> storage;
    std::size_t num_jobs = 0;
    for (const SlotView& v : active.first(std::min(active.size(), storage.size())))
        if (v.laxity.count() >= 0 && v.remaining_gpu.count() > 0)
            storage[num_jobs++] = make_job(v, margin);
    const std::span on_time(storage.data(), num_jobs);
    // Of a chain without a profile nobody knows what it needs; what somebody waits for to drain is
    // to drain; and who has waited for too long is in no plan.
    const bool may_share = std::all_of(active.begin(), active.end(), [](const SlotView& v) {
        return !v.ranked || (v.chain_gpu.count() > 0 && !v.needs_all && !v.starved);
    });
    // Where there is plenty of time, how much exactly does not matter (admission.cpp).
    const nanoseconds spare = earliest_deadline(on_time) - latest_end(now, on_time);
    if (spare >= kPlenty) return {.slack = may_share ? spare : nanoseconds{0}};
    keep_reserves(on_time);
    for (const SlotView& v : active)
        if (v.laxity.count() < 0 && v.remaining_gpu.count() > 0 && !v.demoted &&
            num_jobs < storage.size())
            storage[num_jobs++] = make_late_job(v, margin);
    const std::span jobs(storage.data(), num_jobs);

    Plan plan;
    Outcome outcome = play(now, jobs);
    for (; outcome.missed; outcome = play(now, jobs)) {
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
        if (missed.reserve.count() > 0 && victim->view->criticality >= missed.view->criticality) {
            missed.reserve = nanoseconds{0};
            continue;
        }
        victim->given_up = true;
        if (victim->view->task != SlotView::kExpected)
            plan.given_up |= std::uint64_t{1} << victim->view->task;
    }
    const bool has_room = load < kMostLoad && plan.given_up == 0;
    const std::span all_late = jobs.subspan(has_room ? on_time.size() : jobs.size());
    for (Job& late : all_late)
        if (costs_nobody(late, now, jobs)) plan.late_first |= std::uint64_t{1} << late.view->task;
    if (plan.late_first != 0) outcome = play(now, jobs);
    if (may_share) {
        plan.slack = outcome.slack;
        plan.may_share = sharers(jobs, share_slack);
    }
    return plan;
}

Key feasible_key(const SlotView& v, const Snapshot& snapshot) {
    const nanoseconds due = segment_deadline(v);
    if (v.laxity.count() < 0)
        return v.deadline.count() + (snapshot.plan.late_first >> v.task & 1 ? 0 : kLate);
    if (!(snapshot.plan.given_up >> v.task & 1)) return due.count();
    const Key ahead = std::clamp((due - snapshot.now).count(), Key{0}, kCriticalityStep - 1);
    const Key criticality = std::clamp(Key{v.criticality}, Key{0}, kMostCritical);
    return kGivenUp + (kMostCritical - criticality) * kCriticalityStep + ahead;
}

}  // namespace urgengo::sched
