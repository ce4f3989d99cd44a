// SPDX-License-Identifier: Apache-2.0
//
// Reading and removing the names that a library exports: tried on the C library of this machine.
#include "interposer/elf_symbols.h"

#include <dlfcn.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <iterator>
#include <set>

#include "interposer/driver_file.h"
#include "tests/support/catch.h"

using namespace urgengo::interposer;

namespace {

std::string c_library() {
    Dl_info info;
    REQUIRE(dladdr(reinterpret_cast<void*>(&std::strtok), &info) != 0);
    std::ifstream file(info.dli_fname, std::ios::binary);
    std::string bytes{std::istreambuf_iterator<char>(file), {}};
    REQUIRE(bytes.size() > 100'000);
    return bytes;
}

std::set<std::string> names(std::string_view bytes) {
    std::set<std::string> all;
    for (const DynamicSymbol& symbol : defined_symbols(bytes)) all.emplace(symbol.name);
    return all;
}

}  // namespace

TEST_CASE("Exports are those of the library when its file is whole", "[unit][elf]") {
    const std::set<std::string> all = names(c_library());
    CHECK(all.size() > 1000);
    CHECK(all.count("strtok") == 1);
    CHECK(all.count("cuInit") == 0);
}

TEST_CASE("Exports lack the names that were taken back, and no others", "[unit][elf]") {
    std::string bytes = c_library();
    std::set<std::string> expected = names(bytes);
    undefine(bytes, {"no_such_name", "strspn", "strtok"});
    CHECK(expected.erase("strtok") + expected.erase("strspn") == 2);
    CHECK(names(bytes) == expected);
}

TEST_CASE("Places are those of the names, and none for a library with none of them",
          "[unit][elf]") {
    const std::string bytes = c_library();
    const auto places = places_in(bytes, {"no_such_name", "strspn", "strtok"});
    REQUIRE(places.size() == 3);
    CHECK(places[0] == 0);
    CHECK((places[1] != 0 && places[2] != 0 && places[1] != places[2]));
    CHECK(places_in(bytes, {"cuInit", "cuLaunchKernel"}).empty());
}

TEST_CASE("Exports are none, or some, when the file is damaged", "[unit][elf]") {
    std::string bytes = c_library();
    const std::size_t all = defined_symbols(bytes).size();
    for (const std::size_t size : {0, 3, 63, 64, 1000})
        CHECK(defined_symbols(std::string_view(bytes).substr(0, size)).empty());
    for (std::size_t size = 0; size < bytes.size(); size += bytes.size() / 97)
        CHECK(defined_symbols(std::string_view(bytes).substr(0, size)).size() <= all);
    // Whatever the header says about where tables lie.
    for (std::size_t at = 16; at < 64; ++at) {
        std::string damaged = bytes;
        damaged[at] = static_cast<char>(0xff);
        CHECK(defined_symbols(damaged).size() <= all);
    }
    std::string other_machine = bytes;
    other_machine[18] = 40;  // 32-bit ARM
    CHECK(defined_symbols(other_machine).empty());
    CHECK(defined_symbols("not a library").empty());
}
