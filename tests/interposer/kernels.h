// SPDX-License-Identifier: Apache-2.0
//
// The kernels that scenarios launch, for both kinds of GPU: to the simulated one an image is a
// table of what blocks cost, to a real one it is PTX. Needs no CUDA library.
#pragma once

namespace twin {

/// @returns whether the driver is the simulated one: the tests name its file in TWIN_SIMGPU then
bool simulated();

/// The image of the kernels below, for the GPU that is there.
extern const char* const kImage;

/// void(uint64_t* to, uint64_t value, uint64_t tag): to[0] = value, to[1] = time << 16 | tag's
/// low 16 bits.
extern const char* const kStoreName;
/// void(uint64_t* word, uint64_t value): *word = 31 * *word + value. Where launches were lost,
/// repeated or out of order, the word tells.
inline constexpr const char* kMixName = "simgpu_mix";

/// The exit status of a scenario that is not for this GPU; nothing was done.
inline constexpr int kNotForThisGpu = 77;

// Kernels without parameters, which take a time: tiny (10 us), wide (300 us), long (5 ms),
// very_long (50 ms).

}  // namespace twin
