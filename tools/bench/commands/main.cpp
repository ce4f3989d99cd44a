// SPDX-License-Identifier: Apache-2.0
//
// urgengo-bench: what `urgengo bench` hands over to. One file a benchmark; bench_commands.cpp lists
// them.
#include <exception>

#include "tools/bench/commands/bench_commands.h"
#include "tools/urgengo/exit_codes.h"

int main(int argc, char** argv) {
    using namespace urgengo::cli;
    try {
        Commands commands(kBenchDescription, "urgengo bench");
        add_bench_commands(commands);
        return commands.dispatch({argv + 1, argv + argc});
    } catch (const std::exception& error) {
        return fail(kExitFailure, error.what());
    }
}
