// SPDX-License-Identifier: Apache-2.0
//
// The real libcuda.so.1: found as the loader would find it, opened once, kept for good.
#pragma once

#include <string>

#include "interposer/every_call.h"

namespace urgengo::interposer {

/// Opens the real driver and fills the entry-point table and real(). The first call does the work,
/// from whatever thread; later ones return at once. Never fails the program: without a driver every
/// entry point answers CUDA_ERROR_NO_DEVICE.
void load_real_driver();

/// The real driver's functions, typed, to forward the program's calls to: never null; one that the
/// driver lacks answers an error. Calls load_real_driver() when needed.
inline const exec::DriverApi& real();

/// The same for our own use: null where the driver lacks a function.
const exec::DriverApi& available();

namespace detail {
const exec::DriverApi& load_and_get_real();
}  // namespace detail

inline const exec::DriverApi& real() {
    const exec::DriverApi* loaded = g_every_call.real.load(std::memory_order_acquire);
    return loaded ? *loaded : detail::load_and_get_real();
}

/// @returns what the driver exports under a name; null if it does not
void* find_in_driver(const char* name);

/// @returns what the loader finds here under the name of a function that the driver exports; as it
///          is a function that the driver does not export
void* ours_for(void* real_function);

}  // namespace urgengo::interposer
