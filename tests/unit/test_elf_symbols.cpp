// SPDX-License-Identifier: Apache-2.0
//
// Reading and removing the names that a library exports: tried on the C library of this machine.
#include "interposer/elf_symbols.h"

#include <dlfcn.h>
#include <elf.h>
#include <link.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <iterator>
#include <set>

#include "interposer/driver_file.h"
#include "tests/support/catch.h"

using namespace urgengo::interposer;

namespace {

// The C library's, or a sanitizer's before it.
std::string library_path() {
    Dl_info info;
    REQUIRE(dladdr(reinterpret_cast<void*>(&std::strtok), &info) != 0);
    return info.dli_fname;
}

std::string c_library() {
    std::ifstream file(library_path(), std::ios::binary);
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

TEST_CASE("Mapped size is that of the library in memory, and nothing when its file is damaged",
          "[unit][elf]") {
    const std::string bytes = c_library();
    struct Mapped {
        std::string path;
        ElfW(Addr) first = ~ElfW(Addr){0}, end = 0;
    } mapped{library_path()};
    dl_iterate_phdr(
        [](dl_phdr_info* info, std::size_t, void* data) {
            auto* m = static_cast<Mapped*>(data);
            if (m->path != info->dlpi_name) return 0;
            for (int i = 0; i < info->dlpi_phnum; ++i) {
                const ElfW(Phdr)& segment = info->dlpi_phdr[i];
                if (segment.p_type != PT_LOAD) continue;
                m->first = std::min(m->first, segment.p_vaddr);
                m->end = std::max(m->end, segment.p_vaddr + segment.p_memsz);
            }
            return 1;
        },
        &mapped);
    REQUIRE(mapped.end > mapped.first);
    CHECK(mapped_size(bytes) >= mapped.end - mapped.first);
    CHECK(mapped_size(bytes) < mapped.end - mapped.first + 2 * 4096);
    for (const std::size_t size : {0, 3, 63, 64, 100})
        CHECK(mapped_size(std::string_view(bytes).substr(0, size)) == 0);
    CHECK(mapped_size("not a library") == 0);
    // A segment that ends before it begins, and one that is larger than any driver.
    ElfW(Ehdr) header;
    std::memcpy(&header, bytes.data(), sizeof header);
    const std::size_t table = header.e_phoff, entry = sizeof(ElfW(Phdr));
    for (std::size_t i = 0; i < header.e_phnum; ++i) {
        std::uint32_t type = 0;
        std::memcpy(&type, bytes.data() + table + i * entry, sizeof type);
        if (type != PT_LOAD) continue;
        std::string damaged = bytes;
        std::memset(damaged.data() + table + i * entry + 40, 0xff, 8);  // p_memsz
        CHECK(mapped_size(damaged) == 0);
        std::memset(damaged.data() + table + i * entry + 40, 0, 8);
        damaged[table + i * entry + 40 + 5] = 1;  // 1 TiB
        CHECK(mapped_size(damaged) == 0);
    }
}
