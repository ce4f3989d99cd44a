// SPDX-License-Identifier: Apache-2.0
//
// The processes under UrgenGo that this user may look at.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/urgengo/page/page_reader.h"

namespace urgengo::cli {

/// @returns where pages lie: URGENGO_SHARE, as the processes have it, or /dev/shm
std::string page_folder();

/// Reads all pages in the folder, and removes those that were left behind, where it may. Pages that
/// others than their process' user have put there are passed over.
/// @param looks_for_exec  whether those are removed, too, whose process has become another program
///                        (observe/page_folder.h)
/// @returns those of processes that are there, the oldest first
std::vector<PageReading> find_pages(const std::string& folder, bool looks_for_exec = true);

/// Of those that there are, the ones that were asked for.
/// @param pid  in this pid namespace; 0: the only one. Processes of this pid namespace go before
///             others there, and this user's before those that others share; root's do not
/// @param all  all of them, perhaps none
Result<std::vector<PageReading>> choose_pages(const std::string& folder, std::uint32_t pid,
                                              bool all, bool looks_for_exec = true);

/// The one that was asked for, be it that of a process that was killed, or in which UrgenGo had
/// switched itself off before it ended: what it has left behind stays. Those that are there go
/// before those that are not, and of the latter the last one to start.
/// @param pid  0: the only one
/// @returns one
Result<std::vector<PageReading>> choose_page_with_gone(const std::string& folder,
                                                       std::uint32_t pid);

}  // namespace urgengo::cli
