// SPDX-License-Identifier: Apache-2.0
#include "host/base/atomic_file.h"

#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "tests/support/catch.h"
#include "tests/support/folder.h"

using urgengo::write_file_atomically;
using urgengo::testing::Folder;
namespace fs = std::filesystem;

namespace {

std::string read(const fs::path& path) {
    std::ifstream file(path);
    return {std::istreambuf_iterator<char>(file), {}};
}

}  // namespace

TEST_CASE("A file is replaced whole and nothing is left beside it", "[base][atomic_file]") {
    const Folder folder;
    const fs::path path = folder.path() / "stats.json";
    REQUIRE(write_file_atomically(path, "old"));
    REQUIRE(write_file_atomically(path, "new"));
    CHECK(read(path) == "new");
    CHECK(std::distance(fs::directory_iterator(folder.path()), {}) == 1);
    struct stat status;
    REQUIRE(stat(path.c_str(), &status) == 0);
    CHECK((status.st_mode & 0600) == 0600);
}

TEST_CASE("A file that cannot be written is an error that names it", "[base][atomic_file]") {
    const auto result = write_file_atomically("/no/such/folder/x.json", "x");
    REQUIRE_FALSE(result);
    CHECK(result.error().find("/no/such/folder/x.json") != std::string::npos);
    CHECK(result.error().find("No such file or directory") != std::string::npos);
}
