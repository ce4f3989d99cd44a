// SPDX-License-Identifier: Apache-2.0
//
// More than the GPU can do: threads that keep it full for ever, and one that has a little to do.
#include <atomic>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kGreedy = 4, kFrames = 8;
constexpr std::chrono::seconds kLongest{3};  // of a frame; bare it takes 120 ms

// The next frame begins as the last one ends.
void be_greedy(const Gpu& gpu, int number, const std::atomic<bool>& go) {
    name_this_thread("greedy_" + std::to_string(number));
    MUST(cuCtxSetCurrent(gpu.context));
    const CUstream stream = make_stream();
    while (go) {
        for (int i = 0; i < 20; ++i) MUST(launch_wide(gpu.wide, stream));
        MUST(cuStreamSynchronize(stream));
    }
}

int overload(const Arguments&) {
    const Gpu gpu;
    std::atomic<bool> go{true};
    std::atomic<Clock::rep> until{(Clock::now() + kLongest).time_since_epoch().count()};
    std::vector<std::thread> threads;
    for (int number = 0; number < kGreedy; ++number)
        threads.emplace_back(be_greedy, std::cref(gpu), number, std::cref(go));
    std::thread guard([&] {
        while (go && Clock::now().time_since_epoch().count() < until)
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        go = false;
    });
    name_this_thread("light");
    const CUstream stream = make_stream();
    for (int frame = 0; frame < kFrames && go; ++frame) {
        until = (Clock::now() + kLongest).time_since_epoch().count();
        for (int i = 0; i < 100; ++i) MUST(launch_wide(gpu.tiny, stream));
        MUST(cuStreamSynchronize(stream));
        say("frame %d %s", frame, go ? "ended" : "ended only when the others had");
    }
    go = false;
    guard.join();
    for (std::thread& thread : threads) thread.join();
    return 0;
}

const Scenario s1("overload", overload);

}  // namespace
}  // namespace twin
