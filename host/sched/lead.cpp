// SPDX-License-Identifier: Apache-2.0
#include "host/sched/lead.h"

#include <algorithm>

#include "host/sched/binding.h"

namespace urgengo::sched {
namespace {

/// Of two levels the other one is everybody's who has none.
constexpr int kFewLevels = 2;

}  // namespace

bool Lead::has_levels(const GovernedTask& task) const {
    return scheduler_.binding == config::Binding::kKernel &&
           num_levels(scheduler_.priority_levels, task.run.least_priority,
                      task.run.greatest_priority) > kFewLevels;
}

bool Lead::leads(const GovernedTask& task, nanoseconds now) const {
    return scheduler_.run_ahead_alone > scheduler_.run_ahead && company_.is_solitary(now) &&
           has_levels(task);
}

bool Lead::forks_ahead(const GovernedTask& task, bool is_vouched) const {
    return !is_vouched && task.launched - task.marked > task.planned(scheduler_.run_ahead) &&
           has_levels(task);
}

Levels Lead::levels(const GovernedTask& task, bool is_vouched, const Decision& decision, int wanted,
                    int num_levels, bool beside_bystanders, nanoseconds now) {
    if (leads(task, now) || forks_ahead(task, is_vouched)) {
        led_from_.store(task.launched, kRelaxed);
        leader_.store(&task, kRelaxed);
        return {.first = 1, .level = std::max(wanted, 1)};
    }
    const GovernedTask* leader = leader_.load(kRelaxed);
    if (leader && decision.before.contains(leader->index) && is_under_way(*leader)) {
        const int level = std::min(wanted + 1, num_levels - 1);
        return {.first = level, .level = level};
    }
    const bool leaves_last = beside_bystanders && num_levels > kFewLevels;
    return {.first = 0, .level = leaves_last ? std::min(wanted, num_levels - 2) : wanted};
}

// What went unasked since the last launch that was asked about may have been launched in the lead.
bool Lead::is_under_way(const GovernedTask& leader) const {
    return leader.executed() <=
           led_from_.load(kRelaxed) + leader.planned(scheduler_.run_ahead_alone);
}

}  // namespace urgengo::sched
