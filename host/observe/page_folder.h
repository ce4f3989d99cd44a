// SPDX-License-Identifier: Apache-2.0
//
// The folder in which processes under UrgenGo leave their status pages (abi/status_page.h): names,
// which page is of a process that is there, and which was left behind by one that was killed.
//
// A page is left behind if its process has ended, if another process has its number since, or if
// the process has become another program (exec) which does not map it. Of a process in another pid
// namespace nothing can be known, nor where /proc is another namespace's: its page stays. A boot id
// proves nothing: containers that share the folder may have one each.
//
// Any user may put files into the folder. A page counts as its process' only if that process' user
// owns it.
//
// @threads any; /proc is read, nothing is kept
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace urgengo::observe {

inline constexpr char kPageFolder[] = "/dev/shm";

struct ProcessKey {
    std::uint32_t process = 0;
    std::uint64_t start_ticks = 0;    ///< 0: not known
    std::uint64_t pid_namespace = 0;  ///< 0: not known
    std::string boot_id;
};

ProcessKey own_process();

/// What is known of the process that a page names.
enum class Liveness {
    kThere,
    kStopped,    ///< by a signal, or a debugger: it goes on some time
    kGone,       ///< the page was left behind
    kElsewhere,  ///< in another pid namespace, or it cannot be told
};

/// @returns file name without a suffix
std::string page_stem(const ProcessKey& process);
inline constexpr char kPageSuffix[] = ".page", kControlSuffix[] = ".control",
                      kRecordsSuffix[] = ".records";

/// @returns paths of all pages in the folder, without suffixes, sorted; empty if it cannot be read
std::vector<std::string> list_pages(const std::string& folder);

/// @param stem  path of the page, without suffix
/// @param looks_for_exec  whether the process has become another program is looked for, in
///                        /proc/<pid>/maps: milliseconds of a large one
Liveness liveness_of(const ProcessKey& process, const std::string& stem,
                     bool looks_for_exec = true);

/// Of a file: what others cannot feign.
struct PageFile {
    std::uint32_t user = 0;   ///< that owns it
    bool is_for_all = false;  ///< any user may open it: UrgenGo makes no such file
};

/// @returns whether the file may be taken for the process': this user, root, or the process' user
///          owns it; of a process elsewhere, this user or root
bool may_be_of(const PageFile& file, const ProcessKey& process, Liveness liveness);

/// Removes its files. @returns whether the page is gone
bool remove_page(const std::string& stem);

/// What UrgenGo did before it switched itself off in a program is kept after that program's end:
/// the page and its records, of the last so many of a user's programs.
inline constexpr int kMostKept = 4;

/// The page's program comes to its end.
/// @param has_tripped  it is kept, if it has records; else its files are removed
void end_page(const std::string& stem, bool has_tripped);

/// Removes the pages that this user's processes have left behind, but for those that are kept;
/// root, everybody's.
/// @returns how many
int remove_stale_pages(const std::string& folder, bool looks_for_exec = true);

}  // namespace urgengo::observe
