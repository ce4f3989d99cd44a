// SPDX-License-Identifier: Apache-2.0
//
// The twins' main: runs the scenario that the first argument names.
#include "tests/interposer/twin.h"

#include <unistd.h>

#include <array>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <map>

#include "tests/interposer/kernels.h"

namespace twin {
namespace {

struct Registered {
    int (*run)(const Arguments&);
    Runs where;
};

// Made by the first Scenario, whichever file's that is.
std::map<std::string, Registered>& scenarios() {
    static std::map<std::string, Registered> all;
    return all;
}

}  // namespace

Scenario::Scenario(const char* name, int (*run)(const Arguments&), Runs where) {
    scenarios()[name] = {run, where};
}

void say(const char* format, ...) {
    va_list values;
    va_start(values, format);
    flockfile(stdout);
    std::vprintf(format, values);
    std::putchar('\n');
    funlockfile(stdout);
    va_end(values);
}

void give_up(const char* what, int result) {
    std::fprintf(stderr, "twin: %s = %d\n", what, result);
    std::fflush(stdout);
    _exit(99);
}

std::string own_path() {
    std::array<char, 4096> path;
    const ssize_t length = readlink("/proc/self/exe", path.data(), path.size());
    if (length < 0) give_up("readlink of /proc/self/exe", errno);
    return {path.data(), static_cast<std::size_t>(length)};
}

}  // namespace twin

int main(int argc, char** argv) {
    const twin::Arguments arguments(argv + 1, argv + argc);
    const auto& all = twin::scenarios();
    const auto found = arguments.empty() ? all.end() : all.find(arguments.front());
    if (found == all.end()) {
        std::fprintf(stderr, "usage: %s SCENARIO [ARGUMENT...]\n", argv[0]);
        for (const auto& [name, registered] : all) std::fprintf(stderr, "  %s\n", name.c_str());
        return 98;
    }
    const auto& [run, where] = found->second;
    if (where == twin::Runs::kSimulated && !twin::simulated()) return twin::kNotForThisGpu;
    return run({arguments.begin() + 1, arguments.end()});
}
