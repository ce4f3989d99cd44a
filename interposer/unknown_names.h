// SPDX-License-Identifier: Apache-2.0
//
// Names that this machine's driver exports and we do not know, as they are newer than we are:
// NVTX's cuNvtxGetInjectionInitializer, say, without which a tool gets no data. The loader finds
// them in us all the same, and gives the driver's own function.
//
// For that we have spare symbols (ug_spare_*), each an indirect function: the loader calls it, and
// takes what it returns. If there are unknown names, and only then, spare symbols get them, and the
// loader's hash table is made anew in its place: same size, same buckets, another order. What asks
// for a name meanwhile, in another thread, may not find it, or find another one; that is while the
// library is loaded, before its names are known to others, unless it is opened for all to see. So
// it is done on request only (URGENGO_NEW_NAMES).
#pragma once

#include <string_view>
#include <vector>

namespace urgengo::interposer {

inline constexpr int kMostUnknownNames = 32;

/// @param driver  the bytes of the driver's file
/// @returns the names that it exports, begin with cu, and are in no list of ours; the first few
std::vector<std::string_view> unknown_names(std::string_view driver);

/// Shows these names. All spare symbols are hidden (own_symbols.cpp).
/// @returns false if that cannot be: all is as before
/// @throws std::bad_alloc before anything was changed
bool show_unknown_names(const std::vector<std::string_view>& names);

}  // namespace urgengo::interposer
