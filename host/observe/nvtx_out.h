// SPDX-License-Identifier: Apache-2.0
//
// What we do, told to another NVTX tool (Nsight Systems, say) while it happens: ranges of instances
// and of what launches wait, marks of what goes wrong, where the GPU is on its own clock, and
// counters. All of it: nvtx_table.h.
//
// Without a tool each function is one predictable branch. With one it is called as the program
// itself calls NVTX: it takes what time it takes. Nothing is decided by it.
//
// @threads any, if nothing else is said. Begins and ends of a chain's instances take a mutex
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "host/config/config.h"
#include "host/model/gpu_clock.h"
#include "host/observe/miss_cause.h"
#include "host/observe/nvtx_link.h"
#include "host/sched/governor.h"

namespace urgengo::observe {

class NvtxOut {
  public:
    /// What is told of it; outlives this object.
    struct Source {
        const sched::Tasks& tasks;
        const model::GpuClock& gpu_clock;
        std::vector<std::string> task_names;  ///< by index
    };

    /// From here on the tool is told. Once.
    void attach(std::unique_ptr<NvtxLink> link, const Source& source);
    bool is_on() const { return is_on_.load(std::memory_order_acquire); }
    /// The process ends: what is under way has ended, and nothing is told any more. Waits for no
    /// thread: instances that one is just telling of are left without an end.
    void finish();

    // --- by the thread that has the task

    /// A run has begun: of its chain's first task, the instance, too.
    void run_begins(sched::GovernedTask& task, nanoseconds arrival, nanoseconds now) {
        if (is_on()) [[unlikely]]
            show_run(task, arrival, now);
    }
    void run_ends(sched::GovernedTask& task, nanoseconds now) {
        if (is_on()) [[unlikely]]
            show_run_end(task, now);
    }
    /// The first launch of a GPU segment is about to be made; the segment has ended.
    /// @param executed  all of it has
    void segment_begins(const sched::GovernedTask& task, nanoseconds now) {
        if (is_on()) [[unlikely]]
            of(task).segment_begin.store(now, std::memory_order_relaxed);
    }
    void segment_ends(const sched::GovernedTask& task, bool executed, nanoseconds now) {
        if (is_on() && executed) [[unlikely]]
            show_segment_end(task, now);
    }
    /// A launch waits; and goes, or its thread has jumped out of the hold.
    void wait_begins(sched::GovernedTask& task, const sched::Wait& wait, nanoseconds now) {
        if (is_on()) [[unlikely]]
            show_wait(task, wait, now);
    }
    void wait_ends(sched::GovernedTask& task, nanoseconds now) {
        if (is_on()) [[unlikely]]
            show_wait_end(task, now);
    }
    /// A launch goes at that stream priority.
    void priority(const sched::GovernedTask& task, int priority) {
        if (is_on()) [[unlikely]]
            show_priority(task, priority);
    }
    void gates(const sched::GovernedTask& task, nvtx::Word what) {
        if (is_on()) [[unlikely]]
            show_gates(task, what);
    }
    /// A round of ours has looked at gates: told with the next gates that are open. The thread of
    /// ours that opens gates calls no tool, which may wait for what is behind one.
    void round(int closed) { closed_in_round_.store(closed, std::memory_order_relaxed); }
    class Silent {
      public:
        Silent() { t_is_silent = true; }
        ~Silent() { t_is_silent = false; }
        Silent(const Silent&) = delete;
        Silent& operator=(const Silent&) = delete;
    };

    // --- of no task, or by any thread

    /// A frame has come to its end, or was given up at a task's begin.
    void frame_ended(const sched::GovernedChain& chain, nanoseconds arrival, nanoseconds now,
                     const Cause& cause, bool exited) {
        if (is_on()) [[unlikely]]
            show_frame_end(chain, arrival, now, cause, exited);
    }
    void dropped(const sched::GovernedChain& chain) {
        if (is_on()) [[unlikely]]
            show_dropped(chain);
    }
    /// A mark of the task was seen executed for the first time.
    void progressed(const sched::GovernedTask& task, const ug_mark_line& line) {
        if (is_on() && !t_is_silent) [[unlikely]]
            show_progress(task, line);
    }
    /// All gates are open while a call waits for the GPU.
    void dispatch(nvtx::Word what, int closed) {
        if (is_on()) [[unlikely]]
            show_dispatch(what, closed);
    }
    void mode(abi::StatusMode mode) {
        if (is_on()) [[unlikely]]
            show_mode(mode);
    }
    void tripped() {
        if (is_on()) [[unlikely]]
            show_trip();
    }
    void own_thread(std::uint32_t id) {
        if (is_on()) [[unlikely]]
            link()->name_thread(id, nvtx::kThreadName);
    }

  private:
    using Text = NvtxLink::Text;

    struct Task {
        const Text* name = nullptr;
        std::atomic<std::uint64_t> range{0}, wait{0};  ///< 0: none
        // The thread that has the task:
        nanoseconds laxity{0}, wait_laxity{0};
        sched::GovernedRun::Waited waited;  ///< before the wait
        const Text *behind = nullptr, *why = nullptr;
        int priority = 0;
        bool has_priority = false;
        std::atomic<nanoseconds> segment_begin{nanoseconds{0}};
        std::atomic<bool> looks{false};
        struct Mark {  // the last one; the thread that has `looks`
            std::uint16_t instance = 0;
            std::uint32_t position = 0;
            std::uint64_t stamp = 0;    ///< 48 bits
            std::int64_t gpu_time = 0;  ///< the same, without an end
            bool has_stamp = false;
        } mark;
    };
    struct Instance {
        std::uint64_t range = 0;  ///< 0: none
        std::int64_t number = 0;
        nanoseconds arrival{0}, laxity{0};
    };
    struct Chain {
        static constexpr std::size_t kInstances = 16;  ///< under way at a time
        const Text* name = nullptr;
        std::array<std::uint64_t, nvtx::kNumCounters> counters{};
        std::array<const Text*, nvtx::kNumCounters> counter_names{};
        // Under mutex_:
        std::array<Instance, kInstances> instances;
        std::size_t next = 0;
        std::int64_t num_instances = 0;
    };

    const NvtxLink* link() const { return its_link_.get(); }
    void show_run(sched::GovernedTask& task, nanoseconds arrival, nanoseconds now);
    void show_run_end(sched::GovernedTask& task, nanoseconds now);
    void show_wait(sched::GovernedTask& task, const sched::Wait& wait, nanoseconds now);
    void show_wait_end(sched::GovernedTask& task, nanoseconds now);
    void show_priority(const sched::GovernedTask& task, int priority);
    void show_gates(const sched::GovernedTask& task, nvtx::Word what);
    void show_frame_end(const sched::GovernedChain& chain, nanoseconds arrival, nanoseconds now,
                        const Cause& cause, bool exited);
    void show_dropped(const sched::GovernedChain& chain);
    void show_progress(const sched::GovernedTask& task, const ug_mark_line& line);
    void show_segment_end(const sched::GovernedTask& task, nanoseconds now);
    void show_executed(const sched::GovernedTask& task, std::uint16_t instance,
                       std::uint32_t position, std::uint64_t stamp);
    std::optional<std::uint64_t> stamp_at(nanoseconds host) const;
    void show_dispatch(nvtx::Word what, int closed);
    void show_mode(abi::StatusMode mode);
    void show_trip();

    Task& of(const sched::GovernedTask& task) {
        return tasks_[static_cast<std::size_t>(task.index)];
    }
    Chain& of(const sched::GovernedChain& chain) { return chains_[chain.index]; }
    nanoseconds laxity(sched::GovernedTask& task, nanoseconds now) const;
    void count(const sched::GovernedChain& chain, nvtx::Counter counter, std::int64_t value);
    void end_instance(const Chain& chain, const Instance& instance, nanoseconds deadline,
                      nanoseconds laxity, const Text* outcome, const Cause& cause) const;
    const Text* cause_text(MissCause cause) const {
        return causes_[static_cast<std::size_t>(cause)];
    }
    void sync_clocks();

    static constexpr int kNoRound = -1;
    static constinit inline thread_local bool t_is_silent = false;

    std::atomic<bool> is_on_{false};
    std::atomic<int> closed_in_round_{kNoRound};
    std::unique_ptr<NvtxLink> its_link_;  // from is_on_ on, to the end
    std::unique_ptr<Source> source_;
    std::vector<Task> tasks_;
    std::vector<Chain> chains_;
    std::array<const Text*, kNumCauses> causes_{};
    std::mutex mutex_;
    // Under sync_mutex_:
    std::mutex sync_mutex_;
    std::int64_t num_syncs_ = 0;
    model::GpuClock::Known first_sync_, last_sync_;
    std::int64_t last_sync_gpu_ = 0;
};

}  // namespace urgengo::observe
