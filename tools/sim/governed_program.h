// SPDX-License-Identifier: Apache-2.0
//
// A program's chains and tasks as the runtime keeps them for the Governor, in virtual time: the
// active kernel buffer, plans and CPU segments, instances and their estimates, and the guard. What
// host/runtime does in runtime.cpp, instances.cpp and estimates.cpp, without threads that race,
// for programs that tell of their frames by hints, or whose frames come with their first calls.
//
// Times are the host's clock, which begins at kStart.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "host/config/config.h"
#include "host/model/unmarked_work.h"
#include "host/progress/stream_graph.h"
#include "host/sched/governor.h"
#include "host/sched/guard.h"

namespace urgengo::sim {

using std::chrono::nanoseconds;

struct SimTask : sched::GovernedTask {
    nanoseconds arrival{0};  ///< of its frame
    // Its launches over streams (governed_streams.h):
    int branch = 0;          ///< the last launch's
    bool has_moved = false;  ///< the launch at hand is on another one than the last
    std::uint64_t num_launches = 0, launches_at_begin = 0;
    progress::StreamGraph graph{};
    model::UnmarkedWork unmarked{};
    nanoseconds cpu_begin{0};  ///< of the CPU segment at hand; 0: none
    ug_mark_line mark_line{};
    // Batches, where launches wait for them (`tracking: overlapped`): the last one that the GPU has
    // executed, that is known to be, and that a launch waits for; 0: none.
    std::uint32_t ended = 0, published = 0, awaited_batch = 0;
    // Of a launch that waits:
    std::optional<sched::Wait> wait{};
    nanoseconds asleep_since{0};
    std::optional<nanoseconds> waits_for_turn_since;
    /// Of its launches behind gates (governed_gates.h):
    struct Gates {
        bool is_open = true;  ///< none is closed, as far as its thread knows
        bool is_hold = false;
        int branch = 0;
        nanoseconds since{0};
        std::uint32_t behind = 0;                ///< launches
        sched::Decision decision{};              ///< of the last group
        std::optional<std::uint32_t> awaited{};  ///< a launch sleeps until this gate is open
        bool awaits_all = false;
        nanoseconds asleep_since{0};
    } gates{};
};

class GovernedProgram final : sched::ProgressListener {
  public:
    static constexpr nanoseconds kStart{1'000'000'000};

    /// @param config  its scheduler schedules, or not; all chains have a profile
    GovernedProgram(const config::Config& config, const config::Profile& profile);

    SimTask& task(int chain, int stage) const { return *tasks_[index_of(chain, stage)]; }
    SimTask& task(int index) const { return *tasks_[static_cast<std::size_t>(index)]; }

    bool has_hints(int chain) const {
        return chains_[static_cast<std::size_t>(chain)]->config.arrival ==
               config::ArrivalFrom::kHint;
    }
    /// A frame has come.
    void arrived(int chain, nanoseconds arrival);
    /// Before a task. @returns whether the program is told to end the frame, which then has
    bool exits(SimTask& task, nanoseconds arrival, nanoseconds now);
    void begin(SimTask& task, nanoseconds arrival, nanoseconds now);
    void end(SimTask& task, nanoseconds now);
    void finished(int chain, nanoseconds latency, nanoseconds now);

    /// The task's first launch of a GPU segment is about to be made.
    void enter_gpu_segment(SimTask& task, nanoseconds now);
    /// @param idle  all that the task has launched has executed
    void leave_gpu_segment(SimTask& task, bool idle, nanoseconds now);
    /// What has not been launched yet.
    void publish_head(SimTask& task);
    sched::Request request_for(const SimTask& task) const;

    bool follows_marks() const {
        return scheduler_.progress.tracking == config::Tracking::kProgress;
    }
    const config::Scheduler& scheduler() const { return scheduler_; }
    int num_tasks() const { return static_cast<int>(tasks_.size()); }
    /// The active kernel buffer.
    abi::SharedPage& page() { return *page_; }

  private:
    std::size_t index_of(int chain, int stage) const {
        return static_cast<std::size_t>(
            chains_[static_cast<std::size_t>(chain)]->tasks[static_cast<std::size_t>(stage)]);
    }
    void add_task(sched::GovernedChain& chain, const config::TaskProfile& profile);
    void missed(sched::GovernedChain& chain);
    void tell_guard(std::size_t chain, nanoseconds latency, nanoseconds now);
    bool enforces(std::size_t chain) const;
    void progressed(sched::GovernedTask&, const sched::SlotView&, const ug_mark_line&,
                    nanoseconds) override {}

    const config::Scheduler scheduler_;
    const std::unique_ptr<abi::SharedPage> page_ = std::make_unique<abi::SharedPage>();
    sched::Guard guard_;
    std::vector<std::unique_ptr<sched::GovernedChain>> chains_;
    std::vector<std::unique_ptr<SimTask>> tasks_;

  public:
    sched::Governor governor;
};

}  // namespace urgengo::sim
