// SPDX-License-Identifier: Apache-2.0
//
// Runs a twin in an environment of our making, and makes the files that set UrgenGo up for it.
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "host/config/config.h"
#include "host/config/limits.h"
#include "tests/support/folder.h"

namespace urgengo::testing {

using Environment = std::map<std::string, std::string>;

struct Outcome {
    int exit_status = 0;  ///< 128 + n if signal n ended it; a twin that hangs dies of SIGALRM
    std::string out;
    std::string err;
};

/// A program that has been started with these variables and no others.
class Running {
  public:
    static constexpr unsigned kLongest_s = 30;

    /// @param longest_s  seconds after which SIGALRM ends it
    /// @param input  its standard input; -1: this program's
    Running(std::vector<std::string> arguments, const Environment& environment,
            unsigned longest_s = kLongest_s, int input = -1);
    Outcome wait();
    int process() const { return child_; }

  private:
    Folder folder_;
    int child_;
};

/// Runs the program to its end.
Outcome run(const std::vector<std::string>& arguments, const Environment& environment);

/// Runs a scenario of `twin`.
Outcome run_twin(const std::vector<std::string>& arguments, const Environment& environment);

/// @returns whether twins run on the machine's GPU (URGENGO_TEST_DRIVER=real) instead of the
/// simulated one
bool on_real_gpu();
/// @returns where a file of the build lies: in URGENGO_TEST_FOLDER, which has the relative places
/// of a build folder, if that is set
std::string placed(const std::string& path);

/// The driver alone: the simulated one, or what the machine has.
Environment bare();
/// UrgenGo by LD_PRELOAD.
Environment preloaded();
/// UrgenGo by LD_LIBRARY_PATH, before the driver's folder.
Environment by_library_path();
/// @returns `environment`, one of these without a GPU, with that stub driver (CMakeLists.txt)
/// instead
Environment with_driver(Environment environment, const std::string& driver);
/// @returns `environment` with the config, in enforce mode unless it says otherwise, and statistics
/// written to the file `stats` if that is not empty
Environment configured(Environment environment, const std::filesystem::path& config,
                       const std::filesystem::path& stats = {});

std::string read_text(const std::filesystem::path& path);
void write_text(const std::filesystem::path& path, const std::string& text);

config::Chain chain(const std::string& name, std::chrono::nanoseconds deadline,
                    std::vector<config::Task> tasks);

/// Writes the resolved config that the interposer reads.
/// @param change  made to it before, if not empty
/// @returns its path
std::filesystem::path write_config(const std::filesystem::path& path, const std::string& preset,
                                   config::Mode mode, std::vector<config::Chain> chains,
                                   const config::Profile* profile = nullptr,
                                   const std::function<void(config::Config&)>& change = {});

/// Ways to go by that are not the default where a launch can carry a priority, and sources of
/// progress that are not.
inline void by_stream_attribute(config::Config& config) {
    config.scheduler.priority.via = config::PriorityVia::kStreamAttribute;
    config.scheduler.progress.source = config::ProgressSource::kMemop;
    config.scheduler.copies.hold = true;
    config.scheduler.copies.slice_bytes = config::kCopySliceBytes.min;
}
inline void by_stream_pool(config::Config& config) {
    config.scheduler.priority.via = config::PriorityVia::kStreamPool;
    config.scheduler.progress.source = config::ProgressSource::kEvent;
    config.blocking_sync = true;
}
inline void by_events(config::Config& config) {
    config.scheduler.copies.slice_bytes = config::kCopySliceBytes.min;
    config.scheduler.progress.source = config::ProgressSource::kEvent;
}

/// Gates, opened by this, or so by the GPU.
inline auto dispatched_by(config::Dispatch who) {
    return [who](config::Config& config) { config.scheduler.dispatch.where = who; };
}
inline auto dispatched_by(config::DeviceDispatch how) {
    return [how](config::Config& config) {
        config.scheduler.dispatch.where = config::Dispatch::kDevice;
        config.scheduler.dispatch.device = how;
    };
}
/// The paper's ways of knowing the executing kernel, with batches that are over soon, and little
/// patience with what waits for something else.
inline auto tracked_by(config::Tracking tracking) {
    return [tracking](config::Config& config) {
        config.scheduler.progress.tracking = tracking;
        config.scheduler.progress.eval_interval = std::chrono::microseconds(50);
        config.scheduler.hold.max_per_instance = std::chrono::milliseconds(1);
    };
}

/// Of a chain of the scenario `scheduling`.
inline constexpr int kSchedulingKernels = 5;  // of an instance
config::TaskProfile scheduling_profile(const std::string& chain_name);
/// Of a chain of the scenario `periods`, or of one that takes another time.
/// @param each  GPU time of a kernel
config::TaskProfile periods_profile(int kernels, std::chrono::nanoseconds each);
/// Of the scenario `hangs`: one launch of `loose` is held behind a kernel of `tight`, for ten
/// minutes. @param folder  of the config, and of the status page
Environment held_for_ever(const Folder& folder);

/// @returns the lines of the text, without their ends
std::vector<std::string> lines_of(const std::string& text);

}  // namespace urgengo::testing
