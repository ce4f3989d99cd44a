// SPDX-License-Identifier: Apache-2.0
//
// Frames of equal kernels, launched in turns by two threads of one process: one whose name the
// config knows, and a bystander. What a frame of the first takes longer than the next one of the
// other is what UrgenGo costs there; clocks, temperature and the process are the same for both.
#pragma once

#include <vector>

#include "tools/bench/spin_gpu.h"

namespace urgengo::bench {

/// One kind of frame, in one situation: a chain of the config.
struct TrackingCell {
    int index = 0;        ///< its chain and thread are cell_chain(index)
    bool beside = false;  ///< another chain has work on the GPU all the time
    unsigned iterations = 0;
    int frame_launches = 0;
};

struct TrackedFrame {
    double gpu_us = 0;          ///< between events that take the time, before and behind the frame
    double elapsed_us = 0;      ///< with the wait for it
    double launch_cpu_us = 0;   ///< of the thread, in its launches
    double thread_cpu_us = 0;   ///< of the thread, with the wait
    double process_cpu_us = 0;  ///< of all threads
};

/// A frame of the chain, and one of the other thread right before or behind it.
struct FramePair {
    TrackedFrame chain, unscheduled;
};

/// @param seconds  for all pairs that are returned, which are a few at least
std::vector<FramePair> run_cell(const SpinGpu& gpu, const TrackingCell& cell, double seconds);

}  // namespace urgengo::bench
