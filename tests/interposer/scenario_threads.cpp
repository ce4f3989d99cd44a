// SPDX-License-Identifier: Apache-2.0
//
// Many threads, each with its own stream; threads that change their names; threads that come and
// go.
#include <atomic>
#include <thread>
#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

/// Launches and waits for some frames. @returns the sum of what came out, and of all results
std::uint64_t run_frames(const Gpu& gpu, const std::string& name, int num_frames, int num_launches,
                         std::uint64_t first) {
    name_this_thread(name);
    MUST(cuCtxSetCurrent(gpu.context));
    const CUstream stream = make_stream();
    std::uint64_t* to = make_mapped(2);
    std::uint64_t sum = 0;
    for (int frame = 0; frame < num_frames; ++frame) {
        for (int i = 0; i < num_launches; ++i) {
            sum += launch_tiny(gpu.tiny, stream);
            if (i % 4 == 0) sum += launch_wide(gpu.wide, stream);
        }
        sum += launch_store(gpu.store, to, first + std::uint64_t(frame), stream);
        sum += cuStreamSynchronize(stream);
        sum += to[0];
    }
    return sum;
}

int threads(const Arguments&) {
    const Gpu gpu;
    constexpr int kThreads = 8;
    std::vector<std::uint64_t> sums(kThreads);
    std::vector<std::thread> workers;
    for (int t = 0; t < kThreads; ++t)
        workers.emplace_back([&, t] {
            sums[std::size_t(t)] =
                run_frames(gpu, "twin_" + std::to_string(t), 5, 20, std::uint64_t(t) * 1000);
        });
    for (std::thread& worker : workers) worker.join();
    for (std::uint64_t sum : sums) say("%llu", static_cast<unsigned long long>(sum));
    return 0;
}

// A pool renames its threads, to names of other tasks and of none; more threads have a name than
// the task has places.
int renamed_threads(const Arguments&) {
    const Gpu gpu;
    std::vector<std::uint64_t> sums(3);
    std::vector<std::thread> workers;
    for (std::size_t t = 0; t < sums.size(); ++t)
        workers.emplace_back([&, t] {
            for (const char* name : {"twin_1", "twin_2", "other", "twin_1", "twin_odd"})
                sums[t] += run_frames(gpu, name, 2, 5, 10 * t);
        });
    for (std::thread& worker : workers) worker.join();
    for (std::uint64_t sum : sums) say("%llu", static_cast<unsigned long long>(sum));
    return 0;
}

// Threads that end with work not waited for; their names come again.
int short_threads(const Arguments&) {
    const Gpu gpu;
    std::uint64_t sum = 0;
    for (int i = 0; i < 40; ++i)
        std::thread([&] {
            name_this_thread("twin_0");
            MUST(cuCtxSetCurrent(gpu.context));
            sum += launch_tiny(gpu.tiny, CU_STREAM_PER_THREAD);
            sum += launch_tiny(gpu.tiny, nullptr);
        }).join();
    sum += run_frames(gpu, "twin_0", 3, 10, 100);
    SHOW(cuCtxSynchronize());
    say("%llu", static_cast<unsigned long long>(sum));
    return 0;
}

const Scenario s1("threads", threads), s2("renamed_threads", renamed_threads),
    s3("short_threads", short_threads);

}  // namespace
}  // namespace twin
