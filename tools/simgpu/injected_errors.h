// SPDX-License-Identifier: Apache-2.0
//
// SIMGPU_FAIL="<function>:<n>:<CUresult>,...": the n-th call of that exported function, counted
// from 1 over all threads, does nothing and returns that CUresult. Read when the library is loaded.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "host/base/result.h"

namespace urgengo::simgpu {

struct InjectedError {
    std::string function;
    std::uint64_t call;  ///< from 1
    int code;            ///< a CUresult
};

/// @returns what the text asks for; or what it found and what is accepted
Result<std::vector<InjectedError>> parse_injected_errors(std::string_view text);

}  // namespace urgengo::simgpu
