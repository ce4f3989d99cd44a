// SPDX-License-Identifier: Apache-2.0
//
// A chain's tasks as the runtime keeps them: the plan, the slot in the active kernel buffer, and
// the run in progress.
//
// One thread at a time runs a task (its owner) and is the only one to touch `run` and to write the
// slot. A second thread that begins a task which is still owned is not scheduled.
#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <string>

#include "host/config/config.h"
#include "host/exec/progress_marks.h"
#include "host/model/task_plan.h"
#include "host/runtime/statistics.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::runtime {

using std::chrono::nanoseconds;

struct ThreadState;

struct ChainState {
    config::Chain config;
    std::vector<int> tasks;  ///< indices of its tasks, in order
    ChainStatistics statistics;
};

/// The instance that a task is working on; owner only.
struct TaskRun {
    nanoseconds arrival{0};
    std::uint32_t position = 0;  ///< launches so far
    bool on_gpu = false;         ///< in a GPU segment: counted in SharedPage::on_gpu
    bool marks_refused = false;  ///< without progress nothing more of this run is scheduled
    nanoseconds held{0};         ///< waited for others, in this instance
    nanoseconds paced{0};        ///< waited for its own run-ahead, in this instance
    CUstream stream = nullptr;   ///< of the last launch; it may be gone since
    exec::StreamFlavor flavor = exec::StreamFlavor::kLegacy;
    const exec::MarkContext* marks = nullptr;
    /// Launches before mark s: at [s % kMarkRing].
    std::array<std::uint32_t, abi::kMarkRing> position_at_mark{};
};

struct TaskState {
    int index = 0;  ///< slot and mailbox line
    ChainState* chain = nullptr;
    std::string name;
    std::string thread_glob;
    model::TaskPlan plan;
    nanoseconds later_gpu{0};  ///< of the chain's tasks after this one
    nanoseconds later_cpu{0};
    abi::TaskSlot* slot = nullptr;
    std::atomic<ThreadState*> owner{nullptr};
    std::atomic<const ug_mark_line*> line{nullptr};  ///< read by every thread that decides
    // Owner only:
    TaskRun run;
    nanoseconds launched{0};  ///< estimated GPU time of all launches ever
    nanoseconds marked{0};    ///< the same at the last mark
    bool overlaps = false;  ///< its kernels depend on each other programmatically: see after_launch
};

/// One frame's passage through one chain.
struct Instance {
    std::uint64_t token = 0;  ///< 0: none
    ChainState* chain = nullptr;
    nanoseconds arrival{0};
};

/// What the interposer keeps for each thread of the program; touched by that thread only.
struct ThreadState {
    TaskState* task = nullptr;        ///< whose launches these are; null: of no chain
    TaskState* named_task = nullptr;  ///< what `name` matched
    Instance instance;                ///< that the task belongs to, if hinted
    bool hinted = false;              ///< between task_begin and task_end
    bool uses_hints = false;          ///< ever hinted: its name does not count any more
    bool last_task = false;           ///< the hinted task is its chain's last
    bool name_is_fresh = false;       ///< the thread's name was read since its last wait
    char name[16] = {};

    /// Kernel names by handle: direct mapped, dropped when any module is unloaded.
    struct CachedName {
        const void* function = nullptr;
        std::uint64_t name_hash = 0;
    };
    static constexpr std::size_t kCachedNames = 512;
    std::array<CachedName, kCachedNames> names{};
    std::uint32_t names_epoch = 0;
};

}  // namespace urgengo::runtime
