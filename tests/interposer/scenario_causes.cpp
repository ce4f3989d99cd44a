// SPDX-License-Identifier: Apache-2.0
//
// A chain whose frames are late for a cause that is put into them, for test_injected_causes.cpp: a
// longer CPU segment, a sleep, longer kernels, a frame that is told of late, a kernel of a
// co-runner. The program's own stamps tell which frames the machine has disturbed besides.
#include <time.h>

#include <urgengo/urgengo.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <string>
#include <thread>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

using namespace std::chrono_literals;
using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;

constexpr int kKernels = 10, kFrames = 40;
constexpr nanoseconds kLongest = 12s;
constexpr nanoseconds kCpu = 1ms, kKernel = 300us, kInjected = 30ms, kCoKernel = 20ms;
constexpr char kImageOfIt[] =
    R"({"kernels": [
        {"name": "work", "block_ns_per_unit": 1000, "unit_arg": 0, "unit_bytes": 4,
         "blocks_per_sm": 1},
        {"name": "co_work", "block_ns": 20000000, "blocks_per_sm": 1}]})";

void compute(nanoseconds time) {
    const auto end = Clock::now() + time;
    while (Clock::now() < end) {
    }
}

/// The other chain: one long kernel, when it is asked for.
class CoRunner {
  public:
    CoRunner(const Gpu& gpu, const ug_hints& hints, CUfunction kernel)
        : thread_([this, &gpu, &hints, kernel] { run(gpu, hints, kernel); }) {}
    ~CoRunner() {
        asked_ = -1;
        asked_.notify_one();
        thread_.join();
    }
    /// @returns when its kernel was launched
    Clock::time_point launch() {
        const int number = ++asked_;
        asked_.notify_one();
        for (int seen = launched_; seen != number; seen = launched_) launched_.wait(seen);
        return launched_at_;
    }
    /// @returns when it had waited for that
    Clock::time_point wait() {
        const int number = asked_;
        for (int seen = ended_; seen != number; seen = ended_) ended_.wait(seen);
        return ended_at_;
    }

  private:
    void run(const Gpu& gpu, const ug_hints& hints, CUfunction kernel) {
        MUST(cuCtxSetCurrent(gpu.context));
        const CUstream stream = make_stream();
        for (int number = 1;; ++number) {
            asked_.wait(number - 1);
            if (asked_ < 0) return;
            hints.task_begin(hints.arrival("co", 0, UG_CLOCK_MONOTONIC), "work");
            MUST(launch_wide(kernel, stream));
            launched_at_ = Clock::now();
            launched_ = number;
            launched_.notify_one();
            MUST(cuStreamSynchronize(stream));
            ended_at_ = Clock::now();
            hints.task_end();
            ended_ = number;
            ended_.notify_one();
        }
    }

    std::atomic<int> asked_{0}, launched_{0}, ended_{0};
    Clock::time_point launched_at_, ended_at_;
    std::thread thread_;
};

/// What is put into a frame.
struct Injected {
    nanoseconds cpu{0}, sleep{0}, arrival{0}, gpu{0};
    bool co_runner = false;
};

Injected injected_by(const std::string& what) {
    if (what == "cpu") return {.cpu = kInjected};
    if (what == "sleep") return {.sleep = kInjected};
    if (what == "arrival") return {.arrival = kInjected};
    if (what == "gpu") return {.gpu = kInjected};
    return {.co_runner = true};
}

struct Program {
    const Gpu& gpu;
    const ug_hints& hints;
    CUfunction work;
    CUstream stream;
    CoRunner& co_runner;

    /// @returns whether the frame took what it should, but for a half of what was put into it
    bool frame(const Injected& injected) {
        Clock::time_point co_began{};
        if (injected.co_runner) co_began = co_runner.launch();
        const auto arrived = Clock::now() - injected.arrival;
        const std::int64_t stamp = nanoseconds(arrived.time_since_epoch()).count();
        hints.task_begin(hints.arrival("late", stamp, UG_CLOCK_MONOTONIC), "work");
        const auto began = Clock::now();
        compute(kCpu + injected.cpu);
        if (injected.sleep.count() > 0) std::this_thread::sleep_for(injected.sleep);
        const auto launches = Clock::now();
        for (int i = 0; i < kKernels; ++i) {
            auto units = static_cast<std::uint32_t>((kKernel + injected.gpu / kKernels) / 1us);
            void* parameters[] = {&units};
            MUST(cuLaunchKernel(work, 46, 1, 1, 1024, 1, 1, 0, stream, parameters, nullptr));
        }
        MUST(cuStreamSynchronize(stream));
        const auto over = Clock::now();
        hints.task_end();
        const auto ended = Clock::now();

        nanoseconds disturbed{0};
        const auto took = [&](nanoseconds time, nanoseconds should) {
            disturbed += std::max<nanoseconds>(time - should, 0ns);
        };
        nanoseconds in_front{0};
        if (injected.co_runner) {
            const auto co_ended = co_runner.wait();
            took(co_ended - co_began, kCoKernel);
            in_front = std::max<nanoseconds>(co_began + kCoKernel - launches, 0ns);
        }
        took(began - arrived, injected.arrival);
        took(launches - began, kCpu + injected.cpu + injected.sleep);
        took(over - launches, kKernels * kKernel + injected.gpu + in_front);
        took(ended - over, 0ns);
        const nanoseconds most = injected.co_runner ? kCoKernel : kInjected;
        return disturbed < most / 2;
    }
};

// Says the numbers of frames into which the cause was put, and that nothing else has disturbed.
int causes(const Arguments& arguments) {
    ug_hints hints;
    ug_hints_load(&hints);
    const Gpu gpu;
    CUmodule module = nullptr;
    CUfunction work = nullptr, co_work = nullptr;
    MUST(cuModuleLoadData(&module, kImageOfIt));
    MUST(cuModuleGetFunction(&work, module, "work"));
    MUST(cuModuleGetFunction(&co_work, module, "co_work"));
    const Injected injected = injected_by(arguments.at(0));
    CoRunner co_runner(gpu, hints, co_work);
    Program program{gpu, hints, work, make_stream(), co_runner};
    int found = 0, number = 0;
    for (int i = 0; i < 4; ++i, ++number) program.frame({});
    const auto end = Clock::now() + kLongest;
    while (found < kFrames && Clock::now() < end) {
        for (int i = 0; i < 2; ++i, ++number) program.frame({});
        ++number;
        if (!program.frame(injected)) continue;
        say("%d", number);
        ++found;
    }
    return 0;
}

const Scenario s1("causes", causes, Runs::kSimulated);

}  // namespace
}  // namespace twin
