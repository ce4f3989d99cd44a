// SPDX-License-Identifier: Apache-2.0
//
// Where the real libcuda.so.1 lies, and what it exports, without loading it.
#pragma once

#include <string>
#include <vector>

#include "interposer/elf_symbols.h"

namespace urgengo::interposer {

/// @param library_path  LD_LIBRARY_PATH, or null
/// @returns paths in the loader's order: LD_LIBRARY_PATH, its cache, the default folders. (A
///          program's RPATH is not known here; drivers are not installed beside programs.)
std::vector<std::string> driver_candidates(const char* library_path);

/// @returns whether the library at `path` is a copy of ours
bool is_urgengo(const std::string& path);

/// A library file in memory, for as long as the object lives.
class MappedFile {
  public:
    explicit MappedFile(const std::string& path);
    ~MappedFile();
    MappedFile(const MappedFile&) = delete;
    MappedFile& operator=(const MappedFile&) = delete;
    /// Empty if the file cannot be read.
    std::string_view bytes() const { return bytes_; }

  private:
    std::string_view bytes_;
};

/// @param asked  URGENGO_REAL_LIBCUDA; empty: the first of driver_candidates() that is a library of
///               this machine and not UrgenGo's
/// @returns the driver's path; empty if there is none
std::string find_driver_file(const std::string& asked, const char* library_path);

/// @param names   sorted
/// @param driver  a library's bytes
/// @returns for each name where the library defines it, as an offset from its load address; 0 where
///          it does not. Empty if it defines none of them (it is no driver, or damaged).
std::vector<std::uint64_t> places_in(std::string_view driver,
                                     const std::vector<std::string_view>& names);

}  // namespace urgengo::interposer
