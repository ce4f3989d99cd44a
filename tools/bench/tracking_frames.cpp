// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/tracking_frames.h"

#include <sys/prctl.h>

#include <atomic>
#include <chrono>
#include <ctime>
#include <optional>
#include <semaphore>
#include <string>
#include <thread>

#include "tools/bench/bench_config.h"

namespace urgengo::bench {
namespace {

using namespace std::chrono_literals;

/// Before those that count: modules are loaded, and the task is known.
constexpr int kWarmUpPairs = 4;
/// However long they take.
constexpr std::size_t kFewestPairs = 3;

double cpu_us(clockid_t clock) {
    timespec time{};
    clock_gettime(clock, &time);
    return static_cast<double>(time.tv_sec) * 1e6 + static_cast<double>(time.tv_nsec) / 1e3;
}

/// A thread that runs frames, one at a time, when it is told to.
class Launcher {
  public:
    Launcher(const SpinGpu& gpu, const TrackingCell& cell, const std::string& name)
        : gpu_(gpu), cell_(cell), thread_([this, name] { serve(name); }) {}
    ~Launcher() {
        over_ = true;
        begin_.release();
        thread_.join();
    }
    Launcher(const Launcher&) = delete;
    Launcher& operator=(const Launcher&) = delete;

    TrackedFrame run() {
        begin_.release();
        end_.acquire();
        return frame_;
    }

  private:
    void serve(const std::string& name) {
        prctl(PR_SET_NAME, name.c_str());
        gpu_.make_current();
        const CUstream stream = gpu_.make_stream();
        CUevent before = nullptr, behind = nullptr;
        MUST(cuEventCreate(&before, CU_EVENT_DEFAULT));
        MUST(cuEventCreate(&behind, CU_EVENT_DEFAULT));
        for (begin_.acquire(); !over_; begin_.acquire()) {
            frame_ = one_frame(stream, before, behind);
            end_.release();
        }
        MUST(cuEventDestroy(before));
        MUST(cuEventDestroy(behind));
        MUST(cuStreamDestroy(stream));
    }

    TrackedFrame one_frame(CUstream stream, CUevent before, CUevent behind) const {
        const auto begin = std::chrono::steady_clock::now();
        const double process = cpu_us(CLOCK_PROCESS_CPUTIME_ID);
        const double thread = cpu_us(CLOCK_THREAD_CPUTIME_ID);
        MUST(cuEventRecord(before, stream));
        const double first = cpu_us(CLOCK_THREAD_CPUTIME_ID);
        for (int i = 0; i < cell_.frame_launches; ++i) gpu_.launch(cell_.iterations, stream);
        const double last = cpu_us(CLOCK_THREAD_CPUTIME_ID);
        MUST(cuEventRecord(behind, stream));
        MUST(cuStreamSynchronize(stream));
        TrackedFrame frame;
        frame.launch_cpu_us = last - first;
        frame.thread_cpu_us = cpu_us(CLOCK_THREAD_CPUTIME_ID) - thread;
        frame.process_cpu_us = cpu_us(CLOCK_PROCESS_CPUTIME_ID) - process;
        const std::chrono::duration<double, std::micro> elapsed =
            std::chrono::steady_clock::now() - begin;
        frame.elapsed_us = elapsed.count();
        float gpu_ms = 0;
        MUST(cuEventElapsedTime(&gpu_ms, before, behind));
        frame.gpu_us = static_cast<double>(gpu_ms) * 1e3;
        return frame;
    }

    const SpinGpu& gpu_;
    const TrackingCell& cell_;
    std::binary_semaphore begin_{0}, end_{0};
    bool over_ = false;   // ordered by begin_
    TrackedFrame frame_;  // ordered by end_
    std::thread thread_;
};

/// Another chain, with work on the GPU for as long as the object lives: a kernel behind a closed
/// gate, which takes nothing of the GPU and is in flight for everybody who asks.
class Bystander {
  public:
    explicit Bystander(const SpinGpu& gpu) {
        void* memory = nullptr;
        MUST(cuMemHostAlloc(&memory, sizeof *gate_, CU_MEMHOSTALLOC_DEVICEMAP));
        gate_ = static_cast<std::atomic<std::uint32_t>*>(memory);
        gate_->store(0);
        thread_ = std::thread([this, &gpu] { be_on_gpu(gpu); });
        // Where UrgenGo waits for what is launched, the launch returns only when the gate opens.
        launched_.try_acquire_for(20ms);
    }
    ~Bystander() {
        gate_->store(1);
        over_.release();
        thread_.join();
        MUST(cuMemFreeHost(gate_));
    }
    Bystander(const Bystander&) = delete;
    Bystander& operator=(const Bystander&) = delete;

  private:
    void be_on_gpu(const SpinGpu& gpu) {
        prctl(PR_SET_NAME, other_chain(1).c_str());
        gpu.make_current();
        const CUstream stream = gpu.make_stream();
        CUdeviceptr d_gate = 0;
        MUST(cuMemHostGetDevicePointer(&d_gate, gate_, 0));
        MUST(cuStreamWaitValue32(stream, d_gate, 1, CU_STREAM_WAIT_VALUE_GEQ));
        gpu.launch(0, stream);
        launched_.release();
        over_.acquire();
        MUST(cuStreamSynchronize(stream));
        MUST(cuStreamDestroy(stream));
    }

    std::atomic<std::uint32_t>* gate_ = nullptr;
    std::binary_semaphore launched_{0}, over_{0};
    std::thread thread_;
};

}  // namespace

std::vector<FramePair> run_cell(const SpinGpu& gpu, const TrackingCell& cell, double seconds) {
    Launcher chain(gpu, cell, cell_chain(cell.index)), unscheduled(gpu, cell, kBystanderThread);
    // Behind a closed gate nothing can be loaded, so these are without one.
    for (int i = 0; i < kWarmUpPairs; ++i) {
        unscheduled.run();
        chain.run();
    }
    std::optional<Bystander> bystander;
    if (cell.beside) bystander.emplace(gpu);
    std::vector<FramePair> pairs;
    for (double left_us = seconds * 1e6; left_us > 0 || pairs.size() < kFewestPairs;) {
        FramePair& pair = pairs.emplace_back();
        if (pairs.size() % 2 != 0) pair.unscheduled = unscheduled.run();
        pair.chain = chain.run();
        if (pairs.size() % 2 == 0) pair.unscheduled = unscheduled.run();
        left_us -= pair.chain.elapsed_us + pair.unscheduled.elapsed_us;
    }
    return pairs;
}

}  // namespace urgengo::bench
