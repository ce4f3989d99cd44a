// SPDX-License-Identifier: Apache-2.0
//
// How fast a chain of small kernels goes through one stream of a GPU, and how long a launch keeps
// its thread. Run bare, under the preload, and as a chain of the config that it writes itself:
// `urgengo bench launches` does that. With `tracking` it compares frames of chains with frames of
// a bystander, for `urgengo bench tracking`.
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
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "host/base/atomic_file.h"
#include "tools/bench/bench_config.h"
#include "tools/bench/spin_gpu.h"
#include "tools/bench/tracking_frames.h"
#include "tools/log/log.h"
#include "urgengo/urgengo.h"

namespace urgengo::bench {
namespace {

using SteadyClock = std::chrono::steady_clock;
using Json = nlohmann::ordered_json;

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

/// Lists are by kernel.
struct TrackingOptions {
    std::vector<double> kernel_us{3, 10, 30, 100};
    std::vector<unsigned> iterations;
    std::vector<int> frame_launches;
    std::vector<std::string> situations;
    double seconds = 0.35;
    bool calibrate = false;
    std::string json;
};

struct Measured {
    double seconds = 0;
    std::vector<std::uint32_t> launch_ns;
};

Measured run_frames(const SpinGpu& gpu, CUstream stream, const Options& options) {
    Measured measured;
    measured.launch_ns.reserve(4'000'000);
    double warm_up = 0.2;
    while (measured.seconds < options.seconds) {
        const std::size_t before = measured.launch_ns.size();
        const auto begin = SteadyClock::now();
        auto last = begin;
        for (int i = 0; i < options.frame_launches; ++i) {
            gpu.launch(options.iterations, stream);
            const auto now = SteadyClock::now();
            measured.launch_ns.push_back(static_cast<std::uint32_t>(
                std::chrono::duration_cast<std::chrono::nanoseconds>(now - last).count()));
            last = now;
        }
        MUST(cuStreamSynchronize(stream));
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

std::string cuda_version() {
    int driver = 0;
    MUST(cuDriverGetVersion(&driver));
    return fmt::format("{}.{}", driver / 1000, driver % 1000 / 10);
}

Json to_json(const SpinGpu& gpu, const Options& options, Measured measured) {
    const std::size_t launches = measured.launch_ns.size();
    double sum = 0;
    for (const std::uint32_t ns : measured.launch_ns) sum += ns;
    std::sort(measured.launch_ns.begin(), measured.launch_ns.end());
    const auto at = [&](double share) {
        return measured
            .launch_ns[static_cast<std::size_t>(share * static_cast<double>(launches - 1))];
    };
    return {{"gpu", gpu.name()},
            {"cuda", cuda_version()},
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
    if (!written) tools::log_error("{}", written.error());
    return written ? 0 : 1;
}

int run(const Options& options) {
    if (!options.write_config.empty()) {
        ConfigSpec spec;
        spec.measured = {{kMeasured, kMeasuredThread, options.kernel_us, options.frame_launches}};
        spec.num_others = options.chains - 1;
        const std::string wrong = write_config(options.write_config, spec);
        if (!wrong.empty()) tools::log_error("{}", wrong);
        return wrong.empty() ? 0 : 1;
    }
    prctl(PR_SET_NAME, options.thread.c_str());
    const SpinGpu gpu;
    const CUstream stream = gpu.make_stream();
    if (options.calibrate) {
        const unsigned iterations = measure_pace(gpu, stream).iterations(options.kernel_us);
        return write(options.json, {{"iterations", iterations},
                                    {"period_us", period_us(gpu, stream, iterations)}});
    }
    return write(options.json, to_json(gpu, options, run_frames(gpu, stream, options)));
}

// --- tracking

double rounded(double value) {
    return std::round(value * 100) / 100;
}

/// By kind of frame and number, a list over the pairs.
Json to_json(const std::vector<FramePair>& pairs) {
    const auto list = [&](auto of_pair, double TrackedFrame::*number) {
        Json values = Json::array();
        for (const FramePair& pair : pairs) values.push_back(rounded(pair.*of_pair.*number));
        return values;
    };
    const auto frames = [&](TrackedFrame FramePair::*of_pair) {
        return Json{{"gpu_us", list(of_pair, &TrackedFrame::gpu_us)},
                    {"elapsed_us", list(of_pair, &TrackedFrame::elapsed_us)},
                    {"launch_cpu_us", list(of_pair, &TrackedFrame::launch_cpu_us)},
                    {"thread_cpu_us", list(of_pair, &TrackedFrame::thread_cpu_us)},
                    {"process_cpu_us", list(of_pair, &TrackedFrame::process_cpu_us)}};
    };
    return {{"chain", frames(&FramePair::chain)}, {"nobody", frames(&FramePair::unscheduled)}};
}

int run_tracking(const TrackingOptions& options) {
    prctl(PR_SET_NAME, kBystanderThread);
    const SpinGpu gpu;
    const std::size_t kernels = options.kernel_us.size();
    if (options.calibrate) {
        const Pace pace = measure_pace(gpu, gpu.make_stream());
        Json iterations = Json::array();
        for (const double us : options.kernel_us) iterations.push_back(pace.iterations(us));
        return write(options.json, {{"iterations", iterations}, {"fixed_us", pace.fixed_us}});
    }
    if (options.iterations.size() != kernels || options.frame_launches.size() != kernels) {
        tools::log_error(
            "found {} --iterations and {} --frame-launches, accepted: one for each --kernel-us",
            options.iterations.size(), options.frame_launches.size());
        return 1;
    }
    Json cells = Json::array();
    for (const std::string& situation : options.situations)
        for (std::size_t k = 0; k < kernels; ++k) {
            const TrackingCell cell{static_cast<int>(cells.size()), situation == kBeside,
                                    options.iterations[k], options.frame_launches[k]};
            cells.push_back(to_json(run_cell(gpu, cell, options.seconds)));
        }
    return write(options.json, {{"gpu", gpu.name()},
                                {"cuda", cuda_version()},
                                {"urgengo", status_word()},
                                {"cells", std::move(cells)}});
}

CLI::App* add_tracking(CLI::App& app, TrackingOptions& options) {
    CLI::App* command = app.add_subcommand(
        "tracking", "Compares frames of chains with frames of a bystander, kernel by kernel");
    command->add_flag("--calibrate", options.calibrate, "Only find --iterations for --kernel-us");
    command->add_option("--kernel-us", options.kernel_us, "Periods [3,10,30,100]")
        ->delimiter(',')
        ->check(CLI::Range(1.0, 1e6));
    command->add_option("--iterations", options.iterations, "What the kernels do")->delimiter(',');
    command->add_option("--frame-launches", options.frame_launches, "Of each kernel")
        ->delimiter(',')
        ->check(CLI::Range(1, 100'000));
    command->add_option("--situations", options.situations, "Where")
        ->delimiter(',')
        ->check(CLI::IsMember({kAlone, kBeside}));
    command->add_option("--seconds", options.seconds, "Of each kernel and situation [0.35]")
        ->check(CLI::Range(0.01, 600.0));
    command->add_option("--json", options.json, "Where to write the result [stdout]");
    return command;
}

}  // namespace
}  // namespace urgengo::bench

int main(int argc, char** argv) {
    using namespace urgengo::bench;
    urgengo::tools::set_log_name("urgengo_launch_bench");
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
    TrackingOptions tracking_options;
    const CLI::App* tracking = add_tracking(app, tracking_options);
    CLI11_PARSE(app, argc, argv);
    return tracking->parsed() ? run_tracking(tracking_options) : run(options);
}
