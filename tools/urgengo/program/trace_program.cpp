// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/program/trace_program.h"

#include "host/base/atomic_file.h"
#include "host/config/resolved_config.h"

namespace urgengo::cli {

Result<TracedOutcome> trace_program(const ProgramSetup& setup,
                                    const std::vector<std::string>& program,
                                    const Environment& environment, const config::Config& config,
                                    const std::string& folder, const std::string& trace,
                                    double seconds, bool keeps_stdout) {
    TracedRun run;
    run.config = folder + "/watched.resolved.json";
    run.mode = "observe";
    run.keeps_stdout = keeps_stdout;
    run.what = "watching " + setup.name;
    run.trace = absolute(trace);
    run.limit = std::chrono::milliseconds(static_cast<std::int64_t>(seconds * 1000));
    const auto written =
        write_file_atomically(run.config, config::to_resolved_json(config, nullptr, {}));
    if (!written) return Error{written.error()};
    return run_traced(setup, program, environment, run);
}

}  // namespace urgengo::cli
