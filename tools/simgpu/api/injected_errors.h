// SPDX-License-Identifier: Apache-2.0
//
// SIMGPU_FAIL="<what>:<n>:<CUresult>,...", where <what> is
//   <function>       the n-th call of that exported function does nothing and returns the result;
//   kernel:<name>    the n-th launch of the kernel of that name, whichever entry point carries it,
//                    does nothing and returns the result. One that the driver documents to leave
//                    the context unusable does: all that needs the context returns it from then on;
//   fault:<name>     that launch succeeds, and the context is unusable from the kernel's end on.
// n counts from 1 over all threads. Read when the library is loaded.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "host/base/result.h"

namespace urgengo::simgpu {

struct InjectedError {
    enum class On { kCall, kLaunch, kKernelEnd };

    On on = On::kCall;
    std::string name;        ///< of an exported function, or of a kernel
    std::uint64_t call = 0;  ///< from 1
    int code = 0;            ///< a CUresult
};

/// @returns whether a kernel that fails so takes its context with it
bool breaks_context(int code);

/// @returns what the text asks for; or what it found and what is accepted
Result<std::vector<InjectedError>> parse_injected_errors(std::string_view text);

}  // namespace urgengo::simgpu
