// SPDX-License-Identifier: Apache-2.0
//
// How fast a chain of small kernels goes through one stream of a GPU, and how long a launch keeps
// its thread. Run bare, under the preload, and as a chain of the config that it writes itself:
// `urgengo bench launches` does that.
//
// An ordinary driver-API program. One thread launches frames of kernels and waits for each frame.
#include <cuda.h>
#include <fmt/format.h>
#include <sys/prctl.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "host/base/atomic_file.h"
#include "tools/bench/bench_config.h"
#include "urgengo/urgengo.h"

extern "C" const unsigned char urgengo_bench_fatbin[];

namespace urgengo::bench {
namespace {

using SteadyClock = std::chrono::steady_clock;
using Json = nlohmann::ordered_json;

#define MUST(call) must((call), #call)
void must(CUresult result, const char* call) {
    if (result == CUDA_SUCCESS) return;
    fmt::print(stderr, "urgengo_launch_bench: {} answers {}\n", call, static_cast<int>(result));
    std::exit(1);
}

class Gpu {
  public:
    Gpu() {
        CUcontext context = nullptr;
        CUmodule module = nullptr;
        MUST(cuInit(0));
        MUST(cuDeviceGet(&device_, 0));
        MUST(cuDevicePrimaryCtxRetain(&context, device_));
        MUST(cuCtxSetCurrent(context));
        MUST(cuModuleLoadData(&module, urgengo_bench_fatbin));
        MUST(cuModuleGetFunction(&kernel_, module, kKernel));
        MUST(cuStreamCreate(&stream_, CU_STREAM_NON_BLOCKING));
    }

    void launch(unsigned iterations) const {
        CUdeviceptr nowhere = 0;
        void* parameters[] = {&iterations, &nowhere};
        MUST(cuLaunchKernel(kernel_, 1, 1, 1, kKernelThreads, 1, 1, 0, stream_, parameters,
                            nullptr));
    }
    void synchronize() const { MUST(cuStreamSynchronize(stream_)); }

    /// @returns the time from one kernel's start to the next one's in a long chain, microseconds
    double period_us(unsigned iterations) const {
        constexpr int kLaunches = 3000;
        for (int i = 0; i < 100; ++i) launch(iterations);
        synchronize();
        const auto begin = SteadyClock::now();
        for (int i = 0; i < kLaunches; ++i) launch(iterations);
        synchronize();
        const std::chrono::duration<double, std::micro> time = SteadyClock::now() - begin;
        return time.count() / kLaunches;
    }

    std::string name() const {
        char text[256] = {};
        MUST(cuDeviceGetName(text, sizeof text - 1, device_));
        return text;
    }

  private:
    CUdevice device_ = 0;
    CUfunction kernel_ = nullptr;
    CUstream stream_ = nullptr;
};

/// @returns how many iterations make a chain go at this period
unsigned calibrate(const Gpu& gpu, double target_us) {
    constexpr unsigned kFew = 20'000, kMany = 60'000;  // far longer than a launch
    const double us_per_iteration =
        (gpu.period_us(kMany) - gpu.period_us(kFew)) / static_cast<double>(kMany - kFew);
    if (us_per_iteration <= 1e-6) {
        fmt::print(stderr,
                   "urgengo_launch_bench: kernels take the same time whatever they do; "
                   "a simulated GPU? accepted then: --iterations\n");
        std::exit(1);
    }
    const double fixed_us = gpu.period_us(kFew) - kFew * us_per_iteration;
    const double iterations = (target_us - fixed_us) / us_per_iteration;
    if (iterations < 0) {
        fmt::print(stderr,
                   "urgengo_launch_bench: an empty kernel takes {:.2f} us of the stream, "
                   "accepted: a longer --kernel-us\n",
                   fixed_us);
        std::exit(1);
    }
    return static_cast<unsigned>(std::lround(iterations));
}

struct Options {
    bool calibrate = false;
    double kernel_us = 3;
    unsigned iterations = 0;
    int frame_launches = 200;
    double seconds = 2;
    std::string thread = kMeasuredThread;
    std::string json;
    std::string write_config;
    int chains = 10;
};

struct Measured {
    double seconds = 0;
    std::vector<std::uint32_t> launch_ns;
};

Measured run_frames(const Gpu& gpu, const Options& options) {
    Measured measured;
    measured.launch_ns.reserve(4'000'000);
    double warm_up = 0.2;
    while (measured.seconds < options.seconds) {
        const std::size_t before = measured.launch_ns.size();
        const auto begin = SteadyClock::now();
        auto last = begin;
        for (int i = 0; i < options.frame_launches; ++i) {
            gpu.launch(options.iterations);
            const auto now = SteadyClock::now();
            measured.launch_ns.push_back(static_cast<std::uint32_t>(
                std::chrono::duration_cast<std::chrono::nanoseconds>(now - last).count()));
            last = now;
        }
        gpu.synchronize();
        const double time = std::chrono::duration<double>(SteadyClock::now() - begin).count();
        if (warm_up > 0) {
            warm_up -= time;
            measured.launch_ns.resize(before);
        } else {
            measured.seconds += time;
        }
    }
    return measured;
}

const char* status_word() {
    ug_hints hints;
    if (!ug_hints_load(&hints)) return "not loaded";
    const int status = hints.status();
    return status == 1 ? "scheduling" : status == 2 ? "observing" : "loaded, off";
}

Json to_json(const Gpu& gpu, const Options& options, Measured measured) {
    const std::size_t launches = measured.launch_ns.size();
    double sum = 0;
    for (const std::uint32_t ns : measured.launch_ns) sum += ns;
    std::sort(measured.launch_ns.begin(), measured.launch_ns.end());
    const auto at = [&](double share) {
        return measured
            .launch_ns[static_cast<std::size_t>(share * static_cast<double>(launches - 1))];
    };
    int driver = 0;
    MUST(cuDriverGetVersion(&driver));
    return {{"gpu", gpu.name()},
            {"cuda", fmt::format("{}.{}", driver / 1000, driver % 1000 / 10)},
            {"urgengo", status_word()},
            {"iterations", options.iterations},
            {"frame_launches", options.frame_launches},
            {"launches", launches},
            {"seconds", measured.seconds},
            {"kernels_per_s", static_cast<double>(launches) / measured.seconds},
            {"launch_ns",
             {{"mean", sum / static_cast<double>(launches)},
              {"p50", at(0.5)},
              {"p90", at(0.9)},
              {"p99", at(0.99)},
              {"p999", at(0.999)},
              {"max", at(1)}}}};
}

int write(const std::string& path, const Json& json) {
    const std::string text = json.dump(1) + "\n";
    if (path.empty()) {
        fmt::print("{}", text);
        return 0;
    }
    const auto written = write_file_atomically(path, text);
    if (!written) fmt::print(stderr, "urgengo_launch_bench: {}\n", written.error());
    return written ? 0 : 1;
}

int run(const Options& options) {
    if (!options.write_config.empty()) {
        const std::string wrong = write_config(
            options.write_config, {options.chains, 200, options.kernel_us, options.frame_launches});
        if (!wrong.empty()) fmt::print(stderr, "urgengo_launch_bench: {}\n", wrong);
        return wrong.empty() ? 0 : 1;
    }
    prctl(PR_SET_NAME, options.thread.c_str());
    const Gpu gpu;
    if (options.calibrate) {
        const unsigned iterations = calibrate(gpu, options.kernel_us);
        return write(options.json,
                     {{"iterations", iterations}, {"period_us", gpu.period_us(iterations)}});
    }
    return write(options.json, to_json(gpu, options, run_frames(gpu, options)));
}

}  // namespace
}  // namespace urgengo::bench

int main(int argc, char** argv) {
    using namespace urgengo::bench;
    Options options;
    CLI::App app("Times a chain of small kernels on one stream.", "urgengo_launch_bench");
    app.add_flag("--calibrate", options.calibrate, "Only find --iterations for --kernel-us");
    app.add_option("--kernel-us", options.kernel_us,
                   "Time from one kernel's start to the next one's, alone [3]")
        ->check(CLI::Range(1.0, 1e6));
    app.add_option("--iterations", options.iterations, "What a kernel does, from --calibrate");
    app.add_option("--frame-launches", options.frame_launches, "Between two waits [200]")
        ->check(CLI::Range(1, 100'000));
    app.add_option("--seconds", options.seconds, "How long [2]")->check(CLI::Range(0.01, 600.0));
    app.add_option("--thread", options.thread, "The launching thread's name");
    app.add_option("--json", options.json, "Where to write the result [stdout]");
    app.add_option("--write-config", options.write_config, "Only write UrgenGo's config");
    app.add_option("--chains", options.chains, "In the config; all but one are idle [10]")
        ->check(CLI::Range(1, 63));
    CLI11_PARSE(app, argc, argv);
    return run(options);
}
