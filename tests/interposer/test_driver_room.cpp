// SPDX-License-Identifier: Apache-2.0
//
// Where the driver lies in a program that calls it late.
#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"
#include "tests/support/soft_limit.h"

using namespace urgengo::testing;

namespace {

struct Place {
    unsigned long long from_c_library_mib = 0;
    unsigned long mapped_mib = 0;
};

const std::string kLargeDriver = TEST_PROGRAMS "/large_driver";

Place place_of_driver(const Environment& environment = with_driver(preloaded(), "large_driver")) {
    const Outcome outcome = run({TEST_PROGRAMS "/driver_place", "1", kLargeDriver}, environment);
    INFO(outcome.err);
    REQUIRE(outcome.exit_status == 0);
    Place place;
    REQUIRE(std::sscanf(outcome.out.c_str(), "%llu %lu", &place.from_c_library_mib,
                        &place.mapped_mib) == 2);
    return place;
}

constexpr unsigned long long kFar_mib = 1024;
constexpr rlim_t kLittle = 64 << 10;  // no program has mapped less
constexpr rlim_t kSmallAddressSpace = 1536 << 20;

}  // namespace

TEST_CASE("Driver lies near the C library when the program has mapped much before it calls it",
          "[interposer][driver_room]") {
    const SoftLimit limit(RLIMIT_MEMLOCK, kLittle);
    CHECK(place_of_driver().from_c_library_mib < kFar_mib);
}

TEST_CASE("Driver has no room kept for it when the program's address space is limited",
          "[interposer][driver_room]") {
    const SoftLimit lock_limit(RLIMIT_MEMLOCK, kLittle);
    const Place with_room = place_of_driver();
    const SoftLimit limit(RLIMIT_AS, kSmallAddressSpace);
    const Place place = place_of_driver();
    CHECK(place.from_c_library_mib > kFar_mib);
    CHECK(place.mapped_mib + 90 < with_room.mapped_mib);
}

TEST_CASE("Driver has no room kept for it when the program may lock all that it has mapped",
          "[interposer][driver_room]") {
    Place without_room;
    {
        const SoftLimit limit(RLIMIT_AS, kSmallAddressSpace);
        without_room = place_of_driver();
    }
    rlimit may_lock{};
    REQUIRE(getrlimit(RLIMIT_MEMLOCK, &may_lock) == 0);
    const rlim_t locked = std::min(may_lock.rlim_max, rlim_t{1} << 30);
    if (locked >> 20 <= without_room.mapped_mib) {
        WARN("not tested: this user may not lock what a program maps");
        return;
    }
    const SoftLimit limit(RLIMIT_MEMLOCK, locked);
    const Place place = place_of_driver();
    CHECK(place.from_c_library_mib > kFar_mib);
    CHECK(place.mapped_mib == without_room.mapped_mib);
}

TEST_CASE("Driver lies near the C library when another copy of UrgenGo is found before it",
          "[interposer][driver_room]") {
    const SoftLimit limit(RLIMIT_MEMLOCK, kLittle);
    const Folder folder;
    std::filesystem::copy_file(INTERPOSER_FOLDER "/libcuda.so.1", folder.path() / "libcuda.so.1");
    Environment environment = with_driver(preloaded(), "large_driver");
    environment.erase("URGENGO_REAL_LIBCUDA");
    environment["LD_LIBRARY_PATH"] = folder.path().string() + ":" + kLargeDriver;
    CHECK(place_of_driver(environment).from_c_library_mib < kFar_mib);
}
