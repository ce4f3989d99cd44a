// SPDX-License-Identifier: Apache-2.0
//
// Runs one chain: its threads take frames as they arrive and carry each through the tasks.
//
//   1 The first thread waits for the next planned arrival and announces it (hint: arrival).
//   2 For each task: ask whether to go on (hint: task_begin), CPU segment, launch every kernel on
//     the thread's stream, synchronise, done (hint: task_end).
//   3 With a thread per task the frame then goes through a queue to the next task's thread.
// A frame's record is written by the thread that runs its first task, then by the one that ends it.
// Nothing depends on the hints but leaving a frame early. All times are CLOCK_MONOTONIC.
#pragma once

#include <atomic>
#include <chrono>
#include <exception>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "tools/chains/arrivals.h"
#include "tools/chains/checksum.h"
#include "tools/chains/frame_queue.h"
#include "tools/chains/gpu.h"
#include "tools/chains/position_sampler.h"
#include "tools/chains/report.h"
#include "tools/chains/scenario.h"
#include "tools/chains/stamps_file.h"
#include "tools/chains/task_runs.h"
#include "tools/chains/task_stream.h"
#include "urgengo/urgengo.h"

namespace urgengo::chains {

using Clock = std::chrono::steady_clock;

struct RunnerOptions {
    Threads threads = Threads::kPerChain;
    bool cpu_spin = true;      ///< CPU segments compute; else they sleep
    bool keep_latest = false;  ///< a waiting frame is dropped when a newer one comes
    bool stamps = false;       ///< launches say when they began and ended
};

/// What all chains of a run share; outlives them.
struct RunContext {
    const Gpu& gpu;
    const ug_hints& hints;
    RunnerOptions options;
    std::atomic<bool>& stop;  ///< begin no more frames; set by a signal, or by a chain that failed
};

/// What the kernels of a chain left behind, against what they must have.
struct Verification {
    std::uint64_t sum = 0, expected_sum = 0;
    unsigned missing_blocks = 0;  ///< launched less done, modulo 2^32
    unsigned misordered_blocks = 0;

    bool ok() const { return sum == expected_sum && missing_blocks == 0 && misordered_blocks == 0; }
};

class ChainRunner {
  public:
    /// @param chain  outlives this
    /// @param frees  its first task frees device memory between launching its kernels and waiting
    ///               for them: a call that waits for all work on the GPU
    ChainRunner(const RunContext& context, const Chain& chain, std::vector<PlannedFrame> frames,
                std::chrono::nanoseconds deadline, bool frees = false);
    ChainRunner(const ChainRunner&) = delete;
    ChainRunner& operator=(const ChainRunner&) = delete;
    ~ChainRunner();

    /// Starts the threads; frames arrive relative to `start`.
    void start(Clock::time_point start);
    /// Waits for the threads; call it on every runner before rethrow_error().
    void join();
    /// @throws what made a thread give up, if one did
    void rethrow_error() const;

    /// After join().
    const std::vector<InstanceRecord>& records() const { return records_; }
    Verification verify(const BlockValues& values) const;

    /// Its threads, each with a stream.
    std::size_t num_stages() const { return stages_.size(); }
    /// To be asked about while it runs; valid as long as this.
    PositionSampler::Target sampled_stage(std::size_t stage) const;
    /// After join(), with RunnerOptions::stamps.
    StampedStream stamped_stage(std::size_t stage) const;

  private:
    struct Frame {
        std::size_t index;
        ug_instance instance;
    };

    /// A thread, its stream, and the consecutive tasks that it runs.
    struct Stage {
        std::string thread_name;
        std::size_t first_task, end_task;
        TaskStream stream;
        FrameQueue<Frame> input;  ///< not used by the first stage
        Stage* next = nullptr;
        std::vector<std::vector<std::size_t>> launched;  ///< frames, of each of its tasks
        TaskRuns runs;
        std::exception_ptr error;
        std::thread thread;

        Stage(const RunContext& context, const Chain& chain, std::size_t first, std::size_t end,
              std::size_t num_frames);
    };

    void run_stage(Stage& stage);
    void take_arrivals(Stage& stage);
    void process(Stage& stage, const Frame& frame);
    void run_task(Stage& stage, std::size_t task, const Frame& frame);
    void finish(const Frame& frame, Outcome outcome);

    const RunContext& context_;
    const Chain& chain_;
    const std::vector<PlannedFrame> frames_;
    const std::chrono::nanoseconds deadline_;
    const bool frees_;
    Clock::time_point start_;
    std::vector<InstanceRecord> records_;  // one a frame
    std::vector<std::unique_ptr<Stage>> stages_;
};

}  // namespace urgengo::chains
