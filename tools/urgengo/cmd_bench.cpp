// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_bench.h"

#include <unistd.h>

#include <cstring>

#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"

namespace urgengo::cli {

CLI::App* add_bench(CLI::App& app, BenchCommand&) {
    return app.add_subcommand("bench", "Measure misses and costs (urgengo bench --help)");
}

int cmd_bench(const BenchCommand&, const std::vector<std::string>& arguments) {
    const auto program = bench_program();
    if (!program) return fail(kExitNotFound, program.error());
    std::vector<char*> words = {const_cast<char*>(program->c_str())};
    for (const std::string& argument : arguments) {
        words.push_back(const_cast<char*>(argument.c_str()));
    }
    words.push_back(nullptr);
    execv(program->c_str(), words.data());
    return fail(kExitNotExecutable, *program + ": " + std::strerror(errno));
}

}  // namespace urgengo::cli
