// SPDX-License-Identifier: Apache-2.0
//
// urgengo: the command line tool. One file a command; this one lists them.
#include <exception>
#include <string>
#include <vector>

#include "tools/urgengo/cmd_bench.h"
#include "tools/urgengo/cmd_check.h"
#include "tools/urgengo/cmd_discover.h"
#include "tools/urgengo/cmd_doctor.h"
#include "tools/urgengo/cmd_profile.h"
#include "tools/urgengo/cmd_run.h"
#include "tools/urgengo/cmd_sim.h"
#include "tools/urgengo/commands.h"
#include "tools/urgengo/exit_codes.h"

int main(int argc, char** argv) {
    using namespace urgengo::cli;
    using Takes = Commands::Takes;
    constexpr char kPrepare[] = "Before a run";
    constexpr char kRun[] = "Run";
    constexpr char kMeasure[] = "Measure";
    try {
        Commands commands("UrgenGo makes unmodified GPU programs meet their deadlines.", "urgengo");
        commands.add(kPrepare, add_doctor, cmd_doctor, Takes::kProgram);
        commands.add(kPrepare, add_discover, cmd_discover, Takes::kProgram);
        commands.add(kPrepare, add_check, cmd_check, Takes::kProgram);
        commands.add(kPrepare, add_profile, cmd_profile, Takes::kProgram);
        commands.add(kRun, add_run, cmd_run, Takes::kProgramOrFails);
        commands.add(kMeasure, add_sim, cmd_sim, Takes::kArguments);
        commands.add(kMeasure, add_bench, cmd_bench, Takes::kRest);
        return commands.dispatch({argv + 1, argv + argc});
    } catch (const std::exception& error) {
        return fail(kExitFailure, error.what());
    }
}
