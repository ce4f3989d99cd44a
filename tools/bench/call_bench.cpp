// SPDX-License-Identifier: Apache-2.0
//
// What a driver call costs its thread, one case a kind of call. Run bare, under the preload without
// a config, and under it with a config of this program's own (`--write-config`), the differences
// are UrgenGo's own time: `urgengo bench calls` does that.
//
// An ordinary driver-API program. Launches come in frames, as a real program's do: kFrameLaunches
// launches are timed, then the stream is synchronised, which is not. The other chains are threads
// that have launched one kernel behind a wait that is satisfied when the case is over.
#include <benchmark/benchmark.h>
#include <cuda.h>
#include <dlfcn.h>
#include <sys/prctl.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "tools/bench/bench_config.h"
#include "tools/log/log.h"
#include "urgengo/urgengo.h"

namespace urgengo::bench {
namespace {

using SteadyClock = std::chrono::steady_clock;

constexpr char kImage[] = "";  // the driver does not look at it

#define MUST(call) must((call), #call)
void must(CUresult result, const char* call) {
    if (result == CUDA_SUCCESS) return;
    tools::log_error("{} answers {}", call, static_cast<int>(result));
    std::exit(1);
}

struct Gpu {
    Gpu() {
        MUST(cuInit(0));
        MUST(cuDevicePrimaryCtxRetain(&context, 0));
        MUST(cuCtxSetCurrent(context));
        MUST(cuModuleLoadData(&module, kImage));
        MUST(cuModuleGetFunction(&kernel, module, kKernel));
        // UrgenGo starts at the first launch: from here on every case has it in its final state.
        MUST(cuLaunchKernel(kernel, 1, 1, 1, kKernelThreads, 1, 1, 0, nullptr, nullptr, nullptr));
        MUST(cuStreamSynchronize(nullptr));
    }
    CUcontext context = nullptr;
    CUmodule module = nullptr;
    CUfunction kernel = nullptr;
};

const Gpu& gpu() {
    static const Gpu the_gpu;
    return the_gpu;
}

// From the command line.
int g_num_chains = 1;
/// Launches between two synchronisations.
constexpr int kFrameLaunches = 200;

CUstream make_stream() {
    CUstream stream = nullptr;
    MUST(cuStreamCreate(&stream, CU_STREAM_NON_BLOCKING));
    return stream;
}

void name_this_thread(const std::string& name) {
    prctl(PR_SET_NAME, name.c_str());
}

CUresult launch_plain(CUstream stream) {
    return cuLaunchKernel(gpu().kernel, 1, 1, 1, kKernelThreads, 1, 1, 0, stream, nullptr, nullptr);
}

CUresult launch_ex(CUstream stream) {
    CUlaunchConfig config{};
    config.gridDimX = config.gridDimY = config.gridDimZ = 1;
    config.blockDimX = kKernelThreads, config.blockDimY = config.blockDimZ = 1;
    config.hStream = stream;
    return cuLaunchKernelEx(&config, gpu().kernel, nullptr, nullptr);
}

/// The other chains, each with work on the GPU for as long as the object lives.
class Others {
  public:
    explicit Others(int count) {
        gpu();
        void* memory = nullptr;
        MUST(cuMemHostAlloc(&memory, sizeof *gate_, CU_MEMHOSTALLOC_DEVICEMAP));
        gate_ = static_cast<std::atomic<std::uint32_t>*>(memory);
        gate_->store(0);
        for (int i = 1; i <= count; ++i) {
            launched_ = false;
            threads_.emplace_back([this, i] { be_on_gpu(i); });
            launched_.wait(false);
        }
    }
    ~Others() {
        gate_->store(1);
        over_ = true;
        over_.notify_all();
        for (std::thread& thread : threads_) thread.join();
    }
    Others(const Others&) = delete;
    Others& operator=(const Others&) = delete;

  private:
    void be_on_gpu(int index) {
        name_this_thread(other_chain(index));
        MUST(cuCtxSetCurrent(gpu().context));
        CUstream stream = make_stream();
        CUdeviceptr d_gate = 0;
        MUST(cuMemHostGetDevicePointer(&d_gate, gate_, 0));
        MUST(cuStreamWaitValue32(stream, d_gate, 1, CU_STREAM_WAIT_VALUE_GEQ));
        MUST(launch_plain(stream));
        launched_ = true;
        launched_.notify_all();
        over_.wait(false);
        MUST(cuStreamSynchronize(stream));
        MUST(cuStreamDestroy(stream));
    }

    std::atomic<std::uint32_t>* gate_ = nullptr;
    std::atomic<bool> launched_{false};
    std::atomic<bool> over_{false};
    std::vector<std::thread> threads_;
};

/// @returns a library's function that says how many calls this thread has made of it; null if the
///          library is not loaded, or does not count
auto call_counter(const char* path, const char* name) {
    void* library = path ? dlopen(path, RTLD_NOLOAD | RTLD_LAZY) : nullptr;
    return reinterpret_cast<std::uint64_t (*)()>(library ? dlsym(library, name) : nullptr);
}

/// How many calls this thread has made of the driver, if it is one that counts.
std::uint64_t num_driver_calls() {
    static const auto function = [] {
        // Under UrgenGo libcuda.so.1 is UrgenGo's, and the driver has no other name than its path.
        const char* real = std::getenv("URGENGO_REAL_LIBCUDA");
        return call_counter(real ? real : "libcuda.so.1", "nulldriver_num_calls");
    }();
    return function ? function() : 0;
}

/// The same of the NVTX tool, which is there after the first launch.
std::uint64_t num_nvtx_calls() {
    static const auto function =
        call_counter(std::getenv("NVTX_INJECTION64_PATH"), "nullnvtx_num_calls");
    return function ? function() : 0;
}

/// Adds what Google Benchmark does not know: how one call's cost is distributed over the frames.
void report_frames(benchmark::State& state, std::vector<double>& ns, std::uint64_t driver_calls) {
    if (ns.empty()) return;
    std::sort(ns.begin(), ns.end());
    const auto at = [&](double share) {
        return ns[static_cast<std::size_t>(share * static_cast<double>(ns.size() - 1))];
    };
    state.counters["median_ns"] = at(0.5);
    state.counters["p90_ns"] = at(0.9);
    state.counters["p99_ns"] = at(0.99);
    state.counters["driver_calls"] =
        static_cast<double>(driver_calls) / static_cast<double>(state.iterations());
}

enum class Where { kOwnStream, kDefaultStream };

/// Times frames of launches in a thread of its own: a thread that has given a hint once is never
/// known by its name again.
/// @param begin_frame, end_frame  not timed
template <typename Launch, typename BeginFrame, typename EndFrame>
void time_frames(benchmark::State& state, const char* thread_name, Where where, Launch&& launch,
                 BeginFrame&& begin_frame, EndFrame&& end_frame) {
    std::thread([&] {
        name_this_thread(thread_name);
        MUST(cuCtxSetCurrent(gpu().context));
        CUstream stream = where == Where::kOwnStream ? make_stream() : nullptr;
        std::vector<double> frames_ns;
        frames_ns.reserve(1 << 20);
        std::uint64_t driver_calls = 0;
        const std::uint64_t nvtx_calls_before = num_nvtx_calls();
        while (state.KeepRunningBatch(kFrameLaunches)) {
            begin_frame();
            const std::uint64_t calls_before = num_driver_calls();
            const auto begin = SteadyClock::now();
            for (int i = 0; i < kFrameLaunches; ++i) launch(stream);
            const std::chrono::duration<double> time = SteadyClock::now() - begin;
            driver_calls += num_driver_calls() - calls_before;
            state.SetIterationTime(time.count());
            frames_ns.push_back(time.count() * 1e9 / kFrameLaunches);
            MUST(cuStreamSynchronize(stream));
            end_frame();
        }
        report_frames(state, frames_ns, driver_calls);
        // Of whole frames: what is told at their begins and ends is told there.
        state.counters["nvtx_calls"] = static_cast<double>(num_nvtx_calls() - nvtx_calls_before) /
                                       static_cast<double>(state.iterations());
        if (stream) MUST(cuStreamDestroy(stream));
    }).join();
}

template <typename Launch>
void of_bystander(benchmark::State& state, Launch&& launch) {
    time_frames(
        state, kBystanderThread, Where::kOwnStream, launch, [] {}, [] {});
}

template <typename Launch>
void by_name(benchmark::State& state, Launch&& launch) {
    const Others others(g_num_chains - 1);
    time_frames(
        state, kMeasuredThread, Where::kOwnStream, launch, [] {}, [] {});
}

template <typename Launch>
void by_hint(benchmark::State& state, Launch&& launch, Where where = Where::kOwnStream) {
    const Others others(g_num_chains - 1);
    ug_hints hints;
    ug_hints_load(&hints);
    time_frames(
        state, kBystanderThread, where, launch,
        [&] { hints.task_begin(hints.arrival(kMeasured, 0, UG_CLOCK_MONOTONIC), kMeasured); },
        [&] { hints.task_end(); });
}

/// Calls that are not launches: in this thread, which is of no chain, all iterations timed.
template <typename Call>
void time_calls(benchmark::State& state, Call&& call) {
    gpu();
    const std::uint64_t calls_before = num_driver_calls();
    for (auto _ : state) benchmark::DoNotOptimize(call());
    state.counters["driver_calls"] = static_cast<double>(num_driver_calls() - calls_before) /
                                     static_cast<double>(state.iterations());
}

void register_cases() {
    using benchmark::RegisterBenchmark;
    using benchmark::State;
    RegisterBenchmark("pass_through/cuCtxGetDevice", [](State& state) {
        CUdevice device;
        time_calls(state, [&] { return cuCtxGetDevice(&device); });
    });
    RegisterBenchmark("nothing_to_do/cuEventRecord", [](State& state) {
        gpu();
        CUevent event = nullptr;
        CUstream stream = make_stream();
        MUST(cuEventCreate(&event, CU_EVENT_DISABLE_TIMING));
        time_calls(state, [&] { return cuEventRecord(event, stream); });
    });
    RegisterBenchmark("nothing_to_do/cuStreamSynchronize", [](State& state) {
        gpu();
        CUstream stream = make_stream();
        time_calls(state, [&] { return cuStreamSynchronize(stream); });
    });
    RegisterBenchmark("nothing_to_do/cuLaunchKernel", [](State& s) {
        of_bystander(s, launch_plain);
    })->UseManualTime();
    RegisterBenchmark("nothing_to_do/cuLaunchKernelEx", [](State& s) {
        of_bystander(s, launch_ex);
    })->UseManualTime();
    RegisterBenchmark("pair/launch+synchronize", [](State& state) {
        gpu();
        CUstream stream = make_stream();
        time_calls(state, [&] {
            launch_plain(stream);
            return cuStreamSynchronize(stream);
        });
    });
    RegisterBenchmark("scheduled/by_hint/cuLaunchKernel", [](State& s) {
        by_hint(s, launch_plain);
    })->UseManualTime();
    RegisterBenchmark("scheduled/by_hint/cuLaunchKernelEx", [](State& s) {
        by_hint(s, launch_ex);
    })->UseManualTime();
    // As PyTorch does. A default stream says nothing about its context.
    RegisterBenchmark("scheduled/by_hint/default_stream", [](State& s) {
        by_hint(s, launch_plain, Where::kDefaultStream);
    })->UseManualTime();
    RegisterBenchmark("scheduled/by_name/cuLaunchKernel", [](State& s) {
        by_name(s, launch_plain);
    })->UseManualTime();
    RegisterBenchmark("scheduled/by_name/cuLaunchKernelEx", [](State& s) {
        by_name(s, launch_ex);
    })->UseManualTime();
}

/// Options of our own, taken out of the arguments.
struct OwnOptions {
    std::string write_config;
    std::optional<std::chrono::microseconds> mark_every;
    double kernel_us = 3;
};

OwnOptions take_own_options(int& argc, char** argv) {
    OwnOptions own;
    const auto value_of = [](std::string_view argument, std::string_view name) -> const char* {
        return argument.starts_with(name) ? argument.data() + name.size() : nullptr;
    };
    int kept = 1;
    for (int i = 1; i < argc; ++i) {
        const char* value = nullptr;
        if ((value = value_of(argv[i], "--chains=")))
            g_num_chains = std::atoi(value);
        else if ((value = value_of(argv[i], "--write-config=")))
            own.write_config = value;
        else if ((value = value_of(argv[i], "--mark-every-us=")))
            own.mark_every = std::chrono::microseconds(std::atoi(value));
        else if ((value = value_of(argv[i], "--kernel-us=")))
            own.kernel_us = std::atof(value);
        else
            argv[kept++] = argv[i];
    }
    argc = kept;
    return own;
}

}  // namespace
}  // namespace urgengo::bench

int main(int argc, char** argv) {
    using namespace urgengo::bench;
    urgengo::tools::set_log_name("urgengo_call_bench");
    const OwnOptions own = take_own_options(argc, argv);
    if (g_num_chains < 1 || g_num_chains > 63) {
        urgengo::tools::log_error("--chains: accepted: 1 to 63");
        return 2;
    }
    if (!own.write_config.empty()) {
        ConfigSpec spec;
        spec.measured = {{kMeasured, kMeasuredThread, own.kernel_us, kFrameLaunches}};
        spec.num_others = g_num_chains - 1;
        spec.scheduler.progress.mark_every = own.mark_every;
        const std::string wrong = write_config(own.write_config, spec);
        if (!wrong.empty()) urgengo::tools::log_error("{}", wrong);
        return wrong.empty() ? 0 : 1;
    }
    register_cases();
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
    benchmark::RunSpecifiedBenchmarks();
    return 0;
}
