// SPDX-License-Identifier: Apache-2.0
//
// urgengo-export: what `urgengo export` hands over to. A program of its own, so that the others
// start where there is no prometheus-cpp.
#include <exception>

#include "tools/urgengo/cmd_export.h"
#include "tools/urgengo/commands.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/export/serve_metrics.h"

int main(int argc, char** argv) {
    using namespace urgengo::cli;
    try {
        Commands commands("Serves metrics of processes under UrgenGo.", "urgengo");
        commands.add(
            "While it runs", add_export,
            [](const ExportOptions& options, const auto&) { return serve_metrics(options); },
            Commands::Takes::kArguments);
        return commands.dispatch({argv + 1, argv + argc});
    } catch (const std::exception& error) {
        return fail(kExitFailure, error.what());
    }
}
