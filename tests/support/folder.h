// SPDX-License-Identifier: Apache-2.0
//
// A folder that goes with the object, and the files that a test puts into it.
#pragma once

#include <sys/stat.h>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>

#include "tests/support/catch.h"

namespace urgengo::testing {

class Folder {
  public:
    explicit Folder(const std::filesystem::path& in = std::filesystem::temp_directory_path()) {
        std::string pattern = (in / "urgengo_test_XXXXXX").string();
        REQUIRE(mkdtemp(pattern.data()) != nullptr);
        path_ = pattern;
    }
    ~Folder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;

    const std::filesystem::path& path() const { return path_; }
    std::string path(const std::string& name) const { return (path_ / name).string(); }

    /// Writes a file, and makes the folders on the way to it.
    /// @param mode  may be executed, unless said otherwise
    /// @returns its path
    std::string write(const std::string& name, const std::string& bytes, mode_t mode = 0755) const {
        const std::filesystem::path file = path_ / name;
        std::filesystem::create_directories(file.parent_path());
        std::ofstream(file, std::ios::binary) << bytes;
        REQUIRE(chmod(file.c_str(), mode) == 0);
        return file.string();
    }

  private:
    std::filesystem::path path_;
};

/// The same in memory, for status pages (observe/status_page.h).
class MemoryFolder : public Folder {
  public:
    MemoryFolder() : Folder("/dev/shm") {}
};

}  // namespace urgengo::testing
