// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/commands/bench_commands.h"

#include <string>
#include <vector>

#include "tools/bench/commands/cmd_bench_calls.h"
#include "tools/bench/commands/cmd_bench_instances.h"
#include "tools/bench/commands/cmd_bench_latency.h"
#include "tools/bench/commands/cmd_bench_launches.h"
#include "tools/bench/commands/cmd_bench_overhead.h"
#include "tools/bench/commands/cmd_bench_smoke.h"
#include "tools/bench/commands/cmd_bench_throughput.h"
#include "tools/bench/commands/cmd_bench_tracking.h"

namespace urgengo::cli {
namespace {

/// For the record, as the user wrote it: urgengo bench ...
template <typename Options, typename Run>
void add(Commands& commands, const std::string& group, CLI::App* (*declare)(CLI::App&, Options&),
         Run run) {
    commands.add(
        group, declare,
        [run](const Options& options, std::vector<std::string> arguments) {
            arguments.insert(arguments.begin(), "bench");
            return run(options, arguments);
        },
        Commands::Takes::kArguments);
}

}  // namespace

void add_bench_commands(Commands& commands) {
    constexpr char kChains[] = "The ten chains";
    constexpr char kCosts[] = "What a call, a launch and a chain pay";
    add(commands, kChains, add_bench_smoke, cmd_bench_smoke);
    add(commands, kChains, add_bench_instances, cmd_bench_instances);
    add(commands, kChains, add_bench_latency, cmd_bench_latency);
    add(commands, kCosts, add_bench_calls, cmd_bench_calls);
    add(commands, kCosts, add_bench_launches, cmd_bench_launches);
    add(commands, kCosts, add_bench_tracking, cmd_bench_tracking);
    add(commands, kCosts, add_bench_throughput, cmd_bench_throughput);
    add(commands, kCosts, add_bench_overhead, cmd_bench_overhead);
}

}  // namespace urgengo::cli
