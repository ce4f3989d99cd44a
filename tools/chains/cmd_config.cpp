// SPDX-License-Identifier: Apache-2.0
//
// urgengo-chains config: writes chains.yaml and a profile for a calibrated workload, so that it can
// run under UrgenGo without `urgengo discover` and `urgengo profile`.
#include <cstdio>
#include <memory>

#include "tools/chains/cmd.h"
#include "tools/chains/files.h"
#include "tools/chains/scenario_options.h"
#include "tools/chains/scheduler_files.h"

namespace urgengo::chains {

namespace {

struct ConfigOptions {
    ScenarioOptions scenario;
    std::string yaml_path = "chains.yaml";
    std::string profile_path = "chains.profile.json";
    std::string on_late = "exit";
};

void run_config(const ConfigOptions& options) {
    const Workload workload = options.scenario.load_workload();
    const Scenario scenario = options.scenario.scenario(workload);
    const OnLate on_late = options.on_late == "exit" ? OnLate::kExit : OnLate::kContinue;
    write_file(options.yaml_path,
               format_yaml(workload, scenario, on_late, options.scenario.thread_mode()));
    write_file(options.profile_path, format_profile(workload));
    std::fprintf(stderr, "wrote %s and %s\n", options.yaml_path.c_str(),
                 options.profile_path.c_str());
}

}  // namespace

void add_config(CLI::App& app) {
    auto options = std::make_shared<ConfigOptions>();
    CLI::App* command =
        app.add_subcommand("config", "Write UrgenGo's configuration and profile for a workload");
    options->scenario.add_to(*command);
    command->add_option("--yaml", options->yaml_path, "Configuration to write")
        ->capture_default_str();
    command->add_option("--profile", options->profile_path, "Profile to write")
        ->capture_default_str();
    command->add_option("--on-late", options->on_late, "What to do with a frame that must be late")
        ->check(CLI::IsMember({"exit", "continue"}))
        ->capture_default_str();
    command->callback([options] { run_config(*options); });
}

}  // namespace urgengo::chains
