// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/bystander.h"

#include <pthread.h>

#include <algorithm>
#include <cmath>

#include "tools/chains/task_stream.h"

namespace urgengo::chains {

namespace {

constexpr int kBlockThreads = 256;
constexpr int kBlocksPerFullSm = 2048 / kBlockThreads;
constexpr double kWave_ms = 0.2;
constexpr int kProbeIterations = 2000;

double launch_ms(TaskStream& stream, const Kernel& kernel) {
    Event begin, end;
    begin.record(stream.stream());
    stream.launch(kernel);
    end.record(stream.stream());
    end.synchronize();
    return end.ms_since(begin);
}

}  // namespace

Bystander::Bystander(const Gpu& gpu, std::chrono::nanoseconds length,
                     std::chrono::nanoseconds period)
    : gpu_(gpu), length_(length), period_(period) {
    TaskStream stream(gpu);
    const int wave = gpu.num_sms() * kBlocksPerFullSm;
    kernel_.grid = wave;
    kernel_.block = kBlockThreads;
    kernel_.iterations = kProbeIterations;
    launch_ms(stream, kernel_);  // loads it, and wakes the clocks
    const double probe_ms = std::max(launch_ms(stream, kernel_), 1e-3);
    kernel_.iterations = std::max(1, static_cast<int>(kProbeIterations * kWave_ms / probe_ms));
    const double wave_ms = std::max(launch_ms(stream, kernel_), 1e-3);
    const double length_ms = std::chrono::duration<double, std::milli>(length).count();
    kernel_.grid = wave * std::max(1, static_cast<int>(std::lround(length_ms / wave_ms)));
}

void Bystander::start() {
    thread_ = std::thread([this] {
        try {
            run();
        } catch (const std::exception&) {
            error_ = std::current_exception();
        }
    });
}

void Bystander::stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
}

void Bystander::rethrow_error() const {
    if (error_) std::rethrow_exception(error_);
}

void Bystander::run() {
    pthread_setname_np(pthread_self(), "bystander");
    gpu_.bind_thread();
    TaskStream stream(gpu_);
    auto next = std::chrono::steady_clock::now();
    while (!stop_.load(std::memory_order_relaxed)) {
        stream.launch(kernel_);
        ++kernels_;
        std::this_thread::sleep_for(length_);  // the wait may spin
        stream.synchronize();
        next = std::max(next + period_, std::chrono::steady_clock::now());
        std::this_thread::sleep_until(next);
    }
}

}  // namespace urgengo::chains
