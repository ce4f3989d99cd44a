// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/doctor/priority_measurement.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "device/device_image.h"
#include "tools/urgengo/doctor/gpu_session.h"

namespace urgengo::cli {
namespace {

constexpr int kTries = 5;
constexpr int kMaxLaunches = 15;    // for so many tries: some come too late to say anything
constexpr double kOvertaken = 0.5;  // of what was left of the big kernel
constexpr double kInTime = 0.5;     // of the big kernel must be left

// The GPU is full with blocks of this size on every part so far, and the small kernel's fit nowhere
// between them.
constexpr unsigned kBlockThreads = 256;
constexpr std::uint64_t kBlockNs = 50'000;
constexpr std::uint64_t kSmallBlockNs = 1'000;
constexpr double kBusyUs = 15'000;
// Blocks last as long as they like on another clock (the simulated GPU's); so a few waves are timed
// first, and their number follows.
constexpr unsigned kTrialWaves = 20;
constexpr int kTrials = 3;
constexpr double kMaxWaves = 5000;

class Probe {
  public:
    explicit Probe(const std::string& library) : gpu_(library) {}

    PriorityMeasurement run();

  private:
    void set_up();
    CUstream make_stream(int priority);
    CUresult launch(CUstream stream, unsigned blocks, std::uint64_t block_ns, bool with_priority);
    void launch_busy(unsigned waves);
    /// @returns how long the big kernel takes by itself: the best of a few
    double time_alone(unsigned waves);
    /// @returns nothing if the launch was refused
    std::optional<PriorityWait> try_once(CUstream stream, bool with_priority);
    /// The best of kTries, or the first that overtakes.
    PriorityWay try_way(CUstream stream, bool with_priority);
    PriorityWay by_stream_attribute();
    double elapsed_us(CUevent from, CUevent to);

    GpuSession gpu_;
    PriorityMeasurement result_;
    CUfunction spin_ = nullptr;
    CUevent busy_start_ = nullptr, busy_end_ = nullptr, start_ = nullptr, end_ = nullptr;
    CUstream busy_stream_ = nullptr;
    unsigned num_sms_ = 0, wave_blocks_ = 0, waves_ = 0;
};

CUstream Probe::make_stream(int priority) {
    CUstream stream = nullptr;
    URGENGO_CALL(gpu_, cuStreamCreateWithPriority, &stream, unsigned{CU_STREAM_NON_BLOCKING},
                 priority);
    return stream;
}

void Probe::set_up() {
    gpu_.enter_context();
    URGENGO_CALL(gpu_, cuCtxGetStreamPriorityRange, &result_.least, &result_.greatest);
    CUmodule module = nullptr;
    URGENGO_CALL(gpu_, cuModuleLoadData, &module, device::marks_image());
    URGENGO_CALL(gpu_, cuModuleGetFunction, &spin_, module, "urgengo_delay");
    // Blocking: a thread that spins is the one that a busy machine takes off its core.
    for (CUevent* event : {&busy_start_, &busy_end_, &start_, &end_}) {
        URGENGO_CALL(gpu_, cuEventCreate, event, unsigned{CU_EVENT_BLOCKING_SYNC});
    }
    busy_stream_ = make_stream(result_.least);
    num_sms_ = static_cast<unsigned>(gpu_.attribute(CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT));
    const auto sm_threads =
        static_cast<unsigned>(gpu_.attribute(CU_DEVICE_ATTRIBUTE_MAX_THREADS_PER_MULTIPROCESSOR));
    wave_blocks_ = num_sms_ * std::max(1u, sm_threads / kBlockThreads);
}

CUresult Probe::launch(CUstream stream, unsigned blocks, std::uint64_t block_ns,
                       bool with_priority) {
    CUlaunchAttribute priority{};
    priority.id = CU_LAUNCH_ATTRIBUTE_PRIORITY;
    priority.value.priority = result_.greatest;
    CUlaunchConfig config{};
    config.gridDimX = blocks;
    config.blockDimX = kBlockThreads;
    config.gridDimY = config.gridDimZ = config.blockDimY = config.blockDimZ = 1;
    config.hStream = stream;
    config.attrs = &priority;
    config.numAttrs = 1;
    void* parameters[] = {&block_ns};
    if (with_priority) {
        return gpu_.try_call(static_cast<decltype(&cuLaunchKernelEx)>(nullptr), "cuLaunchKernelEx",
                             &config, spin_, parameters, nullptr);
    }
    return gpu_.try_call(static_cast<decltype(&cuLaunchKernel)>(nullptr), "cuLaunchKernel", spin_,
                         blocks, 1u, 1u, kBlockThreads, 1u, 1u, 0u, stream, parameters, nullptr);
}

double Probe::elapsed_us(CUevent from, CUevent to) {
    // Not the header's name, which stands for a function that drivers before 12.8 lack.
    using Elapsed = CUresult (*)(float*, CUevent, CUevent);
    float ms = 0;
    gpu_.call(Elapsed{}, "cuEventElapsedTime", &ms, from, to);
    return static_cast<double>(ms) * 1000;
}

void Probe::launch_busy(unsigned waves) {
    URGENGO_CALL(gpu_, cuEventRecord, busy_start_, busy_stream_);
    if (const CUresult error = launch(busy_stream_, waves * wave_blocks_, kBlockNs, false)) {
        GpuSession::fail("cuLaunchKernel", error);
    }
    URGENGO_CALL(gpu_, cuEventRecord, busy_end_, busy_stream_);
}

double Probe::time_alone(unsigned waves) {
    double best_us = std::numeric_limits<double>::infinity();
    for (int i = 0; i < kTrials; ++i) {
        launch_busy(waves);
        URGENGO_CALL(gpu_, cuEventSynchronize, busy_end_);
        best_us = std::min(best_us, elapsed_us(busy_start_, busy_end_));
    }
    return best_us;
}

std::optional<PriorityWait> Probe::try_once(CUstream stream, bool with_priority) {
    launch_busy(waves_);
    URGENGO_CALL(gpu_, cuEventSynchronize, busy_start_);
    URGENGO_CALL(gpu_, cuEventRecord, start_, stream);
    const CUresult launched = launch(stream, num_sms_, kSmallBlockNs, with_priority);
    URGENGO_CALL(gpu_, cuEventRecord, end_, stream);
    URGENGO_CALL(gpu_, cuEventSynchronize, end_);
    URGENGO_CALL(gpu_, cuEventSynchronize, busy_end_);
    if (launched != CUDA_SUCCESS) return std::nullopt;
    return PriorityWait{elapsed_us(start_, end_), elapsed_us(start_, busy_end_)};
}

PriorityWay Probe::try_way(CUstream stream, bool with_priority) {
    PriorityWay way{Honoured::kNo, {}};
    int tries = 0;
    for (int i = 0; i < kMaxLaunches && tries < kTries; ++i) {
        const auto wait = try_once(stream, with_priority);
        if (!wait) return {};
        if (wait->behind_us < kInTime * result_.busy_us) continue;
        if (tries++ == 0 || wait->us * way.wait.behind_us < way.wait.us * wait->behind_us) {
            way.wait = *wait;
        }
        if (wait->us >= kOvertaken * wait->behind_us) continue;
        way.honoured = Honoured::kYes;
        return way;
    }
    if (tries < kTries) throw DriverFailure("this machine is too busy to measure it");
    return way;
}

PriorityWay Probe::by_stream_attribute() {
    const CUstream stream = make_stream(result_.least);
    CUstreamAttrValue value{};
    value.priority = result_.greatest;
    const CUresult set =
        gpu_.try_call(static_cast<decltype(&cuStreamSetAttribute)>(nullptr), "cuStreamSetAttribute",
                      stream, CU_STREAM_ATTRIBUTE_PRIORITY, &value);
    return set == CUDA_SUCCESS ? try_way(stream, false) : PriorityWay{};
}

PriorityMeasurement Probe::run() {
    set_up();
    if (result_.least == result_.greatest) {
        throw DriverFailure("this GPU has no stream priorities");
    }
    time_alone(1);  // loads the kernel
    const double wave_us = std::max(time_alone(kTrialWaves) / kTrialWaves, 0.1);
    waves_ = static_cast<unsigned>(
        std::clamp(std::ceil(kBusyUs / wave_us), double{kTrialWaves}, kMaxWaves));
    result_.busy_us = time_alone(waves_);
    const CUstream low = make_stream(result_.least);
    const PriorityWay plain = try_way(low, false);
    if (plain.honoured != Honoured::kNo) {
        throw DriverFailure(
            fmt::format("a kernel without priority waited {:.0f} us, behind one that filled the "
                        "GPU for {:.0f} more: there is nothing to compare with",
                        plain.wait.us, plain.wait.behind_us));
    }
    result_.plain = plain.wait;
    result_.launch_attribute = try_way(low, true);
    result_.stream_attribute = by_stream_attribute();
    result_.stream = try_way(make_stream(result_.greatest), false);
    return result_;
}

}  // namespace

Result<PriorityMeasurement> measure_priority(const std::string& library) {
    try {
        return Probe(library).run();
    } catch (const DriverFailure& failure) {
        return Error{failure.what()};
    }
}

}  // namespace urgengo::cli
