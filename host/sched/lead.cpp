// SPDX-License-Identifier: Apache-2.0
#include "host/sched/lead.h"

#include <algorithm>

#include "host/sched/binding.h"

namespace urgengo::sched {
namespace {

/// Of two levels the other one is that of all launches without a priority of their own.
constexpr int kFewLevels = 2;

/// @param is_below  there is a lead above it
/// @returns the level of a new lead: half-way, as the next task may belong on either side; of two
///          such levels the one that is farther from the lead above it
constexpr int level_between(int first, int last, bool is_below) {
    return (first + last + (is_below ? 1 : 0)) / 2;
}

}  // namespace

bool Lead::has_levels(const GovernedTask& task) const {
    return scheduler_.binding == config::Binding::kKernel &&
           num_levels(scheduler_.priority.levels, task.run.priority.least,
                      task.run.priority.greatest) > kFewLevels;
}

bool Lead::leads(const GovernedTask& task, nanoseconds now) const {
    return scheduler_.run_ahead.alone > scheduler_.run_ahead.limit && company_.is_solitary(now) &&
           has_levels(task);
}

bool Lead::forks_ahead(const GovernedTask& task, bool is_vouched) const {
    return !is_vouched &&
           task.work.launched - task.work.marked > task.planned(scheduler_.run_ahead.limit) &&
           has_levels(task);
}

Levels Lead::levels(GovernedTask& task, bool is_vouched, const Decision& decision, int wanted,
                    int num_levels, bool beside_bystanders, nanoseconds now) {
    int first = 0, last = num_levels - 1;
    leaders_.load().for_each([&](int index) {
        const GovernedTask& leader = tasks_[index];
        if (&leader == &task || !is_under_way(leader)) return;
        const int its = leader.lead.level.load(kRelaxed);
        if (its == 0) return;  // over() is at it
        if (decision.before.contains(index))
            first = std::max(first, std::min(its + 1, num_levels - 1));
        else
            last = std::min(last, its - 1);
    });
    const bool leaves_last = beside_bystanders && num_levels > kFewLevels;
    const bool is_lent = task.lead.is_lent;
    if (is_lent) [[unlikely]]
        task.lead.is_lent = false;
    if (is_lent || leads(task, now) || forks_ahead(task, is_vouched)) {
        const int led = task.lead.level.load(kRelaxed), top = std::max(first, 1);
        const int bottom = std::max(top, std::min(last, num_levels - (leaves_last ? 2 : 1)));
        const int own = led ? led : level_between(top, bottom, first > 0);
        const int level = std::clamp(std::max(wanted, own), top, bottom);
        task.lead.from.store(task.work.launched, kRelaxed);
        task.lead.level.store(level, kRelaxed);
        if (led == 0) leaders_.insert(task.index);
        return {.first = level, .level = level};
    }
    // Above the leads of less urgent tasks, but for want of levels below those of more urgent ones.
    wanted = std::max(std::min(wanted, last), first);
    if (first > 0) return {.first = wanted, .level = wanted};
    return {.first = 0, .level = leaves_last ? std::min(wanted, num_levels - 2) : wanted};
}

// What went unasked since the last launch that was asked about may have been launched in the lead.
bool Lead::is_under_way(const GovernedTask& leader) const {
    return leader.executed() <=
           leader.lead.from.load(kRelaxed) + leader.planned(scheduler_.run_ahead.alone);
}

}  // namespace urgengo::sched
