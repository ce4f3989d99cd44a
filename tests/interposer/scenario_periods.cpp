// SPDX-License-Identifier: Apache-2.0
//
// Two periodic chains that bare are in time: says how many frames of each were late. `tight` takes
// 8 ms alone, has 24, and comes every 40 ms; `loose` 30 ms of every 50.
#include <time.h>

#include <array>
#include <cstdlib>
#include <string>
#include <thread>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

constexpr std::int64_t kNsPerMs = 1'000'000, kNsPerS = 1'000'000'000;

std::int64_t now_ns() {
    timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * kNsPerS + t.tv_nsec;
}

void sleep_until(std::int64_t time_ns) {
    const timespec t{static_cast<time_t>(time_ns / kNsPerS), time_ns % kNsPerS};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr);
}

struct Periodic {
    const char* name;
    int kernels;  ///< that fill the GPU, for 0.5 ms each
    std::int64_t period_ms, deadline_ms;
    std::int64_t frames = 0, late = 0;
    std::int64_t late_frames_after = 0;  ///< of those in the last third
};

void run(const Gpu& gpu, CUfunction kernel, Periodic& chain, std::int64_t begin_ns,
         std::int64_t end_ns) {
    name_this_thread(chain.name);
    MUST(cuCtxSetCurrent(gpu.context));
    const CUstream stream = make_stream();
    for (std::int64_t due = begin_ns; due < end_ns; due += chain.period_ms * kNsPerMs) {
        sleep_until(due);
        for (int i = 0; i < chain.kernels; ++i) MUST(launch_wide(kernel, stream));
        MUST(cuStreamSynchronize(stream));
        const bool is_late = now_ns() - due > chain.deadline_ms * kNsPerMs;
        ++chain.frames;
        chain.late += is_late;
        chain.late_frames_after += is_late && due > end_ns - (end_ns - begin_ns) / 3;
    }
}

/// Argument: seconds. Lines: name, frames, late ones, late ones in the last third.
int periods(const Arguments& arguments) {
    const std::int64_t seconds = arguments.empty() ? 1 : std::atoll(arguments[0].c_str());
    const Gpu gpu;
    CUmodule module = nullptr;
    MUST(cuModuleLoadData(&module, R"({"kernels": [{"name": "half_ms", "block_ns": 500000}]})"));
    CUfunction kernel = nullptr;
    MUST(cuModuleGetFunction(&kernel, module, "half_ms"));
    std::array chains{Periodic{"tight", 16, 40, 24}, Periodic{"loose", 60, 50, 50}};
    const std::int64_t begin_ns = now_ns() + 50 * kNsPerMs;
    std::array<std::thread, chains.size()> threads;
    for (std::size_t i = 0; i < chains.size(); ++i)
        threads[i] = std::thread(
            [&, i] { run(gpu, kernel, chains[i], begin_ns, begin_ns + seconds * kNsPerS); });
    for (std::thread& thread : threads) thread.join();
    for (const Periodic& chain : chains)
        say("%s %lld %lld %lld", chain.name, static_cast<long long>(chain.frames),
            static_cast<long long>(chain.late), static_cast<long long>(chain.late_frames_after));
    return 0;
}

const Scenario periods_scenario("periods", periods, Runs::kSimulated);

}  // namespace
}  // namespace twin
