// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/scenario_options.h"

#include <algorithm>
#include <stdexcept>

#include "tools/chains/copies.h"
#include "tools/chains/files.h"
#include "tools/chains/spec.h"

namespace urgengo::chains {

void ScenarioOptions::add_to(CLI::App& command) {
    command.add_option("--workload", workload_path, "Workload written by `calibrate`")
        ->capture_default_str();
    command.add_option("--f-a", f_a, "Factor on arrival rates")
        ->check(CLI::Range(0.01, 100.0))
        ->capture_default_str();
    command.add_option("--f-d", f_d, "Factor on deadlines")
        ->check(CLI::Range(0.01, 100.0))
        ->capture_default_str();
    auto* fraction = command
                         .add_option("--f-tight", f_tight,
                                     "Fraction of chains whose deadline is halved, in the order "
                                     "C0 C3 C6 C8, then C1 C2 C4 C5 C7 C9")
                         ->check(CLI::Range(0.0, 1.0))
                         ->capture_default_str();
    command
        .add_option_function<std::vector<std::string>>(
            "--tight",
            [this](const std::vector<std::string>& names) {
                tight = names;
                tight_given = true;
            },
            "Chains whose deadline is halved, by name: C0,C3,C6,C8")
        ->delimiter(',')
        ->excludes(fraction);
    command
        .add_option("--threads", threads,
                    "Threads: one for each chain (C0), or one for each task (C0.detect3d)")
        ->check(CLI::IsMember({"chain", "task"}))
        ->capture_default_str();
    command
        .add_option("--only", only,
                    "These chains alone, each with the arrivals that it has among all: C3, or "
                    "C0,C3 [all]")
        ->delimiter(',');
    command
        .add_option("--copies", copies,
                    "So many copies of each chain in its place, each with arrivals of its own: "
                    "x01C3, x02C3 ...")
        ->check(CLI::Range(std::size_t{1}, kMaxCopies));
    command.add_flag("--merge-tasks", merge_tasks,
                     "One task a chain, of the first one's name: all its CPU time, then all its "
                     "kernels");
    command.add_flag("--no-deadlines", no_deadlines, "Nothing is late, whenever it ends");
}

Workload ScenarioOptions::load_workload() const {
    const std::string text = read_file(workload_path);
    Workload workload;
    try {
        workload = parse_workload(text);
    } catch (const std::runtime_error& error) {
        throw std::runtime_error(workload_path + ": " + error.what());
    }
    if (!only.empty()) keep_only(workload, only);
    if (merge_tasks) chains::merge_tasks(workload);
    if (copies > 0) make_copies(workload, copies);
    return workload;
}

Scenario ScenarioOptions::scenario(const Workload& workload) const {
    Scenario scenario{f_a, f_d, tight, !no_deadlines};
    if (!tight_given) {
        const std::vector<std::string> names = tight_chains(f_tight);
        for (const Chain& chain : workload.chains) {
            const std::string& name = chain.copy_of.empty() ? chain.name : chain.copy_of;
            if (std::find(names.begin(), names.end(), name) != names.end())
                scenario.tight.push_back(chain.name);
        }
    }
    check_scenario(scenario, workload);
    return scenario;
}

}  // namespace urgengo::chains
