// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/clock_reading.h"

#include <chrono>
#include <new>

#include "tools/chains/clock_mailbox.h"
#include "tools/simgpu/simgpu.h"

namespace urgengo::chains {

namespace {

constexpr int kRoundTrips = 2000;
/// For the kernel to begin, or to answer.
constexpr std::chrono::seconds kPatience{1};

std::int64_t now_ns() {
    return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

class MappedMailbox {
  public:
    MappedMailbox() {
        void* memory = nullptr;
        CHAINS_CUDA(cuMemHostAlloc(&memory, sizeof(ClockMailbox), CU_MEMHOSTALLOC_DEVICEMAP));
        host_ = new (memory) ClockMailbox{};
        CHAINS_CUDA(cuMemHostGetDevicePointer(&device_, host_, 0));
    }
    ~MappedMailbox() { cuMemFreeHost(host_); }
    MappedMailbox(const MappedMailbox&) = delete;
    MappedMailbox& operator=(const MappedMailbox&) = delete;

    CUdeviceptr device() const { return device_; }
    void ask(unsigned number) { __atomic_store_n(&host_->asked, number, __ATOMIC_RELEASE); }
    bool answered(unsigned number) const {
        return __atomic_load_n(&host_->answered, __ATOMIC_ACQUIRE) == number;
    }
    std::int64_t time_ns() const { return static_cast<std::int64_t>(host_->time_ns); }

  private:
    ClockMailbox* host_ = nullptr;
    CUdeviceptr device_ = 0;
};

void ask_often(MappedMailbox& mailbox, ClockReading& best) {
    for (unsigned number = 1; number <= kRoundTrips; number++) {
        const std::int64_t asked_ns = now_ns();
        mailbox.ask(number);
        std::int64_t now = asked_ns;
        while (!mailbox.answered(number)) {
            if (now - asked_ns > std::chrono::nanoseconds(kPatience).count())
                throw CudaError("chains_clock: no answer within a second: is the GPU busy?");
            now = now_ns();
        }
        now = now_ns();
        const std::int64_t bound_ns = (now - asked_ns + 1) / 2;
        if (best.round_trips++ == 0 || bound_ns < best.bound_ns) {
            best.host_ns = asked_ns + (now - asked_ns) / 2;
            best.gpu_ns = mailbox.time_ns();
            best.bound_ns = bound_ns;
        }
    }
}

}  // namespace

ClockReading read_clocks(const Gpu& gpu) {
    if (gpu.simulated()) {
        const std::int64_t host_ns = now_ns();
        return {host_ns, host_ns + SIMGPU_GLOBALTIMER_OFFSET_NS, 0, 0};
    }
    const CUfunction kernel = gpu.function("chains_clock");
    MappedMailbox mailbox;
    const Stream stream;
    CUdeviceptr address = mailbox.device();
    void* parameters[] = {&address};
    CHAINS_CUDA(cuLaunchKernel(kernel, 1, 1, 1, 1, 1, 1, 0, stream.get(), parameters, nullptr));
    ClockReading best;
    try {
        ask_often(mailbox, best);
    } catch (const CudaError&) {
        mailbox.ask(kClockStop);
        cuStreamSynchronize(stream.get());  // it uses the mailbox
        throw;
    }
    mailbox.ask(kClockStop);
    stream.synchronize();
    return best;
}

}  // namespace urgengo::chains
