// SPDX-License-Identifier: Apache-2.0
//
// What is written down of a hold (run_records.h) while it lasts: for another reason, or behind
// another task, it is another piece.
#pragma once

#include <chrono>
#include <cstdint>

#include "urgengo/abi/run_record.h"

namespace urgengo::runtime {

struct HoldPiece {
    std::uint8_t flags = 0;             ///< abi::kRunGate, kRunCopy, kRunPaced
    std::chrono::nanoseconds begin{0};  ///< 0: there is none
    abi::Why why = abi::Why::kNone;
    int behind = -1;  ///< task
};

}  // namespace urgengo::runtime
