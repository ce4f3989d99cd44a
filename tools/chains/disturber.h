// SPDX-License-Identifier: Apache-2.0
//
// A thread that belongs to no chain and makes the driver calls that disturb others: those that wait
// for all work on the GPU, load code, need the whole GPU at once. At random, with random pauses, so
// that each meets the chains in any state (tools/bench/soak.py).
//
// A file tells which call is under way, for a program that finds this one hanging.
#pragma once

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <exception>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "tools/chains/gpu.h"
#include "tools/chains/report.h"

namespace urgengo::chains {

class Disturber {
  public:
    struct Options {
        std::optional<std::uint32_t> seed;  ///< none: no disturber
        std::vector<std::string> without;   ///< of kinds()
        std::string state_path;             ///< the file; empty: none

        void add_to(CLI::App& command);
        /// @returns the seed and what is left out; none
        std::string describe() const;
    };
    /// @throws std::runtime_error where the file cannot be written
    Disturber(const Gpu& gpu, Options options);
    ~Disturber();
    Disturber(const Disturber&) = delete;
    Disturber& operator=(const Disturber&) = delete;

    static const std::vector<std::string>& kinds();

    void start();
    void stop();
    /// After stop(). @throws what made the thread give up, if anything did
    void rethrow_error() const;
    /// After stop(). @returns how long each driver call took
    std::vector<CallReport> calls() const;

  private:
    struct Work;

    void run();
    void pause();
    template <typename Call>
    void timed(const char* name, Call&& call);
    void tell(const char* call);
    void allocate();
    void allocate_host();
    void register_host();
    void load_module();
    void launch_graph();
    void launch_cooperatively();
    void synchronize_context();

    const Gpu& gpu_;
    const Options options_;
    std::mt19937 random_;
    int state_file_ = -1;
    std::vector<void (Disturber::*)()> chosen_;
    std::map<std::string, std::vector<double>> times_us_;
    std::unique_ptr<Work> work_;
    std::exception_ptr error_;
    std::atomic<bool> stop_{false};
    std::thread thread_;
};

}  // namespace urgengo::chains
