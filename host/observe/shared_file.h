// SPDX-License-Identifier: Apache-2.0
//
// Files of ours that other programs map: the status page, its control word, the recorder's rings.
// What is written to has its memory before: a full folder or a limit is found out when the file is
// made, or a part of it is first used, not by a signal in the program.
#pragma once

#include <sys/types.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "urgengo/abi/status_page.h"

namespace urgengo::observe {

/// @returns the bytes in whole units of sections
constexpr std::size_t aligned(std::size_t bytes) {
    constexpr std::size_t kUnit = abi::kSectionAlignment;
    return (bytes + kUnit - 1) / kUnit * kUnit;
}

/// What does not fit is cut off before a UTF-8 character, not inside it.
/// @param to  size bytes; what is left is zero
void copy_name(char* to, std::size_t size, const std::string& name);
template <std::size_t N>
void copy_name(char (&to)[N], const std::string& name) {
    copy_name(to, N, name);
}

/// @returns file name of this process' executable
std::string program_name();

/// By number, or by its name in /etc/group: other sources of names would load libraries.
std::optional<unsigned> find_group(const std::string& group);

/// What a program that we are loaded into must find free in a folder that it may use itself, as
/// containers give /dev/shm 64 MiB: half of it, or a GiB.
constexpr bool leaves_enough(std::uint64_t total, std::uint64_t free, std::uint64_t bytes) {
    constexpr std::uint64_t kEnough = std::uint64_t{1} << 30;
    return free >= bytes && free - bytes >= std::min(total / 2, kEnough);
}
/// The same of the file system that the path is on; one without a limit has enough.
bool leaves_enough(const std::string& path, std::size_t bytes);

/// A store into a page of a file on a disk may wait for the disk, and end the program with SIGBUS
/// where that is full: not all file systems keep room that they have given.
/// @returns why files of the folder are not in memory alone; empty: they are
std::string why_not_in_memory(const std::string& folder);

struct MappedFile {
    void* memory = nullptr;  ///< null: errno says why not
    unsigned long long device = 0, inode = 0;
};

/// Maps a new file at the path, with all of its memory. Its descriptor is closed: programs close
/// those that they do not know.
/// @param mode  where there is a group; else it is its owner's alone
MappedFile map_file(const std::string& path, std::size_t bytes, mode_t mode,
                    std::optional<unsigned> group);

/// @param access  O_RDONLY or O_RDWR
/// @returns the file, open; -1 if there is none, or the path is another file's by now
int open_again(const std::string& path, const MappedFile& file, int access);

/// Maps a part behind those that there are, with its memory. Parts that are not there yet are not
/// mapped: a program that locks its memory would be given all of it.
/// @param offset  in whole pages
/// @returns null: there is no room, or the path is another file's by now
void* map_more(const std::string& path, const MappedFile& file, std::size_t offset,
               std::size_t bytes);

}  // namespace urgengo::observe
