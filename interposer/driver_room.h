// SPDX-License-Identifier: Apache-2.0
//
// Where the real driver lies in the address space. Without us the loader maps it with the first
// library that needs it; with us, at the program's first call of it, below all that has been mapped
// until then: in PyTorch 4 GiB from the C library, of which the driver asks something in every
// call. There eager ResNet-50 took 2.1 +- 0.3 % longer in a process that had loaded us and did
// nothing else, by hardly an instruction more; 1.0 +- 0.5 % with room kept for the driver beside us
// until it is loaded (addresses only, no memory), 0.3 +- 0.4 % with the driver loaded there at once
// (H200, tools/bench/results/2026-11-23_h200_driver_place.json).
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

/// Makes the addresses free again, for the library that is mapped next, and for good: no room is
/// kept any more. Any thread, any number of times.
void free_driver_room();

}  // namespace urgengo::interposer
