// SPDX-License-Identifier: Apache-2.0
//
// A task's launches over streams (progress/stream_graph.h), and what is said of them to those who
// have not taken the task.
#pragma once

#include <atomic>
#include <cstdint>

#include "host/progress/closing_rule.h"
#include "host/progress/stream_graph.h"

namespace urgengo::runtime {

struct TaskStreams {
    // By the thread that has taken the task; `launched`: how many launches it has made,
    // TaskCounters::launches.
    /// Due whenever `graph` has changed.
    void note() {
        const bool forked = graph.is_forked();
        is_forked.store(forked, std::memory_order_release);
        if (forked) was_forked.store(true, std::memory_order_relaxed);
    }
    void all_executed(std::uint64_t launched) {
        graph.all_executed(launched);
        note();
    }
    /// Work that no thread was seen to wait for within a whole instance is not waited for.
    void begin_run(std::uint64_t launched) {
        graph.executed({.all = launches_at_begin, .on = {}}, launched);
        launches_at_begin = launched;
        note();
    }

    // Read by any thread:
    std::atomic<bool> is_forked{false}, was_forked{false};  ///< `graph` is; ever was
    std::atomic<bool> were_lost{false};  ///< ever used more at a time than are followed
    // By the thread that has taken the task only:
    progress::StreamGraph graph;
    progress::ClosingRule closing;
    std::uint64_t launches_at_begin = 0;  ///< when the last run began
};

}  // namespace urgengo::runtime
