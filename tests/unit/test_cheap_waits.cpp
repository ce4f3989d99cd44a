// SPDX-License-Identifier: Apache-2.0
#include "host/exec/cheap_waits.h"

#include <functional>
#include <vector>

#include "tests/support/catch.h"
#include "tests/support/fake_driver.h"
#include "tests/support/governor_fixture.h"

using namespace urgengo;
using namespace urgengo::exec;
using namespace urgengo::testing;

namespace {

const CUstream kStream = reinterpret_cast<CUstream>(0xa0);
const CUevent kEvent = reinterpret_cast<CUevent>(0xe0);

/// Two chains, and a driver in which something is over when the test says so.
struct Fixture {
    FakeDriver driver;
    HookedClock clock;
    GovernorFixture others{{20ms, 100ms}};
    Captures captures{driver.api};
    std::vector<std::pair<char, void*>> asked;  ///< by which call, and for what
    CUresult answer = CUDA_ERROR_NOT_READY;
    bool relaxed = false;  ///< the thread's capture mode
    int asked_unrelaxed = 0;
    nanoseconds end{1h};  ///< after the wait's begin, when it is over
    nanoseconds begin{0};

    Fixture() {
        clock.advance(1ms);  // as the governor's
        begin = clock.now();
        current = this;
        driver.api.cuStreamQuery = [](CUstream s) { return current->ask('s', s); };
        driver.api.cuStreamQuery_ptsz = [](CUstream s) { return current->ask('t', s); };
        driver.api.cuEventQuery = [](CUevent e) { return current->ask('e', e); };
        driver.api.cuThreadExchangeStreamCaptureMode = [](CUstreamCaptureMode* mode) {
            const bool was = current->relaxed;
            current->relaxed = *mode == CU_STREAM_CAPTURE_MODE_RELAXED;
            *mode = was ? CU_STREAM_CAPTURE_MODE_RELAXED : CU_STREAM_CAPTURE_MODE_GLOBAL;
            return CUDA_SUCCESS;
        };
    }
    ~Fixture() { current = nullptr; }

    CUresult ask(char call, void* goal) {
        asked.emplace_back(call, goal);
        asked_unrelaxed += !relaxed;
        return clock.now() - begin >= end ? CUDA_SUCCESS : answer;
    }
    CheapWaits waits(bool wanted = true) {
        return {wanted, driver.api, clock, captures, others.governor};
    }
    /// @returns how long each sleep was
    std::vector<nanoseconds> sleeps(const CheapWaits::Goal& goal,
                                    sched::GovernedTask* task = nullptr) {
        std::vector<nanoseconds> slept;
        nanoseconds last = clock.now();
        const auto hook = clock.on_sleep;
        clock.on_sleep = [&] {
            slept.push_back(clock.now() - last);
            last = clock.now();
            if (hook) hook();
        };
        waits().sleep_until_over(goal, task);
        clock.on_sleep = hook;
        return slept;
    }

    inline static Fixture* current = nullptr;
};

nanoseconds sum(const std::vector<nanoseconds>& times) {
    nanoseconds total{0};
    for (const nanoseconds time : times) total += time;
    return total;
}

}  // namespace

TEST_CASE("Cheap waits are on where the config asks for them and UrgenGo enforces",
          "[exec][waits]") {
    Fixture f;
    CHECK(f.waits().are_on());
    CHECK_FALSE(f.waits(false).are_on());
    f.others.governor.steered().set(config::Mode::kObserve);
    CHECK_FALSE(f.waits().are_on());
}

TEST_CASE("A cheap wait asks about what the program waits for, and no more if it is over",
          "[exec][waits]") {
    Fixture f;
    f.end = 0ms;
    const auto asked = [&](const CheapWaits::Goal& goal) {
        f.asked.clear();
        CHECK(f.sleeps(goal).empty());
        REQUIRE(f.asked.size() == 1);
        return f.asked.front();
    };
    CHECK(asked({.stream = kStream}) == std::pair{'s', static_cast<void*>(kStream)});
    CHECK(asked({.stream = kStream, .flavor = StreamFlavor::kPerThread}) ==
          std::pair{'t', static_cast<void*>(kStream)});
    CHECK(asked({.stream = kStream, .event = kEvent}) ==
          std::pair{'e', static_cast<void*>(kEvent)});
    CHECK(f.asked_unrelaxed == 0);
    CHECK_FALSE(f.relaxed);
}

TEST_CASE("A cheap wait leaves it to the program's call what its errors are", "[exec][waits]") {
    Fixture f;
    f.answer = CUDA_ERROR_ILLEGAL_ADDRESS;
    CHECK(f.sleeps({.stream = kStream}).empty());
    f.answer = CUDA_ERROR_NOT_READY;
    f.clock.on_sleep = [&] { f.answer = CUDA_ERROR_ILLEGAL_ADDRESS; };
    CHECK(f.sleeps({.stream = kStream}).size() == 1);
}

TEST_CASE("A cheap wait asks the more seldom the longer it waits", "[exec][waits]") {
    Fixture f;
    f.end = 4ms;
    const auto slept = f.sleeps({.stream = kStream});
    CHECK(f.asked.size() == slept.size() + 1);
    CHECK(sum(slept) >= 4ms);
    CHECK(sum(slept) < 4100us);
    CHECK(slept.front() == 20us);
    CHECK(slept.back() == 100us);
    for (std::size_t i = 1; i < slept.size(); ++i) CHECK(slept[i] >= slept[i - 1]);
}

TEST_CASE("A cheap wait sleeps through most of what is launched", "[exec][waits]") {
    Fixture f;
    f.others.begin(0, 10ms);
    f.others.launch(0, 800us);
    sched::GovernedTask* const task = &f.others.task(0);
    SECTION("beside others") {
        f.others.page->on_gpu = 2;
        f.end = 800us;
        const auto slept = f.sleeps({.stream = kStream}, task);
        CHECK(slept.front() == 600us);  // three quarters
    }
    SECTION("alone, where it may be further than is known") {
        f.end = 800us;
        const auto slept = f.sleeps({.stream = kStream}, task);
        REQUIRE(slept.size() >= 3);
        CHECK(slept[0] == 150us);
        CHECK(slept[1] == 150us);
        CHECK(slept[2] == 300us);  // as long as it has waited
    }
    SECTION("a millisecond at most at a time") {
        f.others.page->on_gpu = 2;
        f.others.launch(0, 9ms);
        f.end = 20ms;
        CHECK(f.sleeps({.stream = kStream}, task).front() == 1ms);
    }
    SECTION("but not if it is not known for whom the wait is") {
        f.others.page->on_gpu = 2;
        f.end = 800us;
        CHECK(f.sleeps({.stream = kStream}).front() == 20us);
    }
}

TEST_CASE("A cheap wait ends, though what it waits for does not", "[exec][waits]") {
    Fixture f;
    SECTION("5 ms after twice what was launched") {
        CHECK(sum(f.sleeps({.stream = kStream})) >= 5ms);
        CHECK(f.clock.now() - f.begin < 5101us);
        f.begin = f.clock.now();
        f.others.begin(0, 10ms);
        f.others.launch(0, 2ms);
        const nanoseconds slept = sum(f.sleeps({.stream = kStream}, &f.others.task(0)));
        CHECK(slept >= 9ms);
        CHECK(slept <= 10ms);
    }
    SECTION("when UrgenGo is switched off") {
        f.clock.on_sleep = [&] { f.others.governor.steered().set(config::Mode::kOff); };
        CHECK(f.sleeps({.stream = kStream}).size() == 1);
        CHECK(f.asked.size() == 1);
    }
    SECTION("when a capture begins, of which nothing may be asked") {
        f.clock.on_sleep = [&] { f.captures.began(kStream, StreamFlavor::kLegacy); };
        CHECK(f.sleeps({.stream = kStream}).size() == 1);
        CHECK(f.asked.size() == 1);
        f.asked.clear();
        CHECK(f.sleeps({.stream = kStream}).empty());
        CHECK(f.asked.empty());
    }
}
