// SPDX-License-Identifier: Apache-2.0
#include "host/identity/kernels.h"

#include <algorithm>

#include "host/base/hash.h"
#include "host/config/names.h"
#include "host/identity/glob.h"
#include "host/identity/kernel_name.h"

namespace urgengo::identity {

void Kernels::add_task(int task, const std::vector<config::KernelPattern>& patterns) {
    for (const config::KernelPattern& p : patterns) patterns_.push_back({task, p.name_glob});
}

KnownKernel& Kernels::look_up(KernelsOfThread& known, observe::TraceCursor& cursor,
                              const Launch& launch, const void* handle) {
    KnownKernel& kernel = known.insert(handle);
    kernel.function = handle;
    if (!launch.function) {
        look_up_graph(kernel, cursor, launch.graph);
        return kernel;
    }
    kernel.is_new = seen_.is_new(launch.function);
    const NameGate::Reading reading(gate_);
    if (!reading) kernel.function = nullptr;  // asked again at its next launch
    const char* name = reading ? kernel_name(driver_, launch.function) : nullptr;
    if (!name) return kernel;
    kernel.name_hash = fnv1a64(name);
    model::TaskSet begins;
    for (const Pattern& p : patterns_)
        if (glob_fits(p.name_glob, name)) begins.insert(p.task);
    if (!begins.is_empty()) kernel.begins = kept(begins);
    if (trace_) trace_->add_text(cursor, kernel.name_hash, name);
    return kernel;
}

void Kernels::look_up_graph(KnownKernel& kernel, observe::TraceCursor& cursor, CUgraphExec graph) {
    static constexpr std::uint64_t kUnknown = fnv1a64(config::kGraphName);
    const auto unit = graphs_.find(graph);
    kernel.name_hash = unit ? unit->name_hash : kUnknown;
    kernel.utilization = unit ? static_cast<float>(unit->utilization) : 1;
    if (trace_) trace_->add_text(cursor, kernel.name_hash, unit ? unit->name : config::kGraphName);
}

// Few differ, as few as the config's patterns can tell apart; they stay.
const model::TaskSet* Kernels::kept(const model::TaskSet& set) {
    const std::lock_guard lock(sets_mutex_);
    const auto same = std::find(begin_sets_.begin(), begin_sets_.end(), set);
    return same != begin_sets_.end() ? &*same : &begin_sets_.emplace_back(set);
}

}  // namespace urgengo::identity
