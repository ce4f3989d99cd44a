// SPDX-License-Identifier: Apache-2.0
//
// A program that takes a lock around its launches: "loose" now and then, for one kernel, "urgent"
// for each of its own, every 20 ms. "middle" takes none and fills the GPU. Whoever holds loose's
// launch for middle's sake holds urgent's thread with it.
#include <atomic>
#include <chrono>
#include <mutex>
#include <thread>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kFrames = 60;
/// Bare it takes no time at all; a thread may be off its core for a while.
constexpr std::chrono::milliseconds kLong{100};

int locks(const Arguments&) {
    const Gpu gpu;
    std::mutex mutex;
    std::atomic<bool> go{true};
    std::thread middle([&] {
        name_this_thread("middle");
        MUST(cuCtxSetCurrent(gpu.context));
        const CUstream stream = make_stream();
        while (go) {
            for (int i = 0; i < 10000 && go; ++i) MUST(launch_wide(gpu.wide, stream));
            MUST(cuStreamSynchronize(stream));
        }
    });
    std::thread loose([&] {
        name_this_thread("loose");
        MUST(cuCtxSetCurrent(gpu.context));
        const CUstream stream = make_stream();
        while (go) {
            {
                const std::lock_guard lock(mutex);
                MUST(launch_wide(gpu.wide, stream));
            }
            MUST(cuStreamSynchronize(stream));
            std::this_thread::sleep_for(std::chrono::milliseconds(130));
        }
    });
    name_this_thread("urgent");
    const CUstream stream = make_stream();
    Clock::duration longest{0};
    auto next = Clock::now();
    for (int frame = 0; frame < kFrames; ++frame) {
        next = std::max(next + std::chrono::milliseconds(20), Clock::now());
        std::this_thread::sleep_until(next);
        for (int i = 0; i < 5; ++i) {
            const auto begin = Clock::now();
            const std::lock_guard lock(mutex);
            longest = std::max(longest, Clock::now() - begin);
            MUST(launch_tiny(gpu.tiny, stream));
        }
        MUST(cuStreamSynchronize(stream));
    }
    go = false;
    middle.join();
    loose.join();
    say("the lock came %s", longest < kLong ? "in time" : "late");
    return 0;
}

const Scenario s1("locks", locks);

}  // namespace
}  // namespace twin
