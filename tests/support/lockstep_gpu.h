// SPDX-License-Identifier: Apache-2.0
//
// The driver for a program in lockstep: kernels, marks, events and waits go to the simulated GPU's
// engine, everything else is FakeDriver's. Marks and events are what the runtime itself asks for;
// the program's own calls are launch(), record(), wait_event(), synchronize().
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <vector>

#include "tests/support/fake_driver.h"
#include "tests/support/lockstep.h"

namespace urgengo::testing {

class LockstepGpu {
  public:
    static constexpr int kNumSms = 22;  ///< few: the engine looks at each
    static constexpr int kBlocksPerSm = 4;

    struct Kernel {
        CUfunction function = nullptr;
        std::uint64_t grid = 1;
        nanoseconds block_time{1};
    };

    LockstepGpu();
    ~LockstepGpu() { current_ = nullptr; }
    LockstepGpu(const LockstepGpu&) = delete;
    LockstepGpu& operator=(const LockstepGpu&) = delete;

    void launch(CUstream stream, const Kernel& kernel, int priority);
    void record(CUevent event, CUstream stream);
    void wait_event(CUstream stream, CUevent event);
    void synchronize(CUstream stream);
    CUevent create_event();

    FakeDriver driver;
    simgpu::Engine engine;
    Lockstep threads;
    /// Called of each mark that is launched.
    std::function<void(CUstream, std::uint64_t word0)> on_mark = [](CUstream, std::uint64_t) {};

  private:
    static simgpu::Part part();
    simgpu::Engine::QueuePtr& queue(CUstream stream);
    void submit(CUstream stream, simgpu::Work work, std::vector<simgpu::Fence> fences = {});
    CUresult launch_mark(const CUlaunchConfig& config, void** parameters);
    CUresult query(CUevent event);

    inline static LockstepGpu* current_ = nullptr;
    std::map<CUstream, simgpu::Engine::QueuePtr> queues_;
    std::deque<simgpu::Fence> events_;  ///< by handle, from 1 on
};

}  // namespace urgengo::testing
