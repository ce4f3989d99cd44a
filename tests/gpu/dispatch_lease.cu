// SPDX-License-Identifier: Apache-2.0
//
// Leases of a resident dispatcher (device/dispatcher.cu) on a GPU, one at a time: what one does at
// its end when the host looks after gates no more, and when it leaves. Prints JSON; exit status 1:
// not as it should be; 77: no GPU.
#include "tests/gpu/dispatch_draws.cuh"

namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::uint32_t kTasks = 2;

__global__ void read_time(std::uint64_t* time_ns) {
    *time_ns = globaltimer_ns();
}

struct Gpu {
    abi::SharedPage* page = new (mapped<abi::SharedPage>()) abi::SharedPage();
    abi::DispatchLease* lease = mapped<abi::DispatchLease>();
    std::uint64_t* time_ns = mapped<std::uint64_t>();
    DispatchState* d_state = nullptr;

    Gpu() {
        must(cudaMalloc(&d_state, sizeof *d_state), "state");
        now();
        lease->stop = 1;
        run(0, 0, 0);
    }
    std::uint64_t now() {
        read_time<<<1, 1>>>(time_ns);
        must(cudaDeviceSynchronize(), "time");
        return *time_ns;
    }
    /// @returns for how long it was there, ms
    double run(std::uint32_t sequence, std::int64_t lease_ns, std::int64_t idle_ns) {
        const std::uint64_t begin_ns = now();
        page->dispatch.gpu_clock_ahead = begin_ns - kNow_ns;
        page->dispatch.clock_base_ns = kNow_ns;
        urgengo_dispatch_lease<<<1, kMarkThreads>>>({page, d_state, lease, kTasks, 0}, sequence,
                                                    static_cast<std::uint64_t>(lease_ns),
                                                    static_cast<std::uint64_t>(idle_ns));
        must(cudaGetLastError(), "lease");
        return 1e-6 * static_cast<double>(now() - begin_ns);
    }
    /// Task 1 stands before a closed gate: task 0 is more urgent, and has the GPU for long.
    void draw_up() {
        page->~SharedPage();
        new (page) abi::SharedPage();
        std::memset(lease, 0, sizeof *lease);
        abi::DispatchSettings& d = page->dispatch;
        d.policy = static_cast<std::uint32_t>(config::Policy::kEdf);
        d.pack_limit_ppm = d.share_limit_ppm = 1'050'000;
        d.share_slack_ns = 10 * kMs;
        page->active[0] = (1u << kTasks) - 1;
        for (std::uint32_t i = 0; i < kTasks; ++i) {
            abi::TaskSlot& s = page->tasks[i];
            s.state = abi::TaskState::kGpu;
            s.deadline_ns = kNow_ns + (300 + 100 * i) * kMs;
            s.relative_deadline_ns = s.period_ns = 500 * kMs;
            s.head_utilization_ppm = 800'000;
            s.head_remaining_ns = 4 * kMs;
            s.launched_ns = 100 * kMs;
            s.launch_ns = s.look_ns = s.progress_ns = kNow_ns;
            s.is_supported = 1;
            s.run_ahead_ns = 200 * kMs;
            s.gate_by_ns = kNow_ns + 1000 * kMs;
        }
        abi::TaskSlot& gated = page->tasks[1];
        gated.gates_closed = 1;
        gated.group_begin_ns[1] = 100 * kMs;
        gated.group_time_ns[1] = kMs;
        gated.group_utilization_ppm[1] = 800'000;
        must(cudaMemset(d_state, 0, sizeof *d_state), "state");
        const std::uint32_t one = 1;
        must(cudaMemcpy(&d_state->reached[1], &one, sizeof one, cudaMemcpyHostToDevice), "state");
    }
    bool is_open() const { return page->tasks[1].gates_opened.load() == 1; }
};

}  // namespace

int main() {
    cudaDeviceProp properties{};
    must(cudaGetDeviceProperties(&properties, 0), "device");
    Gpu gpu;
    int wrong = 0;
    constexpr std::int64_t kLease = 2 * kMs, kLong = 500 * kMs, kIdle = 200'000;
    constexpr std::int64_t kStays = kLease + 2 * abi::kSilence_ns;
    struct Case {
        const char* name;
        std::int64_t beat_ns;
        std::uint32_t launched, stop;
        bool opens;
        std::int64_t there_ns;  // at least, and 1 ms more at most
    };
    constexpr Case kCases[] = {
        {"the host looks after gates", kNow_ns + kLong, 1, 0, false, kStays},
        {"the host is silent", kNow_ns - kLong, 1, 0, true, kLease},
        {"the host falls silent", kNow_ns + kLease, 1, 0, true, kLease + abi::kSilence_ns},
        {"the host is silent, but another lease follows", kNow_ns - kLong, 2, 0, false, kLease},
        {"the host is silent, and has said stop", kNow_ns - kLong, 1, 1, false, 0},
    };
    for (const Case& one : kCases) {
        gpu.draw_up();
        gpu.page->dispatch.beat_ns = one.beat_ns;
        gpu.lease->launched = one.launched;
        gpu.lease->stop = one.stop;
        const double there_ms = gpu.run(1, kLease, kLong);
        const std::int64_t opened_ns = gpu.page->tasks[1].gate_opened_ns;
        const double least_ms = 1e-6 * static_cast<double>(one.there_ns);
        // Nothing but its end opens this gate.
        const bool is_right = gpu.is_open() == one.opens && gpu.lease->ended == 1 &&
                              gpu.lease->forsaken == (one.opens ? 1 : 0) &&
                              (!one.opens || opened_ns - kNow_ns >= one.there_ns) &&
                              there_ms >= least_ms && there_ms < least_ms + 1;
        wrong += !is_right;
        std::printf("{\"lease\": \"%s\", \"opens\": %s, \"there_ms\": %.2f, \"right\": %s}\n",
                    one.name, gpu.is_open() ? "true" : "false", there_ms,
                    is_right ? "true" : "false");
    }
    for (const std::int64_t idle_ns : {kIdle, 5 * kMs}) {
        gpu.draw_up();
        must(cudaMemset(gpu.d_state, 0, sizeof *gpu.d_state), "state");
        gpu.page->tasks[1].gates_closed = 0;
        const double there_ms = gpu.run(1, kLong, idle_ns);
        const bool is_right = there_ms >= 1e-6 * static_cast<double>(idle_ns) &&
                              there_ms < 1e-6 * static_cast<double>(idle_ns) + 1;
        wrong += !is_right;
        std::printf(
            "{\"lease\": \"no gate is closed\", \"idle_us\": %lld, \"there_ms\": %.2f, "
            "\"right\": %s}\n",
            static_cast<long long>(idle_ns / 1000), there_ms, is_right ? "true" : "false");
    }
    std::printf("{\"gpu\": \"%s\", \"leases_wrong\": %d}\n", properties.name, wrong);
    return wrong == 0 ? 0 : 1;
}
