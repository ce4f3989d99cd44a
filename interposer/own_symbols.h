// SPDX-License-Identifier: Apache-2.0
//
// What the loader finds in us is what it would find in the real driver: names that the driver lacks
// are hidden, and names that it has at one address get one address here.
#pragma once

namespace urgengo::interposer {

/// Compares our exports with the driver's and changes our dynamic symbol table in memory, before
/// anybody but the loader's eager binding has looked into it. Reads the driver's file and loads
/// nothing. If any step fails all stays as it is, and it says so once.
void match_exports_to_driver();

}  // namespace urgengo::interposer
