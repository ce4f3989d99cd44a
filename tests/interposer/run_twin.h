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
    Running(std::vector<std::string> arguments, const Environment& environment,
            unsigned longest_s = kLongest_s);
    Outcome wait();

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
    config.scheduler.priority_via = config::PriorityVia::kStreamAttribute;
    config.scheduler.progress_source = config::ProgressSource::kMemop;
    config.scheduler.hold_copies = true;
    config.scheduler.copy_slice_bytes = config::kCopySliceBytes.min;
}
inline void by_stream_pool(config::Config& config) {
    config.scheduler.priority_via = config::PriorityVia::kStreamPool;
    config.scheduler.progress_source = config::ProgressSource::kEvent;
    config.blocking_sync = true;
}
inline void by_events(config::Config& config) {
    config.scheduler.copy_slice_bytes = config::kCopySliceBytes.min;
    config.scheduler.progress_source = config::ProgressSource::kEvent;
}

/// The paper's ways of knowing the executing kernel, with batches that are over soon, and little
/// patience with what waits for something else.
inline auto dispatched_by(config::Dispatch who) {
    return [who](config::Config& config) { config.scheduler.dispatch = who; };
}
inline auto tracked_by(config::Tracking tracking) {
    return [tracking](config::Config& config) {
        config.scheduler.tracking = tracking;
        config.scheduler.eval_interval = std::chrono::microseconds(50);
        config.scheduler.hold_max_per_instance = std::chrono::milliseconds(1);
    };
}

/// @returns the lines of the text, without their ends
std::vector<std::string> lines_of(const std::string& text);

}  // namespace urgengo::testing
