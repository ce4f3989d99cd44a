// SPDX-License-Identifier: Apache-2.0
//
// The workload's C3 so many times over, bare or under UrgenGo, without deadlines: what the benches
// of throughput and of scheduling overhead run. The profile is learned once, of one copy, and is
// every copy's.
#pragma once

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "host/base/result.h"
#include "host/config/config.h"
#include "tools/bench/smoke/bench_setup.h"

namespace urgengo::cli {

inline constexpr char kEqualChain[] = "C3";
/// Deadlines so many periods long that nothing is late, and that no launch is held until one.
inline constexpr int kDeadlinePeriods = 100;

struct EqualChainsOptions {
    double seconds = 12;
    int rounds = 3;
    std::uint32_t seed = 1;
    std::string workload;  ///< empty: calibrate
    std::string simgpu = "auto";
    std::string cpu = "auto", sync = "spin", queue = "latest";
    std::string interposer;    ///< for `urgengo run`; empty: the one beside us
    bool merge_tasks = false;  ///< one task a chain: more chains than half of a config's tasks
    std::string out;
};

/// Adds the options that both benches have.
void add_equal_chains_options(CLI::App& command, EqualChainsOptions& options);
/// The same by name, for the record.
nlohmann::ordered_json parameters_json(const EqualChainsOptions& options);

/// @param chain        as the workload's own config has it
/// @param merge_tasks  its first task is all of it
/// @returns the YAML of `num_chains` copies of it, at arrival rate f_a, without deadlines
std::string equal_chains_yaml(const config::Chain& chain, int num_chains, double f_a,
                              bool merge_tasks);

/// @param learned  of one copy
/// @returns the same of every copy
config::Profile profile_of_copies(config::Profile learned, int num_chains);

struct EqualChainsRun {
    std::string row;  ///< bare, or a preset
    int num_chains = 1;
    double f_a = 1;
    std::uint32_t seed = 1;
};

struct EqualChainsResult {
    nlohmann::ordered_json report;    ///< of the program
    nlohmann::ordered_json stats;     ///< of the scheduler; null of the bare row
    nlohmann::ordered_json own_time;  ///< null unless the interposer measures it
};

class EqualChains {
  public:
    /// Chooses the GPU and says so.
    /// @returns whether it may start; else `obstacle` says why not
    bool prepare(const EqualChainsOptions& options, BenchObstacle& obstacle);
    /// Calibrates, if need be, and learns the profile. To be called once, before run().
    /// @errors what failed; an empty text if it was interrupted
    Result<bool> learn();
    /// @errors the same; or that the row was not scheduled as its name says
    Result<EqualChainsResult> run(const EqualChainsRun& run);

    const ChosenGpu& gpu() const { return setup_.gpu; }

  private:
    Result<bool> write_config(int num_chains, double f_a);
    std::vector<std::string> program(int num_chains, double f_a, double seconds,
                                     std::uint32_t seed) const;
    std::string file(const char* name) const { return setup_.folder->path() + "/" + name; }

    EqualChainsOptions options_;
    BenchSetup setup_;
    Environment scheduled_;
    config::Chain chain_;
    config::Profile learned_;
    std::string program_;
};

/// What every bench's record begins with.
/// @param program  "urgengo bench throughput"
nlohmann::ordered_json record_of(const std::string& program, const EqualChains& chains,
                                 const EqualChainsOptions& options,
                                 const nlohmann::ordered_json& report,
                                 const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
