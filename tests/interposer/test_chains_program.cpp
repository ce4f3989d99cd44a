// SPDX-License-Identifier: Apache-2.0
//
// urgengo-chains under UrgenGo on the simulated GPU: what it says of its frames is true, and
// without hints it says nothing.
#include <algorithm>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "host/config/config_reader.h"
#include "host/config/file_text.h"
#include "tests/support/catch.h"
#include "tools/bench/measure/instance_records.h"
#include "tools/chains/workload.h"
#include "tools/urgengo/environment.h"
#include "tools/urgengo/program/run_process.h"
#include "tools/urgengo/temporary_folder.h"

using namespace urgengo;
using namespace urgengo::cli;

namespace {

constexpr char kYaml[] =
    "version: 1\nchains: [{name: C0, period_ms: 60, deadline_ms: 60, "
    "tasks: [{name: frame, thread: C0}]}]\n";

/// Two tasks, each its own segment of the chain's thread.
chains::Workload small_workload() {
    const chains::Kernel kernel{chains::KernelKind::kCompute, 40, 256, 20000, 50, 0.2};
    chains::Workload workload;
    workload.gpu = "UrgenGo Simulated GPU";
    workload.num_sms = 46;
    workload.chains = {{"C0",
                        60,
                        60,
                        {{"first", 1, 0.1, 22000, 65000, {kernel, kernel}},
                         {"second", 1, 0.15, 1, 1, {kernel, kernel, kernel}}}}};
    return workload;
}

/// What `urgengo profile` would learn of it.
nlohmann::json small_profile() {
    const auto segment = [](int launches) {
        return nlohmann::json{{"cpu_time_ns", 1'000'000},
                              {"num_launches", launches},
                              {"min_launches", launches},
                              {"max_launches", launches},
                              {"closed_by", "stream"}};
    };
    const nlohmann::json kernel = {{"name", "chains_comp"},
                                   {"grid_blocks", 40},
                                   {"block_threads", 256},
                                   {"gpu_time_ns", 50'000},
                                   {"utilization", 0.2}};
    return {{"format_version", 2},
            {"gpu", "UrgenGo Simulated GPU"},
            {"driver", "13.0"},
            {"chains",
             {{{"name", "C0"},
               {"tasks",
                {{{"name", "frame"},
                  {"cpu_time_ns", 2'000'000},
                  {"instances", 5},
                  {"segments", {segment(2), segment(3)}},
                  {"kernels", {kernel, kernel, kernel, kernel, kernel}}}}}}}}};
}

/// One run, and what it left behind.
struct ProgramRun {
    std::vector<TrueFrame> frames;
    std::vector<DetectedInstance> detected;
    trace::Trace trace;

    std::ptrdiff_t count(trace::TraceKind kind) const {
        std::ptrdiff_t sum = 0;
        for (const trace::ThreadTrace& thread : trace.threads()) {
            sum += std::count_if(thread.events.begin(), thread.events.end(),
                                 [kind](const auto* event) { return event->kind == kind; });
        }
        return sum;
    }

    /// @returns the grids of the launches of tasks, each once
    std::vector<std::uint32_t> grids() const {
        std::vector<std::uint32_t> all;
        for (const trace::ThreadTrace& thread : trace.threads()) {
            for (const auto* event : thread.events) {
                if (event->kind == trace::TraceKind::kLaunch && event->task == 0) {
                    all.push_back(event->launch.grid_blocks);
                }
            }
        }
        std::sort(all.begin(), all.end());
        all.erase(std::unique(all.begin(), all.end()), all.end());
        return all;
    }
};

constexpr char kAsan[] = "verify_asan_link_order=0:detect_leaks=0";

ProgramRun run_program(const std::vector<std::string>& options) {
    const auto folder = TemporaryFolder::make();
    REQUIRE(folder);
    const auto path = [&](const char* name) { return (*folder)->path() + "/" + name; };
    std::ofstream(path("workload.json")) << chains::format_workload(small_workload());
    std::ofstream(path("chains.yaml")) << kYaml;
    std::ofstream(path("chains.profile.json")) << small_profile();

    Environment environment = current_environment();
    environment["LD_LIBRARY_PATH"] = SIMGPU_FOLDER;
    environment["URGENGO_REAL_LIBCUDA"] = SIMGPU_FOLDER "/libcuda.so.1";
    environment["URGENGO_TRACE"] = path("trace");
    environment["ASAN_OPTIONS"] = kAsan;
    std::vector<std::string> arguments{URGENGO_PATH,
                                       "run",
                                       "-c",
                                       path("chains.yaml"),
                                       "--",
                                       CHAINS_PATH,
                                       "run",
                                       "--workload",
                                       path("workload.json"),
                                       "--tight",
                                       "C0",
                                       "--seconds",
                                       "0.6",
                                       "--instances",
                                       "--json",
                                       path("report.json")};
    arguments.insert(arguments.end(), options.begin(), options.end());
    const auto process = run_process(arguments, environment);
    REQUIRE(process);
    INFO(process->output);
    REQUIRE(process->exit_code == 0);

    auto frames = parse_true_frames(*config::read_file(path("report.json")), "report");
    REQUIRE(frames);
    auto trace = trace::read_trace(path("trace"));
    REQUIRE(trace);
    const auto config = config::read_config(path("chains.yaml"));
    REQUIRE(config);
    auto detected = detected_instances(*trace, *config);
    REQUIRE(detected);
    return {(*frames)["C0"], (*detected)["C0"], std::move(*trace)};
}

/// @returns of each chain of a bare run, its frames' arrivals since the run's start
std::map<std::string, std::vector<std::int64_t>> arrivals_of(
    const std::vector<std::string>& options) {
    const auto folder = TemporaryFolder::make();
    REQUIRE(folder);
    const std::string workload = (*folder)->path() + "/workload.json";
    const std::string report = (*folder)->path() + "/report.json";
    chains::Workload three = small_workload();
    three.chains.resize(3, three.chains[0]);
    for (std::size_t i = 0; i < 3; ++i) three.chains[i].name = "C" + std::to_string(i);
    std::ofstream(workload) << chains::format_workload(three);
    Environment environment = current_environment();
    environment["LD_LIBRARY_PATH"] = SIMGPU_FOLDER;
    environment["ASAN_OPTIONS"] = kAsan;
    std::vector<std::string> arguments{CHAINS_PATH, "run",    "--workload", workload,
                                       "--f-tight", "0",      "--variable", "--seconds",
                                       "0.5",       "--seed", "7",          "--cpu",
                                       "sleep",     "--json", report,       "--instances"};
    arguments.insert(arguments.end(), options.begin(), options.end());
    const auto process = run_process(arguments, environment);
    REQUIRE(process);
    INFO(process->output);
    REQUIRE(process->exit_code == 0);
    const auto json = nlohmann::json::parse(*config::read_file(report));
    std::map<std::string, std::vector<std::int64_t>> arrivals;
    for (const auto& chain : json.at("chains"))
        for (const auto& record : chain.at("records"))
            arrivals[chain.at("name")].push_back(record.at("arrival_ns").get<std::int64_t>() -
                                                 json.at("start_ns").get<std::int64_t>());
    return arrivals;
}

}  // namespace

TEST_CASE("Workload's chain has the same arrivals alone as among others", "[interposer][chains]") {
    const auto all = arrivals_of({});
    REQUIRE(all.size() == 3);
    CHECK(all.at("C0") != all.at("C2"));
    for (const auto& [chain, arrivals] : all) {
        CHECK(arrivals.size() >= 7);
        CHECK(arrivals_of({"--only", chain}) == decltype(all){{chain, arrivals}});
    }
}

TEST_CASE("Workload's frames are the instances that UrgenGo saw", "[interposer][chains]") {
    const ProgramRun run = run_program({"--no-hints"});
    CHECK(run.frames.size() >= 9);
    CHECK(run.frames.size() <= 10);
    const InstanceMatch match = match_instances(run.frames, run.detected);
    CHECK(match.detected == match.frames);
    CHECK(match.false_starts == 0);
    CHECK(match.missed_starts == 0);
    CHECK(match.merged == 0);
    CHECK(match.end_error_us.size() == run.frames.size());
    CHECK(run.count(trace::TraceKind::kArrival) == 0);
    CHECK(run.count(trace::TraceKind::kTaskBegin) == 0);
    CHECK(run.grids() == std::vector<std::uint32_t>{40});
}

TEST_CASE("Workload gives hints and varies the sizes of its inputs when asked",
          "[interposer][chains]") {
    const ProgramRun run = run_program({"--variable"});
    CHECK(run.count(trace::TraceKind::kArrival) == std::ptrdiff_t(run.frames.size()));
    const auto grids = run_program({"--no-hints", "--variable"}).grids();
    CHECK(grids.size() > 5);
    CHECK(grids.front() >= 20);
    CHECK(grids.back() <= 60);
}
