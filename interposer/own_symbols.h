// SPDX-License-Identifier: Apache-2.0
//
// What the loader finds in us is what it would find in the real driver: names that the driver lacks
// are hidden, names that it has at one address get one address here, and names that we do not know
// lead to the driver (unknown_names.h).
#pragma once

#include <string_view>

namespace urgengo::interposer {

/// Compares our exports with the driver's and changes our dynamic symbol table in memory, before
/// anything but the loader's eager binding has looked into it. If any step fails all stays as it
/// is, and it says so once.
/// @param driver  the bytes of the driver's file
/// @throws std::bad_alloc before anything was changed
void match_exports_to_driver(std::string_view driver);

}  // namespace urgengo::interposer
