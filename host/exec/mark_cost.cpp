// SPDX-License-Identifier: Apache-2.0
#include "host/exec/mark_cost.h"

#include <algorithm>
#include <cstdint>
#include <vector>

namespace urgengo::exec {
namespace {

using std::chrono::nanoseconds;
using namespace std::chrono_literals;

/// More is the work of others.
constexpr nanoseconds kMostMark = 10us;
constexpr nanoseconds kMostPause = 3us;

/// Multiples of the steps in which %globaltimer advances: 32 ns on new GPUs, 1024 on old ones.
constexpr nanoseconds kShortKernel = 4096ns;
constexpr nanoseconds kLongKernel = 8192ns;
constexpr nanoseconds kMostDifference = 300ns;  // of the pauses beside those two

constexpr int kMeasurements = 4;
constexpr std::uint32_t kMarks = 33;

class MarkMeter {
  public:
    MarkMeter(const ProgressMarks& marks, const MarkContext& context)
        : marks_(marks), driver_(marks.driver()), context_(context), relaxed_(driver_) {
        if (!context.delay || !driver_.cuStreamCreateWithPriority || !driver_.cuStreamDestroy_v2 ||
            !driver_.cuStreamQuery || !driver_.cuLaunchKernel)
            return;
        lines_ = marks.allocate_lines(kMarks, d_lines_);
        if (lines_ && driver_.cuStreamCreateWithPriority(&stream_, CU_STREAM_NON_BLOCKING,
                                                         context.greatest_priority) != CUDA_SUCCESS)
            stream_ = nullptr;
    }
    ~MarkMeter() {
        if (stream_) driver_.cuStreamDestroy_v2(stream_);
    }
    MarkMeter(const MarkMeter&) = delete;
    MarkMeter& operator=(const MarkMeter&) = delete;

    /// @param kernel  how long the one between marks takes; 0: there is none
    /// @returns the least quartile of a few measurements of the step between marks, without the
    ///          kernel; 0 if none is plausible
    nanoseconds beside(nanoseconds kernel) {
        nanoseconds least{0};
        for (int i = 0; stream_ && !is_stuck_ && i < kMeasurements; ++i) {
            std::vector<nanoseconds> steps = steps_around(kernel);
            if (steps.empty()) break;
            const auto quartile = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 4);
            std::nth_element(steps.begin(), quartile, steps.end());
            const nanoseconds rest = *quartile - kernel;
            if (rest > 0ns && rest <= kMostMark + kMostPause)
                least = least == 0ns ? rest : std::min(least, rest);
        }
        return least;
    }

  private:
    bool launch_delay(nanoseconds duration) {
        auto duration_ns = static_cast<std::uint64_t>(duration.count());
        void* parameters[] = {&duration_ns};
        return driver_.cuLaunchKernel(context_.delay, 1, 1, 1, 1, 1, 1, 0, stream_, parameters,
                                      nullptr) == CUDA_SUCCESS;
    }

    bool launch_mark(std::uint32_t i) {
        return marks_.launch_at(context_, d_lines_ + sizeof(ug_mark_line) * i,
                                ug_mark_word0(0, 0, 1), 1, stream_,
                                StreamFlavor::kLegacy) == CUDA_SUCCESS;
    }

    // All wait behind a kernel that takes a while, and not behind a closed gate: with a stream
    // gated, another thread that loads a kernel may wait for the gate, and we for that thread.
    std::vector<nanoseconds> steps_around(nanoseconds kernel) {
        constexpr nanoseconds kHead = 400us;  // as long as launching takes
        constexpr auto kPatience = 200ms;
        bool queued = launch_delay(kHead) && launch_mark(0);
        for (std::uint32_t i = 1; queued && i < kMarks; ++i)
            queued = (kernel == 0ns || launch_delay(kernel)) && launch_mark(i);
        const auto deadline = std::chrono::steady_clock::now() + kPatience;
        CUresult state = CUDA_ERROR_NOT_READY;
        while ((state = driver_.cuStreamQuery(stream_)) == CUDA_ERROR_NOT_READY &&
               std::chrono::steady_clock::now() < deadline) {
        }
        is_stuck_ = state != CUDA_SUCCESS;
        std::vector<nanoseconds> steps;
        for (std::uint32_t i = 1; queued && !is_stuck_ && i < kMarks; ++i)
            steps.push_back(time_of(i) - time_of(i - 1));
        return steps;
    }

    nanoseconds time_of(std::uint32_t i) const {
        return nanoseconds(static_cast<nanoseconds::rep>(lines_[i].word[1] >> 16));
    }

    const ProgressMarks& marks_;
    const DriverApi& driver_;
    const MarkContext& context_;
    const RelaxedCaptureMode relaxed_;
    ug_mark_line* lines_ = nullptr;
    CUdeviceptr d_lines_ = 0;
    CUstream stream_ = nullptr;
    bool is_stuck_ = false;  // the stream is not idle yet, or broken
};

nanoseconds pause_of(MarkMeter& meter, nanoseconds mark) {
    const nanoseconds by_short = meter.beside(kShortKernel);
    const nanoseconds by_long = meter.beside(kLongKernel);
    if (by_short == 0ns || by_long == 0ns || std::chrono::abs(by_long - by_short) > kMostDifference)
        return 0ns;
    const nanoseconds pause = std::min(by_short, by_long) - mark - kDelayBeyondSpin;
    return pause > 0ns && pause <= kMostPause ? pause : 0ns;
}

}  // namespace

MarkCost measure_mark_cost(const ProgressMarks& marks, const MarkContext& context) {
    MarkMeter meter(marks, context);
    MarkCost cost;
    cost.mark = meter.beside(0ns);
    if (cost.mark > kMostMark) cost.mark = 0ns;
    if (cost.mark > 0ns) cost.pause = pause_of(meter, cost.mark);
    return cost;
}

}  // namespace urgengo::exec
