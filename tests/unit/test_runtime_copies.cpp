// SPDX-License-Identifier: Apache-2.0
//
// An urgent copy beside a large one that is made in slices, in virtual time.
#include <algorithm>
#include <array>
#include <atomic>
#include <functional>
#include <memory>
#include <string>

#include "host/runtime/runtime.h"
#include "tests/support/catch.h"
#include "tests/support/copy_engine.h"
#include "tests/support/fake_driver.h"
#include "tests/support/fake_memory.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using runtime::Copy;
using runtime::CopyTurn;
using runtime::Runtime;
using runtime::ThreadState;
using std::chrono::nanoseconds;

namespace {

constexpr std::size_t kSlice = 8 * kMiB, kSmall = 64 << 10;
const CUstream kBulk = reinterpret_cast<CUstream>(0xa0), kUrgent = reinterpret_cast<CUstream>(0xb0),
               kOther = reinterpret_cast<CUstream>(0xc0);
/// What a driver's call takes, and a slice the engine.
constexpr nanoseconds kCall = 2us, kSliceTime = 155'521ns;

/// Chains `tight` (20 ms, if nothing else is said) and `loose` (10 s), which copy to the GPU.
struct RuntimeCopiesTest {
    FakeDriver driver;
    ScriptedClock clock;
    CopyEngine engine{clock};
    ThreadState bulk, urgent;
    std::unique_ptr<Runtime> runtime;
    CUresult record_result = CUDA_SUCCESS;
    std::uintptr_t num_events = 0;
    std::size_t small = 0;  ///< the last urgent copy
    nanoseconds small_submitted{0};
    nanoseconds query_time{0};                 ///< of an event, while somebody waits
    std::array<std::size_t, 2> last_urgent{};  ///< of copy_until()
    std::size_t num_urgent = 0;

    explicit RuntimeCopiesTest(std::chrono::milliseconds longest_hold = 0ms,
                               std::chrono::milliseconds tight_deadline = 20ms) {
        current = this;
        answer_of_memory(driver.api);
        driver.api.cuEventCreate = [](CUevent* event, unsigned) {
            *event = reinterpret_cast<CUevent>(++current->num_events);
            return CUDA_SUCCESS;
        };
        driver.api.cuEventRecord = [](CUevent event, CUstream stream) {
            if (current->record_result == CUDA_SUCCESS) current->engine.record(event, stream);
            return current->record_result;
        };
        driver.api.cuEventRecord_ptsz = driver.api.cuEventRecord;
        driver.api.cuEventQuery = [](CUevent event) {
            current->clock.pass(current->query_time);
            return current->engine.is_over(event) ? CUDA_SUCCESS : CUDA_ERROR_NOT_READY;
        };
        driver.api.cuStreamQuery = [](CUstream stream) {
            return current->engine.is_idle(stream) ? CUDA_SUCCESS : CUDA_ERROR_NOT_READY;
        };
        config::ResolvedConfig resolved;
        for (const auto& [name, deadline] :
             {std::pair{"tight", tight_deadline}, std::pair{"loose", 10'000ms}}) {
            config::Chain chain;
            chain.name = name;
            chain.period = chain.deadline = deadline;
            chain.tasks = {{"copy", std::string("th_") + name}};
            resolved.config.chains.push_back(chain);
        }
        resolved.config.scheduler.copies.hold = true;
        resolved.config.scheduler.copies.slice_bytes = kSlice;
        resolved.config.scheduler.hold.max_per_instance = longest_hold;
        runtime = std::make_unique<Runtime>(resolved, driver.api, clock);
        copy_large(256 * kMiB);  // the engine's speed is known from now on
    }
    ~RuntimeCopiesTest() { current = nullptr; }

    void begin(ThreadState& thread, const char* chain) {
        REQUIRE_FALSE(runtime->frames().task_begin(
            thread, runtime->frames().arrival(nullptr, chain, clock.now()), "copy"));
    }
    /// As the interposer does it.
    /// @returns the last slice
    std::size_t copy(ThreadState& thread, CUstream stream, std::size_t bytes) {
        const Copy copy{kDevice, kHost, bytes, stream};
        CopyTurn turn = runtime->copies().begin(thread, copy);
        std::size_t last = 0;
        for (std::size_t done = 0; done < bytes;) {
            const std::size_t part = turn.slice ? std::min(turn.slice, bytes - done) : bytes;
            if (turn.task) runtime->copies().before_slice(thread, copy, turn);
            clock.pass(kCall);
            last = engine.copy(stream, part);
            if (turn.task) runtime->copies().after_slice(thread, copy, turn, part);
            done += part;
        }
        if (turn.task) runtime->copies().end(turn);
        return last;
    }
    std::size_t copy_large(std::size_t bytes) {
        begin(bulk, "loose");
        const std::size_t last = copy(bulk, kBulk, bytes);
        wait(bulk, kBulk, last);
        runtime->frames().task_end(bulk);
        return last;
    }
    /// `tight` copies as long as the engine has no more than one of its copies, of a millisecond.
    void copy_until(nanoseconds end) {
        engine.gbps = 0.06;
        if (!urgent.task) begin(urgent, "tight");
        if (num_urgent < 2 || engine.end_of(last_urgent[num_urgent % 2]).count() != 0)
            last_urgent[num_urgent++ % 2] = copy(urgent, kUrgent, kSmall);
        if (clock.now() < end) clock.at(clock.now() + 200us, [=, this] { copy_until(end); });
    }
    /// `loose` wants to copy meanwhile. @returns how long it was held
    nanoseconds held_beside() {
        begin(bulk, "loose");
        copy(bulk, kBulk, kSmall);
        return nanoseconds(runtime->report().statistics()[1]->tasks.held_ns);
    }
    void copy_small() {
        begin(urgent, "tight");
        small = copy(urgent, kUrgent, kSmall);
        small_submitted = clock.now();
    }
    /// A wait of the program, until after that copy.
    void wait(ThreadState& thread, CUstream stream, std::size_t last) {
        runtime::Wait wait;
        wait.function = abi::TraceWait::kStream;
        wait.stream = stream;
        runtime->waits().before(thread, wait);
        while (engine.end_of(last).count() == 0) clock.pass(5us);
        runtime->waits().after(thread, wait, true);
    }
    nanoseconds small_waited() {
        while (engine.end_of(small).count() == 0) clock.pass(5us);
        return engine.end_of(small) - small_submitted;
    }
    std::uint64_t holds() { return runtime->report().statistics()[1]->tasks.holds; }

    inline static RuntimeCopiesTest* current = nullptr;
};

}  // namespace

TEST_CASE("Urgent copy waits for two slices at most, whenever it comes", "[runtime][copies]") {
    nanoseconds longest{0};
    for (nanoseconds offset = 1ms; offset < 1ms + 3 * kSliceTime; offset += 7us) {
        RuntimeCopiesTest f;
        f.clock.at(f.clock.now() + offset, [&] { f.copy_small(); });
        f.copy_large(256 * kMiB);
        INFO(offset.count());
        CHECK(f.small_waited() <= 2 * kSliceTime + 60us);
        longest = std::max(longest, f.small_waited());
        CHECK(f.holds() == 1);
    }
    CHECK(longest > kSliceTime);
}

TEST_CASE("Large copy is no slower with two slices under way", "[runtime][copies]") {
    RuntimeCopiesTest f;
    const nanoseconds begin = f.clock.now();
    const std::size_t last = f.copy_large(256 * kMiB);
    CHECK(f.engine.end_of(last) - begin <= 32 * kSliceTime + 40us);
}

TEST_CASE("Copy waits until a more urgent one is seen to end, however long that takes",
          "[runtime][copies]") {
    // The engine has become slower than is known: before the urgent copy are more than 1.1 ms. Who
    // went on after the 0.5 ms that it should take would keep the engine to the end.
    RuntimeCopiesTest f;
    f.clock.at(f.clock.now() + 1ms, [&] { f.engine.gbps = 15; });
    f.clock.at(f.clock.now() + 1500us, [&] { f.copy_small(); });
    f.copy_large(256 * kMiB);
    CHECK(f.small_waited() > 600us);
    CHECK(f.small_waited() <= 1200us);
    CHECK(f.holds() == 1);
}

TEST_CASE("Copy that comes is waited for before it is submitted, unless nothing comes of it",
          "[runtime][copies]") {
    RuntimeCopiesTest f;
    const Copy small{kDevice, kHost, kSmall, kUrgent};
    CopyTurn turn;
    std::size_t before = 0, meanwhile = 0;
    const auto num_copies = [&] { return f.engine.num_copies(); };
    f.clock.at(f.clock.now() + 1ms, [&] {
        f.begin(f.urgent, "tight");
        turn = f.runtime->copies().begin(f.urgent, small);
        f.runtime->copies().before_slice(f.urgent, small, turn);
        before = num_copies();
    });
    f.clock.at(f.clock.now() + 2ms, [&] {
        meanwhile = num_copies();
        f.runtime->copies().end(turn);  // the driver refused it
    });
    const nanoseconds begin = f.clock.now();
    const std::size_t last = f.copy_large(256 * kMiB);
    CHECK(meanwhile - before <= 1);  // the one that was just being submitted
    CHECK(f.engine.end_of(last) - begin < 32 * kSliceTime + 1ms + 100us);
    CHECK(f.holds() == 1);
}

TEST_CASE("Copy waits no longer than a bound for one that is not seen to end",
          "[runtime][copies]") {
    const bool by_time = GENERATE(false, true);
    RuntimeCopiesTest f;
    // Its stream is found idle, and then something comes before it that takes for ever.
    f.clock.at(f.clock.now() + 1ms, [&] {
        if (by_time) f.record_result = CUDA_ERROR_OUT_OF_MEMORY;
        f.begin(f.urgent, "tight");
        const Copy small{kDevice, kHost, kSmall, kUrgent};
        CopyTurn turn = f.runtime->copies().begin(f.urgent, small);
        f.runtime->copies().before_slice(f.urgent, small, turn);
        f.engine.work(kUrgent, 1s);
        f.engine.copy(kUrgent, kSmall);
        f.runtime->copies().after_slice(f.urgent, small, turn, kSmall);
        f.runtime->copies().end(turn);
        f.record_result = CUDA_SUCCESS;
    });
    const nanoseconds begin = f.clock.now();
    const std::size_t last = f.copy_large(256 * kMiB);
    const nanoseconds time = f.engine.end_of(last) - begin - 32 * kSliceTime;
    CHECK(time > (by_time ? 200us : 2ms));
    CHECK(time < (by_time ? 500us : 3ms));
    CHECK(f.holds() == 1);
}

TEST_CASE("Copy waits for others no longer than an instance may be held", "[runtime][copies]") {
    RuntimeCopiesTest f(1ms);
    f.clock.at(f.clock.now() + 1ms, [&] {
        f.engine.copy(kOther, 512 * kMiB);
        f.copy_small();
    });
    f.copy_large(256 * kMiB);
    CHECK(f.small_waited() > 2ms);
    CHECK(f.runtime->report().statistics()[1]->tasks.held_ns <= 1ms / 1ns + 50'000);
    CHECK(f.runtime->report().statistics()[1]->tasks.holds_opened == 1);
}

TEST_CASE("Held copy goes on beside a bystander that keeps the GPU busy", "[runtime][copies]") {
    const bool is_busy = GENERATE(false, true);
    RuntimeCopiesTest f(0ms, 5000ms);
    std::atomic<bool> launched{false};
    f.runtime->watch_bystanders(launched);
    const std::function<void()> launch = [&] {
        launched = is_busy;
        f.clock.at(f.clock.now() + 1ms, launch);
    };
    launch();
    f.copy_until(f.clock.now() + 1s);
    const nanoseconds held = f.held_beside();
    CHECK(f.holds() == 1);
    CHECK(held > (is_busy ? 30ms : 900ms));
    CHECK(held < (is_busy ? 50ms : 1100ms));
}

TEST_CASE("Held copy goes on when UrgenGo is switched off, and is counted until it does",
          "[runtime][copies][steering]") {
    RuntimeCopiesTest f(0ms, 5000ms);
    std::uint32_t word = 0;
    const auto holds_left_by_off = [&] {
        f.runtime->steering().obey(word = abi::next_control_word(word, abi::ControlCommand::kOff));
        return f.runtime->status().header().holds_left.load();
    };
    std::uint32_t left = 0;
    f.copy_until(f.clock.now() + 1s);
    f.clock.at(f.clock.now() + 20ms + 100us, [&] { left = holds_left_by_off(); });
    CHECK(f.held_beside() < 300ms);
    CHECK(f.holds() == 1);
    CHECK(left == 1);  // the word was obeyed inside the hold
    CHECK(holds_left_by_off() == 0);
}

TEST_CASE("Held copy keeps to the budget of looks", "[runtime][copies][poll]") {
    using sched::PollBudget;
    RuntimeCopiesTest f(0ms, 5000ms);
    f.copy_until(f.clock.now() + 2s);
    const int sleeps = f.clock.num_sleeps;
    const auto share = [&](nanoseconds held) {
        return (f.clock.num_sleeps - sleeps) * (f.query_time + PollBudget::kWakeUp) * 1.0 / held;
    };
    const auto said = [&] {
        const auto lines = f.runtime->report().warnings();
        return std::any_of(lines.begin(), lines.end(), [](const std::string& line) {
            return line.find("looks of held launches took more") != std::string::npos;
        });
    };
    SECTION("by looking less often") {
        f.query_time = 25us;
        const nanoseconds held = f.held_beside();
        CHECK(held > 2s);
        CHECK(share(held) < PollBudget::kShare);
        CHECK_FALSE(said());
    }
    SECTION("by going on where that is not enough") {
        f.query_time = 100us;
        CHECK(f.held_beside() < 6 * PollBudget::kWindow);
        CHECK(said());
    }
    CHECK(f.holds() == 1);
}

TEST_CASE("Copy goes on when the program has waited for the urgent one", "[runtime][copies]") {
    RuntimeCopiesTest f;
    f.clock.at(f.clock.now() + 1ms, [&] {
        f.record_result = CUDA_ERROR_OUT_OF_MEMORY;
        f.copy_small();
        f.record_result = CUDA_SUCCESS;
    });
    f.clock.at(f.clock.now() + 1ms + 100us, [&] {
        runtime::Wait wait;
        wait.stream = kUrgent;
        f.runtime->waits().before(f.urgent, wait);
        f.runtime->waits().after(f.urgent, wait, true);
    });
    f.copy_large(256 * kMiB);
    CHECK(f.runtime->report().statistics()[1]->tasks.held_ns <= 150'000);
}

TEST_CASE("Copy behind a kernel delays nobody before its stream has reached it",
          "[runtime][copies]") {
    RuntimeCopiesTest f;
    constexpr nanoseconds kKernel = 1500us;
    f.clock.at(f.clock.now() + 1ms, [&] {
        f.engine.work(kUrgent, kKernel);
        f.copy_small();
        CHECK(f.holds() == 0);
    });
    f.clock.at(f.clock.now() + 2ms + 400us, [&] { CHECK(f.holds() == 0); });
    const nanoseconds begin = f.clock.now();
    const std::size_t last = f.copy_large(256 * kMiB);
    CHECK(f.small_waited() <= kKernel + 2 * kSliceTime + 60us);
    CHECK(f.holds() == 1);
    CHECK(f.engine.end_of(last) - begin < 32 * kSliceTime + 200us);
}

TEST_CASE("Of another context only the time of a copy counts", "[runtime][copies]") {
    RuntimeCopiesTest f;
    f.clock.at(f.clock.now() + 1ms, [&] {
        f.engine.copy(kOther, 128 * kMiB);
        f.driver.context = reinterpret_cast<CUcontext>(0x43);
        f.copy_small();
        f.driver.context = reinterpret_cast<CUcontext>(0x42);
    });
    f.copy_large(256 * kMiB);
    CHECK(f.runtime->report().statistics()[1]->tasks.held_ns < 600'000);
    CHECK(f.runtime->report().statistics()[1]->tasks.held_ns > 300'000);
}
