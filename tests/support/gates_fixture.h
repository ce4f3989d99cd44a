// SPDX-License-Identifier: Apache-2.0
//
// Two chains, of which one has to wait for the other: its launches go behind gates, which are
// looked after when the test says so.
#pragma once

#include <functional>
#include <vector>

#include "host/runtime/gates.h"
#include "tests/support/rooms_fixture.h"

namespace urgengo::testing {

inline const auto kOurs = reinterpret_cast<CUstream>(0xd0);

struct ClosedGate {
    CUdeviceptr word;
    std::uint32_t value;
    CUstream stream;
};

/// Two chains; `tight` is on the GPU, so launches of `loose` have to wait.
struct GatesFixture : RoomsFixture {
    /// Looks when the test says so.
    struct HandPoller final : exec::Poller {
        std::function<exec::More()> look;
        int num_wakes = 0;
        std::function<void()> stop;
        bool stopped = false;
        bool start(std::function<exec::More()> its, std::function<void()> on_stop) override {
            look = std::move(its);
            stop = std::move(on_stop);
            return true;
        }
        bool wake() override { return ++num_wakes > 0 && !stopped; }
    };

    inline static std::vector<ClosedGate> closed;
    inline static CUresult result = CUDA_SUCCESS;
    inline static unsigned stream_flags = CU_STREAM_NON_BLOCKING;
    inline static std::vector<std::uint64_t> memory;
    inline static std::vector<ClosedGate> arms;  ///< what waits in the stream of ours
    inline static CUresult arms_result = CUDA_SUCCESS;
    inline static decltype(exec::DriverApi::cuLaunchKernelEx) launch = nullptr;
    HandPoller poller, leases;

    explicit GatesFixture(config::Dispatch opens_by = config::Dispatch::kHost,
                          config::DeviceDispatch device = config::DeviceDispatch::kLeased,
                          const observe::RecordOptions& record = {})
        : RoomsFixture(opens_by, device, record) {
        closed.clear();
        arms.clear();
        result = arms_result = CUDA_SUCCESS;
        stream_flags = CU_STREAM_NON_BLOCKING;
        driver.api.cuStreamWaitValue32_v2 = [](CUstream stream, CUdeviceptr word, cuuint32_t value,
                                               unsigned flags) {
            CHECK(flags == CU_STREAM_WAIT_VALUE_GEQ);
            if (stream == kOurs) {
                if (arms_result == CUDA_SUCCESS) arms.push_back({word, value, stream});
                return arms_result;
            }
            if (result == CUDA_SUCCESS) closed.push_back({word, value, stream});
            return result;
        };
        driver.api.cuMemAlloc_v2 = [](CUdeviceptr* address, std::size_t bytes) {
            memory.assign(bytes / 8 + 1, 0);
            *address = reinterpret_cast<CUdeviceptr>(memory.data());
            return CUDA_SUCCESS;
        };
        driver.api.cuMemsetD8Async = [](CUdeviceptr, unsigned char, std::size_t, CUstream) {
            return CUDA_SUCCESS;
        };
        driver.api.cuStreamCreateWithPriority = [](CUstream* stream, unsigned, int) {
            *stream = kOurs;
            return CUDA_SUCCESS;
        };
        driver.api.cuCtxSetCurrent = [](CUcontext) { return CUDA_SUCCESS; };
        // Threads of more than the grids of these tests.
        driver.api.cuDeviceGetAttribute = [](int* value, CUdevice_attribute what, CUdevice) {
            *value = what == CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT             ? 10
                     : what == CU_DEVICE_ATTRIBUTE_MAX_THREADS_PER_MULTIPROCESSOR ? 4096
                                                                                  : 1000;
            return CUDA_SUCCESS;
        };
        launch = driver.api.cuLaunchKernelEx;
        driver.api.cuLaunchKernelEx = [](const CUlaunchConfig* config, CUfunction function,
                                         void** parameters, void** extra) {
            return config->hStream == kOurs ? CUDA_SUCCESS
                                            : launch(config, function, parameters, extra);
        };
        driver.api.cuStreamSynchronize = [](CUstream) { return CUDA_SUCCESS; };
        driver.api.cuStreamGetFlags = [](CUstream, unsigned* flags) {
            *flags = stream_flags;
            return CUDA_SUCCESS;
        };
        common().gate_keeper.look_by(poller, &leases);
        begin_frame(thread_a, "tight");
        begin_frame(thread_b, "loose");
        launch_on(thread_a, kStreamA);
    }
    abi::TaskSlot& slot() { return *loose().slot; }
    bool is_closed() { return runtime::Gates::are_closed(loose()); }
    static std::size_t num_waiting_arms() {
        std::size_t waiting = 0;
        for (const ClosedGate& arm : arms)
            waiting += *reinterpret_cast<const std::uint32_t*>(arm.word) != arm.value;
        return waiting;
    }
    /// All that `tight` has launched executes, and it waits for that.
    void tight_ends() {
        tight().slot->waits = 1;
        segments.emit_mark(tight(), clock.now());
        driver.execute_marks(driver.marks.size());
    }
};

}  // namespace urgengo::testing
