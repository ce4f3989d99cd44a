// SPDX-License-Identifier: Apache-2.0
//
// Which kernels are the next planned one, or known, in virtual time (runtime/as_planned.cpp).
#include <algorithm>
#include <vector>

#include "tests/support/as_planned_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using Fixture = AsPlannedFixture;

TEST_CASE("Without a profile an instance need not be like the last one", "[as_planned]") {
    Fixture f(true, false);
    const auto unasked = [&](const std::vector<Launch>& launches) {
        f.begin(f.thread_a, "tight");
        std::vector<bool> result;
        for (const Launch& launch : launches)
            result.push_back(f.launch_as_interposed(f.thread_a, launch));
        f.wait(f.thread_a, kStreamA);
        return result;
    };
    const Launch conv{kConv, 100, 256, kStreamA}, other{kOther, 7, 32, kStreamA};
    Launch larger = conv;
    larger.grid_blocks = 200;
    unasked({other, other, conv, conv});  // all are known now
    const std::vector<bool> all{false, true, true, true};
    CHECK(unasked({other, conv, other, conv}) == all);
    CHECK(unasked({conv, larger, conv, other}) == all);
    CHECK(unasked({conv, larger, conv, other}) == all);
    CHECK(f.stats(0).tasks.launches == 16);
    f.rt().contexts().forget_names();
    const std::vector<bool> all_but_other{false, true, true, false};
    CHECK(unasked({conv, larger, conv, other}) == all_but_other);  // it may have to be loaded
}

TEST_CASE("A kernel of the plan is known by the handle that launched it, and by any other",
          "[as_planned]") {
    Fixture f;
    const CUfunction again = reinterpret_cast<CUfunction>(0x30);
    f.driver.names[again] = "conv";
    const auto instance = [&](CUfunction function) {
        std::vector<bool> unasked;
        f.begin(f.thread_a, "tight");
        for (int i = 0; i < 5; ++i)
            unasked.push_back(f.launch_as_interposed(
                f.thread_a, {i == 3 ? function : kConv, 100, 256, kStreamA}));
        f.wait(f.thread_a, kStreamA);
        return unasked;
    };
    const std::vector<bool> all{false, true, true, true, true};
    CHECK(instance(kConv) == all);
    // A handle that was never launched may have to be loaded, and the next launch tells that it is.
    CHECK(instance(again) == std::vector<bool>{false, true, true, false, false});
    CHECK(instance(kConv) == all);
    CHECK(instance(again) == all);
    // A module was unloaded, and its handle is another kernel's.
    f.rt().contexts().forget_names();
    f.driver.names[again] = "other";
    CHECK(instance(again) == std::vector<bool>{false, true, true, false, false});
    CHECK(instance(again) == std::vector<bool>{false, true, true, false, true});
    CHECK(f.stats(0).tasks.unknown == 2);
}

TEST_CASE("A task without a profile is not asked about its kernels either", "[as_planned]") {
    Fixture f(true, false);
    f.begin(f.thread_a, "tight");
    CHECK_FALSE(f.planned());
    CHECK(f.planned());
    // A kernel that was never launched may have to be loaded: asked about. Then it is any other,
    // from the next launch on that is asked about.
    const Launch other{kOther, 7, 32, kStreamA};
    CHECK_FALSE(f.launch_as_interposed(f.thread_a, other));
    CHECK_FALSE(f.planned());
    CHECK(f.launch_as_interposed(f.thread_a, other));
    int asked = 0;
    for (int i = 5; i < 25; ++i) asked += !f.planned();
    CHECK(asked == 0);
    CHECK(f.driver.marks.empty());
    CHECK_FALSE(f.planned());  // 25 times 20 us: half of the run-ahead
    REQUIRE(f.driver.marks.size() == 1);
    CHECK(f.driver.marks[0].word0 >> 32 == 25);
    f.wait(f.thread_a, kStreamA);
    CHECK(f.stats(0).tasks.launches == 26);
    CHECK(f.stats(0).tasks.unknown == 0);  // nothing was promised
}

TEST_CASE("No kernel is asked about again because others lie where it does", "[as_planned]") {
    const bool has_profile = GENERATE(false, true);
    const std::uintptr_t distance = GENERATE(0x40, 0x5c0, 0x1000);
    Fixture f(true, has_profile);
    constexpr std::uintptr_t kKernels = 400;
    const auto handle = [&](std::uintptr_t i) {
        return reinterpret_cast<CUfunction>(0x7f0000001000 + distance * i);
    };
    for (std::uintptr_t i = 0; i < kKernels; ++i) f.driver.names[handle(i)] = "conv";
    const auto names_read = [&] {
        const int before = f.driver.num_name_queries;
        f.begin(f.thread_a, "tight");
        for (std::uintptr_t i = 0; i < kKernels; ++i) {
            f.launch_as_interposed(f.thread_a, {handle(i), 100, 256, kStreamA});
            f.driver.execute_marks(static_cast<int>(f.driver.marks.size()));
        }
        f.wait(f.thread_a, kStreamA);
        return f.driver.num_name_queries - before;
    };
    CHECK(names_read() == kKernels);
    CHECK(names_read() == 0);
    f.rt().contexts().forget_names();
    CHECK(names_read() == kKernels);
}

TEST_CASE("A thread that launches more kernels than it has room for knows the last of them",
          "[as_planned]") {
    struct Entry {
        const void* function = nullptr;
        std::uint64_t padding[3] = {};
    };
    identity::KernelCache<Entry> cache;
    std::vector<char> handles(10'000);
    for (const char& handle : handles) {
        CHECK(cache.find(&handle) == nullptr);
        cache.insert(&handle).function = &handle;
        const Entry* found = cache.find(&handle);
        REQUIRE(found != nullptr);
        CHECK(found->function == &handle);
    }
    const auto num_known = std::count_if(handles.begin(), handles.end(), [&](const char& handle) {
        return cache.find(&handle) != nullptr;
    });
    CHECK(num_known > 400);
    CHECK(cache.find(nullptr) == nullptr);
    cache.clear();
    CHECK(cache.find(&handles.back()) == nullptr);
}

namespace {

/// A task that launches each 100 us what takes the GPU 10 us and a fifth of it, beside another that
/// is more urgent.
struct BesideMoreUrgent : AsPlannedFixture {
    explicit BesideMoreUrgent(nanoseconds every) {
        for (config::ChainProfile& chain : resolved.profile->chains)
            for (std::size_t i = 0; i < 20; ++i) {
                config::KernelProfile& kernel = chain.tasks[0].kernels[i];
                kernel.gpu_time = 10us;
                kernel.launch_time = static_cast<int>(i) * every;
                kernel.utilization = i == 12 ? 0.4 : 0.2;
            }
        begin(thread_b, "tight");
        launch(thread_b, kStreamB);
        begin(thread_a, "loose");
    }
};

}  // namespace

TEST_CASE("A launch-bound task that may go beside others is asked now and then", "[as_planned]") {
    BesideMoreUrgent f(100us);
    for (int launched = 0; launched < 12; ++launched) {
        CAPTURE(launched);
        CHECK(f.planned() == (launched % 5 != 0));
        f.clock.advance(10us);
    }
    CHECK_FALSE(f.planned());  // it takes more of the GPU than what was asked about
    CHECK(f.stats(1).tasks.holds == 0);
    SECTION("and not for long") {
        REQUIRE(f.planned());
        f.clock.advance(201us);
        CHECK_FALSE(f.planned());
    }
    SECTION("and when another task comes or leaves") {
        REQUIRE(f.planned());
        f.wait(f.thread_b, kStreamB);
        CHECK_FALSE(f.planned());
    }
}

TEST_CASE("A GPU-bound task beside more urgent ones is asked about all launches", "[as_planned]") {
    BesideMoreUrgent f(5us);
    for (int launched = 0; launched < 12; ++launched) CHECK_FALSE(f.planned());
}
