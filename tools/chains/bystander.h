// SPDX-License-Identifier: Apache-2.0
//
// A thread that belongs to no chain and fills the GPU now and then: kernels whose blocks take every
// thread slot of every multiprocessor, wave after wave of about 200 us. So what comes meanwhile
// must wait for slots, at whatever priority.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <exception>
#include <thread>

#include "tools/chains/gpu.h"
#include "tools/chains/workload.h"

namespace urgengo::chains {

class Bystander {
  public:
    /// Measures, alone on the GPU, how large such a kernel is.
    /// @param length  of a kernel, alone on the GPU
    /// @param period  of the kernels' launches; one that is not done yet delays the next
    Bystander(const Gpu& gpu, std::chrono::nanoseconds length, std::chrono::nanoseconds period);
    ~Bystander() { stop(); }

    void start();
    void stop();
    /// After stop(). @throws what made the thread give up, if anything did
    void rethrow_error() const;
    std::uint64_t kernels() const { return kernels_; }

  private:
    void run();

    const Gpu& gpu_;
    const std::chrono::nanoseconds length_, period_;
    Kernel kernel_;
    std::uint64_t kernels_ = 0;
    std::exception_ptr error_;
    std::atomic<bool> stop_{false};
    std::thread thread_;
};

}  // namespace urgengo::chains
