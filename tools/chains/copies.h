// SPDX-License-Identifier: Apache-2.0
//
// A workload of the same chain several times over: what grows with the number of chains is measured
// with equal ones. Pure.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "tools/chains/workload.h"

namespace urgengo::chains {

inline constexpr std::size_t kMaxCopies = 64;

/// @param index  from 0
/// @returns the name of a copy: x01C3 for the first of C3. It does not begin as the chain's does,
///          nor as another copy's, so the patterns C3* and x01C3* match what they say; with the
///          longest task, x01C9.calibrate, it is a thread's 15 bytes.
inline std::string copy_name(const std::string& chain, std::size_t index) {
    const std::string number = std::to_string(index + 1);
    return (number.size() < 2 ? "x0" : "x") + number + chain;
}

/// Leaves these chains, in the order asked for, each with the arrivals that it has among all.
/// @throws std::runtime_error naming a chain that the workload has not
void keep_only(Workload& workload, const std::vector<std::string>& names);

/// Makes each chain one of one task, with the first one's name: first all CPU time, then all
/// kernels.
/// @throws std::runtime_error naming a chain whose tasks take inputs of several sizes: what is one
///         task has one input
void merge_tasks(Workload& workload);

/// Puts `copies` copies in the place of each chain.
/// @throws std::runtime_error naming a thread's name that becomes too long
void make_copies(Workload& workload, std::size_t copies);

}  // namespace urgengo::chains
