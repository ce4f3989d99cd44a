// SPDX-License-Identifier: Apache-2.0
//
// A twin is an ordinary CUDA program that prints all it can observe, as text that is the same at
// every run: result codes, data, errno, the order of callbacks. Never handles, addresses or times.
// The tests run it bare and under UrgenGo; what it prints, and how it ends, must be equal.
#pragma once

#include <cuda.h>

#include <cerrno>
#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

namespace twin {

/// What follows the scenario's name on the command line.
using Arguments = std::vector<std::string>;

/// Where a scenario works: one that reads the simulated GPU's log, needs kernels that only it has,
/// or does what is undefined with a real driver, is not for a real GPU.
enum class Runs { kAnywhere, kSimulated };

/// One scenario of the program. A file defines some at namespace scope.
struct Scenario {
    /// @param run  @returns the program's exit status
    Scenario(const char* name, int (*run)(const Arguments&), Runs where = Runs::kAnywhere);
};

/// Writes one line to stdout: printf without a newline at the end.
__attribute__((format(printf, 1, 2))) void say(const char* format, ...);

/// What errno is before every call that show() makes.
inline constexpr int kErrno = 77;

/// Makes the call and says its text, its result and the errno that it leaves.
template <typename Call>
CUresult show(const char* text, Call&& call) {
    errno = kErrno;
    const CUresult result = std::forward<Call>(call)();
    // A real driver leaves a value of its own there now and then (EAGAIN of a lock, say).
    const int errno_after = std::getenv("TWIN_SIMGPU") ? errno : kErrno;
    say("%s = %d, errno %d", text, static_cast<int>(result), errno_after);
    return result;
}

/// Ends the program with status 99 and a line on stderr: the scenario itself does not work.
[[noreturn]] void give_up(const char* what, int result);

/// The program's own path.
std::string own_path();

}  // namespace twin

#define SHOW(call) ::twin::show(#call, [&] { return (call); })

/// For calls that only prepare: silent, and the end if they fail.
#define MUST(call)                                                       \
    do {                                                                 \
        const int result_of_must = static_cast<int>(call);               \
        if (result_of_must != 0) ::twin::give_up(#call, result_of_must); \
    } while (false)
