// SPDX-License-Identifier: Apache-2.0
//
// What a launch needs of its thread if it is of no chain, or needs no question to the Governor: one
// cache line, which the interposer keeps in the thread's own storage (interposer/every_call.h).
#pragma once

#include <cstddef>
#include <cstdint>

#include "host/exec/driver_api.h"

namespace urgengo::abi {
struct SharedPage;
struct TaskSlot;
}  // namespace urgengo::abi
namespace urgengo::model {
struct PlannedKernel;
}

namespace urgengo::runtime {

/// In the thread's storage, which a library that is opened late has a place in only if it asks for
/// no more than the C library's own alignment.
#ifdef __x86_64__
inline constexpr std::size_t kThreadLineAlignment = 64;
#else
inline constexpr std::size_t kThreadLineAlignment = 16;  // mostly two lines
#endif

struct alignas(kThreadLineAlignment) ThreadLine {
    /// Read by the wrappers at every call: this thread's launches on `passes_stream` are of no
    /// chain, until so many of its waits have passed, or a hint comes.
    bool passes = false;
    exec::StreamFlavor flavor = exec::StreamFlavor::kLegacy;  ///< of the last launch
    static_assert(sizeof(exec::StreamFlavor) == 1);
    std::uint16_t waits_to_pass = 0;
    std::uint32_t launches = 0;  ///< for a task or while tracing
    CUstream passes_stream = nullptr;
    CUstream stream = nullptr;  ///< of the last launch

    /// The launches that this thread may make without being asked, as long as they are those of the
    /// plan and nothing changes (runtime/as_planned.h).
    struct AsPlanned {
        model::PlannedKernel* kernel = nullptr;  ///< the next one; null until any was allowed
        const abi::SharedPage* page = nullptr;
        abi::TaskSlot* slot = nullptr;  ///< the task's
        std::uint32_t left = 0;         ///< so many
        std::uint32_t changes = 0;      ///< SharedPage::changes
        std::int16_t priority = 0;
        bool set_priority = false;
        bool is_watched = false;   ///< by others on the GPU: the times of its launches count
        bool has_plan = false;     ///< `kernel` moves on; else it is what was launched last
        bool may_go_on = false;    ///< once none is left, more may be allowed: it is a slow task's
        bool is_observed = false;  ///< of a run that is not scheduled: what changes is others'
    };
    [[no_unique_address]] AsPlanned as_planned;

    /// Inside a wrapper: what the driver, or a library inside it, calls from there passes through.
    bool inside = false;

    /// The next launch is asked about. Among others for calls after which a default stream is
    /// another one.
    void ask_again() {
        as_planned.left = 0;
        as_planned.may_go_on = false;
    }
};
static_assert(sizeof(ThreadLine) <= 64);

}  // namespace urgengo::runtime
