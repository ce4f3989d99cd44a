// SPDX-License-Identifier: Apache-2.0
//
// Where the real driver lies in the address space. Without us the loader maps it when the first
// library that needs it is loaded, near the C library; with us, at the program's first call of it,
// below all that the program has mapped until then. 4 GiB from the C library and the CUDA runtime
// every call between them costs more: CPUs predict branches by the lower 32 bits of where they go.
// Measured on an H200's host with PyTorch, whose libraries take 4 GiB: eager ResNet-50 took 1.7 %
// longer in a process that had loaded us and did nothing else (tools/bench/program_cost.py). So
// room is kept beside us until the driver is loaded: addresses only, no memory.
#pragma once

#include <sys/resource.h>

#include <cstddef>

namespace urgengo::interposer {

/// What a process may map.
struct MappingLimits {
    rlim_t address_space = 0;      ///< RLIMIT_AS, in bytes
    rlim_t locked = 0;             ///< RLIMIT_MEMLOCK, in bytes
    std::size_t mapped_bytes = 0;  ///< what is mapped already; 0 if that is not known
};

/// @returns whether the program will hardly miss `size` bytes of addresses: neither what it may map
///          nor what it may lock (mlockall) is limited, or there is 16 times as much left of it; or
///          it has mapped more than it may lock already
bool can_do_without(const MappingLimits& limits, std::size_t size);

/// Of the calling process.
MappingLimits mapping_limits();

/// Keeps the highest free addresses for a library. No room is kept if the program cannot do
/// without it, or if there is none.
/// @param mapped_size  mapped_size() of the library's file; 0 keeps nothing
void keep_driver_room(std::size_t mapped_size);

/// Makes the addresses free again, for the library that is mapped next. Any thread, any number of
/// times.
void free_driver_room();

}  // namespace urgengo::interposer
