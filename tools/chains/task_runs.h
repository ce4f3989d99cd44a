// SPDX-License-Identifier: Apache-2.0
//
// Every time that a thread has run a task on its stream: which of the stream's launches were that
// one's. Written by the thread; which run is under way now, any thread may ask without a lock.
#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

namespace urgengo::chains {

/// As written to a file: four 32-bit numbers.
struct TaskRun {
    std::uint32_t task = 0;          ///< in its chain
    std::uint32_t frame = 0;         ///< in its chain, from 0
    std::uint32_t first_launch = 0;  ///< index on the stream
    std::uint32_t num_launches = 0;
};
static_assert(sizeof(TaskRun) == 16, "written to a file");

class TaskRuns {
  public:
    /// A run and its task, as one word; 0: none.
    struct Current {
        std::uint64_t word = 0;
        explicit operator bool() const { return word != 0; }
        std::uint32_t run() const { return static_cast<std::uint32_t>(word >> 16) - 1; }
        std::uint32_t task() const { return static_cast<std::uint32_t>(word & 0xffff); }
        friend bool operator==(Current, Current) = default;
    };

    /// Room for so many, so that begin() never allocates.
    void reserve(std::size_t runs) { all_.reserve(runs); }
    /// Before the first launch. @threads the one that owns the stream
    void begin(const TaskRun& run) {
        all_.push_back(run);
        current_.store(std::uint64_t{all_.size()} << 16 | run.task, std::memory_order_release);
    }
    /// When all launches have ended. @threads the same
    void end() { current_.store(0, std::memory_order_release); }

    /// @threads any
    Current current() const { return {current_.load(std::memory_order_acquire)}; }
    /// After that thread has ended.
    const std::vector<TaskRun>& all() const { return all_; }

  private:
    std::vector<TaskRun> all_;
    std::atomic<std::uint64_t> current_{0};
};

}  // namespace urgengo::chains
