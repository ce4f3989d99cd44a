// SPDX-License-Identifier: Apache-2.0
//
// What a user says in chains.yaml, and what a profile knows about the program: plain data.
//
// The CLI reads and validates the YAML (config_reader), merges the profile, and writes both as one
// JSON file (resolved_config) that the interposer reads. Nothing here does anything.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

namespace urgengo::config {

using std::chrono::nanoseconds;

enum class Mode { kOff, kObserve, kEnforce };
enum class OnLate { kContinue, kExit };
enum class Policy { kFeasible, kUrgency, kEdf };
enum class Binding { kNone, kKernel };
enum class Admission { kNone, kPacked };

struct Task {
    std::string name;
    std::string thread_glob;  ///< fnmatch pattern on the thread's name; empty: hints only
};

struct Chain {
    std::string name;
    nanoseconds period{0};    ///< > 0
    nanoseconds deadline{0};  ///< > 0, end to end, from the frame's arrival
    OnLate on_late = OnLate::kContinue;
    std::vector<Task> tasks;  ///< in the order in which a frame passes through them; not empty
};

/// The keys under `scheduler:`. A preset fills all of them; the keys that the user wrote override.
struct Scheduler {
    std::string preset = "urgengo";
    Policy policy = Policy::kFeasible;
    Binding binding = Binding::kKernel;
    Admission admission = Admission::kPacked;
    double pack_limit = 1.05;       ///< summed utilisation that may run side by side
    nanoseconds hold_poll{50'000};  ///< a held thread looks again after this long
    nanoseconds hold_max_per_instance{
        0};                            ///< holds may add this much to one instance; 0: its deadline
    nanoseconds run_ahead{1'000'000};  ///< estimated GPU time launched and not yet executed
    nanoseconds mark_every{200'000};   ///< estimated GPU time between two progress marks
};

struct Config {
    int version = 1;
    Mode mode = Mode::kEnforce;
    std::vector<Chain> chains;
    Scheduler scheduler;
    int connections = 32;  ///< CUDA_DEVICE_MAX_CONNECTIONS for the program; 0: keep
};

/// One launch of a task, in launch order.
struct KernelProfile {
    std::string name;
    std::uint64_t grid_blocks = 0;    ///< x*y*z
    std::uint32_t block_threads = 0;  ///< x*y*z
    nanoseconds gpu_time{0};          ///< alone on the GPU
    double utilization = 0;  ///< share of the GPU that it occupies, 0..1 (U_k in the paper)
};

struct TaskProfile {
    std::string name;
    nanoseconds cpu_time{0};  ///< CPU segment before the task's first launch
    std::vector<KernelProfile> kernels;
};

struct ChainProfile {
    std::string name;
    std::vector<TaskProfile> tasks;
};

struct Profile {
    int format_version = 1;
    std::string gpu;
    std::string driver;
    std::vector<ChainProfile> chains;
};

}  // namespace urgengo::config
