// SPDX-License-Identifier: Apache-2.0
//
// What the library shows to the loader: it must pass for the driver, and bring nothing else along.
#include <filesystem>
#include <set>

#include "tests/interposer/elf_file.h"
#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo::testing;

namespace {

std::set<std::string> listed_names() {
    std::set<std::string> names;
    for (const auto& entry :
         std::filesystem::directory_iterator(SOURCE_FOLDER "/tools/codegen/exports"))
        for (const std::string& line : lines_of(read_text(entry.path())))
            if (!line.empty() && line.front() != '#') names.insert(line);
    return names;
}

const char* const kLibrary = INTERPOSER_FOLDER "/libcuda.so.1";

}  // namespace

TEST_CASE("Interposer exports every name of every driver when it is built",
          "[interposer][exports]") {
    const std::set<std::string> names = listed_names();
    REQUIRE(names.size() > 600);
    const std::set<std::string> exports = read_elf(kLibrary).exports;
    for (const std::string& name : names) {
        INFO(name);
        CHECK(exports.count(name) == 1);
    }
}

TEST_CASE(
    "Interposer exports nothing but the driver's names, the hints and NVTX's door when it is built",
    "[interposer][exports]") {
    const std::set<std::string> own{"ug_arrival",
                                    "ug_task_begin",
                                    "ug_task_end",
                                    "ug_status",
                                    "ug_position",
                                    "InitializeInjectionNvtx2",
                                    "InitializeInjectionNvtxExtension"};
    const std::set<std::string> names = listed_names();
    for (const std::string& name : read_elf(kLibrary).exports) {
        INFO(name);
        if (name.starts_with("ug_spare_")) continue;  // hidden when we are loaded
        CHECK(names.count(name) + own.count(name) == 1);
    }
}

TEST_CASE("Interposer has the driver's name when a program asks the loader for it",
          "[interposer][exports]") {
    CHECK(read_elf(kLibrary).soname == "libcuda.so.1");
}

#if !SANITIZED
TEST_CASE("Interposer needs only the C library when it is loaded into a program",
          "[interposer][exports]") {
    const std::set<std::string> allowed{"libc.so.6", "libm.so.6", "libgcc_s.so.1",
                                        "ld-linux-x86-64.so.2"};
    for (const std::string& name : read_elf(kLibrary).needed) {
        INFO(name);
        CHECK(allowed.count(name) == 1);
    }
}
#endif
