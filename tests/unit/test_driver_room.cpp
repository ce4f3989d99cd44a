// SPDX-License-Identifier: Apache-2.0
//
// Room for the driver: when it is kept, and that the next large mapping gets it.
#include "interposer/driver_room.h"

#include <sys/mman.h>

#include <cstdint>

#include "tests/support/catch.h"
#include "tests/support/soft_limit.h"

using namespace urgengo::interposer;

namespace {

constexpr std::size_t kMiB = 1 << 20;

// Maps so much, and takes it away again. @returns where it was
std::uintptr_t place_of(std::size_t size) {
    void* const start =
        mmap(nullptr, size, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    REQUIRE(start != MAP_FAILED);
    munmap(start, size);
    return reinterpret_cast<std::uintptr_t>(start);
}

}  // namespace

TEST_CASE("Room for the driver is kept only when the program will hardly miss it",
          "[unit][driver_room]") {
    const rlim_t none = RLIM_INFINITY;
    const std::size_t size = 100 * kMiB, mapped = 10 * kMiB;
    CHECK(can_do_without({none, none, mapped}, size));
    CHECK(can_do_without({none, none, 0}, size));
    CHECK(can_do_without({mapped + 16 * size, none, mapped}, size));
    CHECK_FALSE(can_do_without({mapped + 16 * size - 16, none, mapped}, size));
    CHECK_FALSE(can_do_without({mapped, none, mapped}, size));
    CHECK_FALSE(can_do_without({mapped - 1, none, mapped}, size));
    CHECK(can_do_without({none, mapped + 16 * size, mapped}, size));
    CHECK_FALSE(can_do_without({none, mapped + 16 * size - 16, mapped}, size));
    CHECK_FALSE(can_do_without({none, mapped, mapped}, size));
    // Locking all that it maps fails with and without room.
    CHECK(can_do_without({none, mapped - 1, mapped}, size));
    CHECK_FALSE(can_do_without({mapped + size, mapped - 1, mapped}, size));
    CHECK_FALSE(can_do_without({none, 8 * kMiB, 0}, size));  // what is mapped is not known
    CHECK_FALSE(can_do_without({}, size));
}

TEST_CASE("Limits of mappings are those of this process", "[unit][driver_room]") {
    const MappingLimits limits = mapping_limits();
    rlimit expected{};
    REQUIRE(getrlimit(RLIMIT_MEMLOCK, &expected) == 0);
    CHECK(limits.locked == expected.rlim_cur);
    REQUIRE(getrlimit(RLIMIT_AS, &expected) == 0);
    CHECK(limits.address_space == expected.rlim_cur);
    CHECK(limits.mapped_bytes > kMiB);
    void* const more =
        mmap(nullptr, 512 * kMiB, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    REQUIRE(more != MAP_FAILED);
    CHECK(mapping_limits().mapped_bytes >= limits.mapped_bytes + 512 * kMiB);
    munmap(more, 512 * kMiB);
}

TEST_CASE("Room for the driver is taken by what is mapped after it was freed",
          "[unit][driver_room]") {
    constexpr std::size_t kSize = 512 * kMiB;
    const urgengo::testing::SoftLimit little(RLIMIT_MEMLOCK, 64 << 10);
    REQUIRE(can_do_without(mapping_limits(), 2 * kSize));
    // Nothing else is mapped meanwhile, by the checks, say.
    const std::uintptr_t before = place_of(kSize);
    keep_driver_room(0);
    const std::uintptr_t nothing_kept = place_of(kSize);
    keep_driver_room(kSize);
    const std::uintptr_t beside = place_of(kSize);
    keep_driver_room(kSize);
    const std::uintptr_t beside_one = place_of(kSize);
    free_driver_room();
    const std::uintptr_t freed = place_of(kSize);
    free_driver_room();
    const std::uintptr_t freed_twice = place_of(kSize);
    keep_driver_room(kSize);
    const std::uintptr_t kept_no_more = place_of(kSize);
    CHECK(beside + kSize <= before);
    CHECK(nothing_kept == before);
    CHECK(beside_one == beside);
    CHECK(freed == before);
    CHECK(freed_twice == before);
    CHECK(kept_no_more == before);
}
