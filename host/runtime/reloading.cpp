// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/reloading.h"

#include <utility>

#include "host/base/memory_orders.h"
#include "host/base/own_log.h"
#include "host/config/config_difference.h"
#include "host/config/file_text.h"
#include "host/sched/instance_slot.h"

namespace urgengo::runtime {
namespace {

// Who may steer need not be who may read what this process may: so of other files nothing is told,
// nor what is in one that is no config.
Result<config::ResolvedConfig> load_own(const std::string& path) {
    if (!path.starts_with('/')) return Error{path + ": is no file of this process' user"};
    bool was_read = false;
    auto resolved = config::load_for_interposer(path, [&](const std::string& file) {
        auto text = config::read_own_file(file);
        was_read = static_cast<bool>(text);
        return text;
    });
    if (resolved) return resolved;
    note(LogDetail::kInfo, "no config is reloaded: {}", resolved.error());
    return Error{path + (was_read ? ": is no config that can be taken: `urgengo check`, and the "
                                    "program's own log (URGENGO_LOG_FILE), tell its owner why"
                                  : ": is no file of this process' user")};
}

}  // namespace

Reloading::Reloading(Common& common, const config::ResolvedConfig& started_with)
    : common_(common), now_(started_with.config), mode_is_asked_(started_with.mode_is_asked) {}

Result<Reloading::Done> Reloading::reload(const std::string& path) {
    auto resolved = load_own(path);
    if (!resolved) return Error{resolved.error()};
    config::Config& next = resolved->config;
    if (mode_is_asked_) next.mode = now_.mode;
    const config::ConfigDifference found = config::difference(now_, next);
    if (!found.refused.empty())
        return Error{"only a new start changes this: " + config::joined(found.refused)};
    for (std::size_t i = 0; i < next.chains.size(); ++i) apply(i, next.chains[i]);
    common_.governor.company().describe(next.chains);
    sched::rank_chains(common_.governor.tasks());
    common_.governor.plan().reckon_load();
    common_.guard.pause();
    common_.governor.tasks().changed();
    const bool changes_mode = next.mode != now_.mode;
    now_ = std::move(next);
    return Done{found.changed.empty() ? "nothing has changed" : config::joined(found.changed),
                now_.mode, changes_mode};
}

void Reloading::apply(std::size_t index, const config::Chain& next) {
    ChainState& chain = *common_.roster.chains()[index];
    auto& reloaded = chain.reloaded;
    reloaded.period_ns.store(next.period.count(), kRelaxed);
    reloaded.deadline_ns.store(next.deadline.count(), kRelaxed);
    reloaded.mode.store(static_cast<int>(next.mode), kRelaxed);
    reloaded.on_late.store(static_cast<int>(next.on_late), kRelaxed);
    reloaded.criticality.store(next.criticality, kRelaxed);
    reloaded.max_consecutive_misses.store(next.max_consecutive_misses, kRelaxed);
    common_.guard.describe(index, next.period, next.deadline);
    common_.status.describe(index, next);
}

}  // namespace urgengo::runtime
