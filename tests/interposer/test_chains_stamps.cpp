// SPDX-License-Identifier: Apache-2.0
//
// `urgengo-chains run --stamps` on the simulated GPU: every launch leaves its stamp, in order, and
// positions are asked for while tasks run.
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "host/config/file_text.h"
#include "tests/support/catch.h"
#include "tools/chains/stamps_file.h"
#include "tools/chains/workload.h"
#include "tools/simgpu/simgpu.h"
#include "tools/urgengo/environment.h"
#include "tools/urgengo/program/run_process.h"
#include "tools/urgengo/temporary_folder.h"

using namespace urgengo;
using namespace urgengo::cli;

namespace {

constexpr char kYaml[] =
    "version: 1\nchains: [{name: C0, period_ms: 60, deadline_ms: 60, arrival: {from: hint}, "
    "tasks: [{name: first, thread: C0}, {name: second, thread: C0}]}]\n";
constexpr int kLaunches = 5;  // of a frame: two of `first`, three of `second`
/// 20000 iterations of 22.2 ns: one wave of 40 blocks on 46 multiprocessors.
constexpr std::int64_t kKernel_ns = 444'000;
constexpr std::int64_t kOverhead_ns = 2'000;

std::string workload() {
    const chains::Kernel kernel{chains::KernelKind::kCompute, 40, 256, 20000, 444, 0.2};
    chains::Workload workload;
    workload.gpu = "UrgenGo Simulated GPU";
    workload.num_sms = 46;
    workload.chains = {{"C0",
                        60,
                        60,
                        {{"first", 1, 0.9, 1, 1, {kernel, kernel}},
                         {"second", 1, 1.3, 1, 1, {kernel, kernel, kernel}}}}};
    return chains::format_workload(workload);
}

template <typename Element>
std::vector<Element> take(const nlohmann::json& array, std::string& data) {
    REQUIRE(array["bytes"].get<std::size_t>() == sizeof(Element));
    std::vector<Element> elements(array["count"].get<std::size_t>());
    const std::size_t bytes = elements.size() * sizeof(Element);
    REQUIRE(data.size() >= bytes);
    std::memcpy(elements.data(), data.data(), bytes);
    data.erase(0, bytes);
    return elements;
}

struct ChainsRun {
    std::unique_ptr<TemporaryFolder> folder;
    std::string output;
    int exit_code = 0;

    std::string path(const char* name) const { return folder->path() + "/" + name; }
};

ChainsRun run_chains(const std::vector<std::string>& options, bool scheduled) {
    auto folder = TemporaryFolder::make();
    REQUIRE(folder);
    ChainsRun run{std::move(*folder), {}, 0};
    std::ofstream(run.path("workload.json")) << workload();
    std::ofstream(run.path("chains.yaml")) << kYaml;
    Environment environment = current_environment();
    environment["LD_LIBRARY_PATH"] = SIMGPU_FOLDER;
    environment["URGENGO_REAL_LIBCUDA"] = SIMGPU_FOLDER "/libcuda.so.1";
    environment["ASAN_OPTIONS"] = "verify_asan_link_order=0:detect_leaks=0";
    std::vector<std::string> arguments;
    if (scheduled)
        arguments = {URGENGO_PATH, "run", "--quiet", "-c", run.path("chains.yaml"), "--"};
    arguments.insert(arguments.end(), {CHAINS_PATH, "run", "--workload", run.path("workload.json"),
                                       "--seconds", "0.6", "--tight", "C0"});
    for (const std::string& option : options)
        arguments.push_back(option == "STAMPS" ? run.path("stamps") : option);
    const auto process = run_process(arguments, environment);
    REQUIRE(process);
    run.output = process->output;
    run.exit_code = process->exit_code;
    return run;
}

struct Written {
    nlohmann::json header;
    std::vector<chains::LaunchStamp> stamps;
    std::vector<chains::TaskRun> runs;
    std::vector<chains::PositionSample> samples;
};

Written read(const ChainsRun& run) {
    INFO(run.output);
    REQUIRE(run.exit_code == 0);
    std::string data = *config::read_file(run.path("stamps"));
    Written written;
    const auto line = data.find('\n');
    written.header = nlohmann::json::parse(data.substr(0, line));
    data.erase(0, line + 1);
    const auto& arrays = written.header["arrays"];
    REQUIRE(arrays.size() == 3);  // of one stream, and the samples
    written.stamps = take<chains::LaunchStamp>(arrays[0], data);
    written.runs = take<chains::TaskRun>(arrays[1], data);
    written.samples = take<chains::PositionSample>(arrays[2], data);
    CHECK(data.empty());
    return written;
}

}  // namespace

TEST_CASE("Every launch leaves a stamp, in the order of its stream", "[interposer][chains]") {
    const Written written = read(run_chains({"--stamps", "STAMPS"}, false));
    const auto& stream = written.header["streams"][0];
    CHECK(stream["lost"].get<int>() == 0);
    CHECK(stream["tasks"].get<std::vector<std::string>>() ==
          std::vector<std::string>{"first", "second"});
    CHECK(stream["launches"].get<std::size_t>() == written.stamps.size());
    REQUIRE(written.runs.size() >= 9 * 2);
    CHECK(written.runs.size() <= 10 * 2);
    REQUIRE(written.stamps.size() == written.runs.size() / 2 * kLaunches);
    std::uint64_t end_before = 0;
    for (const chains::LaunchStamp& stamp : written.stamps) {
        CHECK(std::abs(std::int64_t(stamp.end_ns - stamp.begin_ns) - kKernel_ns) <= 1);
        CHECK(stamp.begin_ns >= end_before);
        end_before = stamp.end_ns;
    }
    std::uint32_t launch = 0;
    for (std::size_t i = 0; i < written.runs.size(); i++) {
        const chains::TaskRun& run = written.runs[i];
        CHECK(run.task == i % 2);
        CHECK(run.frame == i / 2);
        CHECK(run.first_launch == launch);
        CHECK(run.num_launches == (run.task == 0 ? 2 : 3));
        launch += run.num_launches;
        const auto& stamps = written.stamps;
        CHECK(std::int64_t(stamps[run.first_launch + 1].begin_ns -
                           stamps[run.first_launch].end_ns) >= kOverhead_ns);
    }
    // Nobody answers without UrgenGo.
    for (const chains::PositionSample& sample : written.samples) CHECK(sample.flags == 0);
}

TEST_CASE("The clocks are read before the run and after it", "[interposer][chains]") {
    const Written written = read(run_chains({"--stamps", "STAMPS", "--sample-us", "0"}, false));
    CHECK(written.samples.empty());
    const auto& clock = written.header["clock"];
    REQUIRE(clock.size() == 2);
    for (const auto& reading : clock) {
        CHECK(reading["gpu_ns"].get<std::int64_t>() - reading["host_ns"].get<std::int64_t>() ==
              SIMGPU_GLOBALTIMER_OFFSET_NS);
    }
    CHECK(clock[0]["gpu_ns"].get<std::uint64_t>() <= written.stamps.front().begin_ns);
    CHECK(clock[1]["gpu_ns"].get<std::uint64_t>() >= written.stamps.back().end_ns);
}

TEST_CASE("Positions are asked for while tasks run", "[interposer][chains]") {
    const ChainsRun run = run_chains({"--stamps", "STAMPS", "--sample-us", "200"}, true);
    const Written written = read(run);
    CHECK(run.output.find("Stamps of ") != std::string::npos);
    const auto& sampler = written.header["sampler"];
    CHECK(sampler["mean_us"].get<double>() == 200);
    CHECK(sampler["wakes"].get<int>() > 500);
    CHECK(sampler["lost"].get<int>() == 0);
    CHECK(sampler["cpu_s"].get<double>() > 0);
    REQUIRE(written.samples.size() > 20);
    std::int64_t before_ns = 0;
    std::size_t answered = 0;
    for (const chains::PositionSample& sample : written.samples) {
        CHECK(sample.before_ns >= before_ns);
        before_ns = sample.before_ns;
        REQUIRE(sample.run < written.runs.size());
        if (!(sample.flags & chains::PositionSample::kAnswered)) continue;
        answered++;
        CHECK(sample.launch <= 3);
        // Instances of the task, from 1; right after the begin still the last one.
        CHECK(sample.instance <= sample.run / 2 + 1);
        CHECK(sample.instance + 1 >= sample.run / 2 + 1);
    }
    CHECK(answered > written.samples.size() / 2);
}

TEST_CASE("A bystander fills the GPU beside the chains", "[interposer][chains]") {
    const Written written = read(
        run_chains({"--stamps", "STAMPS", "--bystander", "4", "--bystander-every", "6"}, false));
    std::size_t delayed = 0;
    for (const chains::LaunchStamp& stamp : written.stamps)
        delayed += std::int64_t(stamp.end_ns - stamp.begin_ns) > kKernel_ns + kOverhead_ns;
    std::size_t late = 0;
    for (const chains::TaskRun& run : written.runs) {
        const auto* stamps = &written.stamps[run.first_launch];
        late += std::int64_t(stamps[1].begin_ns - stamps[0].end_ns) > 10 * kOverhead_ns;
    }
    CHECK(delayed + late > 0);
}

TEST_CASE("Stamps that cannot be written are refused before the run", "[interposer][chains]") {
    const ChainsRun no_folder = run_chains({"--stamps", "/no/such/folder/stamps"}, false);
    CHECK(no_folder.exit_code == 1);
    CHECK(no_folder.output.find("cannot write /no/such/folder/stamps: No such file or directory") !=
          std::string::npos);
    const ChainsRun too_often = run_chains({"--stamps", "STAMPS", "--sample-us", "5"}, false);
    CHECK(too_often.exit_code == 1);
    CHECK(too_often.output.find("--sample-us 5: accepted: 0, or 20 and more") != std::string::npos);
}
