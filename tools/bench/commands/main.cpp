// SPDX-License-Identifier: Apache-2.0
//
// urgengo-bench: what `urgengo bench` hands over to. One file a benchmark; this one lists them.
#include <exception>
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
#include "tools/urgengo/commands.h"
#include "tools/urgengo/exit_codes.h"

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

int dispatch(const std::vector<std::string>& arguments) {
    constexpr char kChains[] = "The ten chains";
    constexpr char kCosts[] = "What a call, a launch and a chain pay";
    Commands commands("Measures misses and costs, bare and under UrgenGo.", "urgengo bench");
    add(commands, kChains, add_bench_smoke, cmd_bench_smoke);
    add(commands, kChains, add_bench_instances, cmd_bench_instances);
    add(commands, kChains, add_bench_latency, cmd_bench_latency);
    add(commands, kCosts, add_bench_calls, cmd_bench_calls);
    add(commands, kCosts, add_bench_launches, cmd_bench_launches);
    add(commands, kCosts, add_bench_tracking, cmd_bench_tracking);
    add(commands, kCosts, add_bench_throughput, cmd_bench_throughput);
    add(commands, kCosts, add_bench_overhead, cmd_bench_overhead);
    return commands.dispatch(arguments);
}

}  // namespace
}  // namespace urgengo::cli

int main(int argc, char** argv) {
    using namespace urgengo::cli;
    try {
        return dispatch({argv + 1, argv + argc});
    } catch (const std::exception& error) {
        return fail(kExitFailure, error.what());
    }
}
