// SPDX-License-Identifier: Apache-2.0
//
// What kernel launches and graph launches have in common.
#pragma once

#include "interposer/boundary.h"

namespace urgengo::interposer {

/// Asks the runtime about the launch, forwards it once, and tells the runtime.
/// @param plain        () -> CUresult: the program's own call, unchanged
/// @param prioritized  (int priority) -> CUresult: the same at a priority of ours
template <typename Plain, typename Prioritized>
CUresult scheduled_launch(const runtime::Launch& launch, Plain&& plain, Prioritized&& prioritized) {
    runtime::Grant grant;
    runtime::ThreadState* thread = nullptr;
    const Inside inside;
    protect([&] {
        thread = this_thread();
        if (thread) grant = the_runtime().before_launch(*thread, launch);
    });
    const CUresult result = grant.set_priority ? prioritized(grant.priority) : plain();
    if (grant.task || grant.traced)
        protect(
            [&] { the_runtime().after_launch(*thread, launch, grant, result == CUDA_SUCCESS); });
    return result;
}

}  // namespace urgengo::interposer
