// SPDX-License-Identifier: Apache-2.0
//
// The simulated GPU in real time: an Engine, the thread that drives it, and the thread that runs
// host functions.
//
// Any thread submits: it appends to an inbox, stamped with the time, under one lock held for a few
// instructions. The engine's thread empties the inbox, plays it into the engine at the stamped
// times, and sleeps until something is due. It is woken only by a submission to an idle stream: on
// a busy one the engine looks into the inbox anyway when it completes what is there. Never
// destroyed: programs exit with work pending, and the threads must find their memory until the last
// moment.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "tools/simgpu/engine/engine.h"

namespace urgengo::simgpu {

class GpuThread {
  public:
    using QueuePtr = Engine::QueuePtr;

    /// Starts the threads and returns an object that lives until the process ends.
    static GpuThread& start(const Part& part, std::function<void(const KernelRecord&)> kernel_done);

    GpuThread(const GpuThread&) = delete;
    GpuThread& operator=(const GpuThread&) = delete;

    /// @returns the fence that passes when the work has completed
    Fence submit(const QueuePtr& queue, Work work, std::vector<Fence> fences = {});

    /// @returns the fence that passes when all that was submitted so far has completed
    Fence tail(const QueuePtr& queue);

  private:
    struct Item {
        Time at;
        QueuePtr queue;
        std::optional<Command> command;  ///< none: the host function at the stream's head returned
    };
    using HostCallItem = std::pair<QueuePtr, std::function<void()>>;

    GpuThread(const Part& part, std::function<void(const KernelRecord&)> kernel_done);
    ~GpuThread() = default;

    void post_locked(Item item, bool wake);
    [[noreturn]] void run_engine();
    [[noreturn]] void run_host_calls();

    std::mutex inbox_mutex_;
    std::condition_variable inbox_changed_;
    std::vector<Item> inbox_;
    bool wake_ = false;

    std::mutex host_calls_mutex_;
    std::condition_variable host_calls_changed_;
    std::deque<HostCallItem> host_calls_;

    Engine engine_;  ///< the engine thread's
};

}  // namespace urgengo::simgpu
