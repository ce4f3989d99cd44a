// SPDX-License-Identifier: Apache-2.0
//
// urgengo doctor: the verdict on each topic, from facts and folders made here.
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "host/config/config_reader.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tools/urgengo/doctor/doctor_config.h"
#include "tools/urgengo/doctor/doctor_environment.h"
#include "tools/urgengo/doctor/doctor_gpu.h"
#include "tools/urgengo/doctor/doctor_program.h"
#include "tools/urgengo/doctor/doctor_report.h"
#include "tools/urgengo/doctor/doctor_rights.h"

namespace urgengo::cli {
namespace {

using namespace std::chrono_literals;
using std::chrono::nanoseconds;

namespace fs = std::filesystem;
using testing::Folder;

/// "warn text" for the topic; empty if there is no such finding.
std::string of(const Findings& findings, const std::string& topic) {
    const char* const words[] = {"ok ", "warn ", "bad "};
    for (const Finding& finding : findings) {
        if (finding.topic == topic) return words[static_cast<int>(finding.verdict)] + finding.found;
    }
    return {};
}

bool starts(const std::string& text, const std::string& with) {
    UNSCOPED_INFO(text);
    return text.starts_with(with);
}

GpuFacts h200() {
    GpuFacts facts;
    facts.cuda_version = 13000;
    facts.devices = {{"NVIDIA H200", 9, 0, 132, 143'000, 0}};
    facts.greatest_priority = -5;
    return facts;
}

PriorityMeasurement measurement(Honoured launch, Honoured stream_attribute, Honoured stream) {
    PriorityMeasurement m;
    m.launch_attribute = {launch, {1, 2}};
    m.stream_attribute = {stream_attribute, {1, 2}};
    m.stream = {stream, {1, 2}};
    return m;
}

TEST_CASE("Doctor's report has the worst verdict of all", "[unit][cli]") {
    Findings findings{{"a", Verdict::kOk, "fine"}};
    CHECK(to_text(findings) == "ok    a  fine\nUrgenGo can schedule here.\n");
    append(findings, {{"longer", Verdict::kWarn, "hm"}});
    CHECK(to_text(findings) ==
          "ok    a       fine\nwarn  longer  hm\nUrgenGo can schedule here; mind the warnings.\n");
    append(findings, {{"b", Verdict::kBad, "no"}, {"c", Verdict::kOk, ""}});
    CHECK(worst(findings) == Verdict::kBad);
    CHECK(to_json(findings)["verdict"] == "bad");
    CHECK(to_json(findings)["findings"][1]["topic"] == "longer");
    CHECK(to_json(findings)["findings"][1]["verdict"] == "warn");
}

TEST_CASE("Doctor judges the GPU by what it can do", "[unit][cli]") {
    const Findings good = check_gpu(h200());
    CHECK(worst(good) == Verdict::kOk);
    CHECK(of(good, "driver") == "ok for CUDA 13.0");
    CHECK(of(good, "GPU 0") == "ok NVIDIA H200, compute capability 9.0, 132 SMs, 143000 MiB");

    CHECK(of(check_gpu(Error{"cuInit answers 100"}), "GPU") ==
          "bad none that the driver can use: cuInit answers 100");
    GpuFacts facts = h200();
    facts.cuda_version = 11080;
    CHECK(of(check_gpu(facts), "driver") == "bad for CUDA 11.8, accepted: 12.0 or newer (525 on)");
    facts = h200();
    facts.devices[0].compute_mode = 2;
    CHECK(starts(of(check_gpu(facts), "compute mode"), "bad prohibited"));
    facts.devices[0].compute_mode = 3;
    CHECK(starts(of(check_gpu(facts), "compute mode"), "warn exclusive process"));
    facts = h200();
    facts.memory_operation_problem = "cuStreamWaitValue32_v2 answers 801";
    CHECK(of(check_gpu(facts), "stream memory operations") ==
          "warn do not work: cuStreamWaitValue32_v2 answers 801");
    facts = h200();
    facts.context_problem = "cuDevicePrimaryCtxRetain answers 46";
    CHECK(starts(of(check_gpu(facts), "context"), "bad cannot be made"));
    facts = h200();
    facts.devices.push_back(facts.devices[0]);
    CHECK(of(check_gpu(facts), "GPU 1").find("not scheduled yet") != std::string::npos);
    facts.devices.clear();
    CHECK(worst(check_gpu(facts)) == Verdict::kBad);
}

TEST_CASE("Doctor warns when no priority is honoured", "[unit][cli]") {
    using enum Honoured;
    const auto verdict = [](Honoured launch, Honoured attribute, Honoured stream) {
        return worst(check_priority(h200(), measurement(launch, attribute, stream)));
    };
    CHECK(verdict(kYes, kNo, kYes) == Verdict::kOk);
    CHECK(verdict(kNo, kYes, kYes) == Verdict::kOk);
    CHECK(verdict(kNo, kRefused, kYes) == Verdict::kWarn);
    CHECK(verdict(kYes, kYes, kNo) == Verdict::kWarn);
    CHECK(of(check_priority(h200(), measurement(kRefused, kYes, kYes)), "priority of a launch") ==
          "ok refused by the driver");
    CHECK(of(check_priority(h200(), Result<PriorityMeasurement>(Error{"why"})), "priorities") ==
          "warn not measured: why");
    CHECK(starts(of(check_priority(h200(), {}), "priorities"), "ok not measured"));
    GpuFacts none = h200();
    none.greatest_priority = 0;
    CHECK(starts(of(check_priority(none, {}), "priority levels"), "warn one"));
}

TEST_CASE("Doctor tells a running MPS daemon from one that left its pipe", "[unit][cli]") {
    const Folder folder;
    const auto mps = [&] {
        return of(check_mps({{"CUDA_MPS_PIPE_DIRECTORY", folder.path("mps")}}, folder.path("proc")),
                  "MPS");
    };
    CHECK(starts(mps(), "warn CUDA_MPS_PIPE_DIRECTORY is "));
    folder.write("mps/control", "");
    CHECK(starts(mps(), "warn " + folder.path("mps/control") + " is there"));
    folder.write("mps/nvidia-cuda-mps-control.pid", "4711\n");
    CHECK(starts(mps(), "warn "));
    folder.write("proc/4711/stat", "");
    CHECK(starts(mps(), "ok a control daemon runs (process 4711"));
}

TEST_CASE("Doctor counts MIG instances", "[unit][cli]") {
    const Folder folder;
    CHECK(of(check_mig(h200(), folder.path("none")), "MIG") == "ok no instances");
    folder.write("capabilities/gpu0/mig/gi1/access", "");
    folder.write("capabilities/gpu0/mig/gi2/access", "");
    folder.write("capabilities/mig/config", "");
    CHECK(starts(of(check_mig(h200(), folder.path("capabilities")), "MIG"), "ok 2 instances"));
    GpuFacts facts = h200();
    facts.devices[0].name = "NVIDIA H200 MIG 1g.18gb";
    CHECK(starts(of(check_mig(facts, folder.path("none")), "MIG"), "ok the program runs on an"));
}

TEST_CASE("Doctor names the driver's file or says that there is none", "[unit][cli]") {
    const Folder folder;
    CHECK(worst(check_driver_file("", "")) == Verdict::kBad);
    CHECK(worst(check_driver_file(folder.path("libcuda.so.1"), "")) == Verdict::kBad);
    const std::string real = folder.write("libcuda.so.580.1", "x");
    fs::create_symlink(real, folder.path("libcuda.so.1"));
    CHECK(of(check_driver_file(folder.path("libcuda.so.1"), ""), "driver file") ==
          "ok " + folder.path("libcuda.so.1") + " (libcuda.so.580.1)");
}

TEST_CASE("Doctor names who else is loaded into programs", "[unit][cli]") {
    const Folder folder;
    const std::string ours = folder.write("urgengo/libcuda.so.1", "x");
    const std::string other = folder.write("other.so", "x");
    const std::string driver = folder.write("hami/libcuda.so.1", "x");
    const auto found = [&](const Environment& environment, const std::string& topic) {
        return of(check_preloaded(environment, ours, folder.path("ld.so.preload")), topic);
    };
    CHECK(found({}, "LD_PRELOAD") == "ok nothing else");
    CHECK(found({{"LD_PRELOAD", ours}}, "LD_PRELOAD") == "ok nothing else");
    CHECK(found({{"LD_PRELOAD", ours + ":" + other + " libfoo.so"}}, "LD_PRELOAD") ==
          "ok " + other + ", libfoo.so");
    CHECK(found({{"LD_PRELOAD", driver}}, "LD_PRELOAD") ==
          "warn " + driver + " (another libcuda: ours comes before it)");
    CHECK(found({{"LD_PRELOAD", "/nonexistent/x.so"}}, "LD_PRELOAD") ==
          "warn /nonexistent/x.so (no such file)");
    CHECK(found({}, "ld.so.preload") == "ok nothing else");
    folder.write("ld.so.preload", other + "\n");
    CHECK(found({}, "ld.so.preload") == "ok " + other);
    CHECK(found({}, "CUDA tool").empty());
    const std::string tool = found({{"CUDA_INJECTION64_PATH", "/t.so"}}, "CUDA tool");
    CHECK(starts(tool, "warn "));
    CHECK(tool.find("may hold CUPTI") != std::string::npos);
    CHECK(starts(found({{"KINETO_USE_DAEMON", "1"}}, "CUPTI"), "warn KINETO_USE_DAEMON"));
    CHECK(found({{"KINETO_USE_DAEMON", "0"}}, "CUPTI").empty());
    CHECK(found({}, "CUPTI").empty());
    CHECK(found({{"NVTX_INJECTION64_PATH", ours}}, "NVTX tool").empty());
    CHECK(starts(found({{"NVTX_INJECTION64_PATH", "/t.so"}}, "NVTX tool"), "ok "));
}

TEST_CASE("Doctor says how many connections the program gets", "[unit][cli]") {
    config::Config config;
    const auto found = [&](const Environment& environment) {
        return of(check_variables(environment, config), "connections");
    };
    CHECK(found({}) == "ok not set, and left so for so few tasks: the driver's default of 8");
    config.chains.resize(1);
    config.chains[0].tasks.resize(7);
    CHECK(found({}) == "ok not set; `urgengo run` sets 32 where it schedules");
    CHECK(starts(found({{"CUDA_DEVICE_MAX_CONNECTIONS", "32"}}), "ok "));
    CHECK(starts(found({{"CUDA_DEVICE_MAX_CONNECTIONS", "8"}}), "warn "));
    config.connections = 8;
    CHECK(starts(found({}), "warn not set; `urgengo run` sets 8"));
    config.connections = 0;
    CHECK(starts(found({}), "warn not set, and env.connections is keep"));
    const auto of_blocking = [&](const std::string& value) {
        return of(check_variables({{"CUDA_LAUNCH_BLOCKING", value}}, config),
                  "CUDA_LAUNCH_BLOCKING");
    };
    CHECK(of_blocking("0").empty());
    CHECK(starts(of_blocking("1"), "warn 1: every launch waits"));
    CHECK(starts(of(check_variables({{"URGENGO_MODE", "x"}}, config), "variables"),
                 "bad URGENGO_MODE: found 'x'"));
    CHECK(starts(of(check_variables({{"URGENGO_MOD", "off"}}, config), "variables"),
                 "warn URGENGO_MOD: nothing reads"));
}

TEST_CASE("Doctor says who opens gates, or why launches wait in their threads", "[unit][cli]") {
    config::Config config;
    const auto found = [&](const Environment& environment = {}) {
        return of(check_variables(environment, config), "dispatch");
    };
    CHECK(found().empty());
    config.scheduler.dispatch.where = config::Dispatch::kDevice;
    CHECK(found() == "ok launches that have to wait go behind gates that the GPU (armed) opens");
    config.scheduler.dispatch.device = config::DeviceDispatch::kArmed;
    CHECK(found() == "ok launches that have to wait go behind gates that the GPU (armed) opens");
    CHECK(starts(found({{"CUDA_LAUNCH_BLOCKING", "1"}}),
                 "warn device is asked for, but CUDA_LAUNCH_BLOCKING is set"));
    CHECK(found({{"CUDA_INJECTION64_PATH", "/opt/cuda/libsanitizer-collection.so"}}) ==
          "warn device is asked for, but compute-sanitizer is there, which may run kernels one at "
          "a time: launches wait in their threads");
    CHECK(starts(found({{"LD_PRELOAD", "a.so:/opt/ncu/libcuda-injection.so"}}),
                 "warn device is asked for, but Nsight Compute is there"));
    CHECK(starts(of(check_variables({}, config, {{}, "cuda-gdb-minima"}), "dispatch"),
                 "warn device is asked for, but cuda-gdb is there"));
    CHECK(starts(found({{"CUDA_INJECTION64_PATH", "/opt/nsys/libToolsInjection64.so"}}), "ok "));
    config.scheduler.dispatch.where = config::Dispatch::kAuto;
    config.chains.resize(1);
    config.chains[0].tasks.resize(7);
    CHECK(found().ends_with("while the host's cores are busy; else threads"));
    CHECK(starts(found({{"CUDA_DEVICE_MAX_CONNECTIONS", "8"}}),
                 "warn auto is asked for, but auto needs a connection for each task and two more"));
    config.scheduler.dispatch.where = config::Dispatch::kHost;
    config.scheduler.admission = config::Admission::kExclusive;
    CHECK(starts(found(), "warn host is asked for, but gates are for admission: packed"));
}

TEST_CASE("Doctor explains what each choice of the config comes to", "[unit][cli]") {
    config::Config config;
    const PriorityChoice pool{config::PriorityVia::kStreamPool, "because"};
    CHECK(of(explain_choices(config, pool, nullptr), "priority_via") ==
          "ok auto: stream_pool, because");
    CHECK(of(explain_choices(config, {}, nullptr), "priority_via") ==
          "ok auto: launch_attribute, without a measurement");
    config.scheduler.priority.via = config::PriorityVia::kStreamAttribute;
    CHECK(of(explain_choices(config, pool, nullptr), "hold") ==
          "ok for 2 times each chain's own deadline at most");
    config.scheduler.hold.max_per_instance = std::chrono::microseconds(2500);
    config.blocking_sync = true;
    CHECK(of(explain_choices(config, pool, nullptr), "priority_via") == "ok stream_attribute");
    CHECK(of(explain_choices(config, pool, nullptr), "hold") ==
          "ok for 2.5 ms of an instance at most");
    CHECK(starts(of(explain_choices(config, pool, nullptr), "blocking_sync"), "ok on"));
    config.scheduler = {};
    config.scheduler.binding = config::Binding::kNone;
    CHECK(starts(of(explain_choices(config, pool, nullptr), "priority_via"), "ok auto; nothing"));

    CHECK(of(check_config("c.yaml", Error{"c.yaml:3: wrong"}), "config") == "bad c.yaml:3: wrong");
    config.mode = config::Mode::kOff;
    CHECK(starts(of(check_config("c.yaml", config), "config"), "warn c.yaml: 0 chains"));
}

TEST_CASE("Doctor says what tells how far the GPU is", "[unit][cli]") {
    config::Config config;
    const auto tracking = [&] { return of(explain_choices(config, {}, nullptr), "tracking"); };
    CHECK(tracking() == "ok progress: marks tell how far the GPU is");
    config.scheduler.progress.tracking = config::Tracking::kBatched;
    CHECK(tracking() == "warn batched: the thread waits every 500 us of GPU time; for comparisons");
    config.scheduler.progress.tracking = config::Tracking::kProgress;
    GpuFacts gpu;
    const auto found = [&] { return of(explain_choices(config, {}, &gpu), "progress.source"); };
    CHECK(found() == "ok auto: kernel");
    gpu.devices = {{"H200", 9, 0, 132, 1, 0}};
    CHECK(found() ==
          "ok auto: kernel, launched with programmatic serialisation (compute capability 9.0)");
    gpu.devices[0].compute_major = 8;
    CHECK(found() == "ok auto: kernel, launched plainly (compute capability 8.0)");
    config.scheduler.progress.source = config::ProgressSource::kEvent;
    CHECK(found() == "ok event");
    config.scheduler.progress.source = config::ProgressSource::kMemop;
    CHECK(found() == "ok memop");
    gpu.memory_operation_problem = "cuStreamWriteValue32 answers 801";
    CHECK(found() == "warn memop: cuStreamWriteValue32 answers 801; kernel is used");
}

TEST_CASE("Doctor holds the profile against the GPU and the program", "[unit][cli]") {
    const Folder folder;
    const std::string yaml = folder.path("c.yaml");
    const config::RunTarget target{"NVIDIA H200", "13.0", 0, 0, "stack"};
    const auto found = [&] { return of(check_profile(yaml, {}, target), "profile"); };
    CHECK(starts(found(), "warn " + folder.path("c.profile.json") + " is not there"));
    folder.write("c.profile.json", R"({"format_version":2,"gpu":"NVIDIA H200","driver":"13.0",)"
                                   R"("chains":[]})");
    CHECK(found() == "ok " + folder.path("c.profile.json"));
    folder.write("c.profile.json", R"({"format_version":2,"gpu":"GTX","driver":"","chains":[]})");
    CHECK(starts(found(), "bad " + folder.path("c.profile.json") + ": gpu: found 'GTX'"));
    folder.write("c.profile.json", "{}");
    CHECK(starts(found(), "bad "));
}

TEST_CASE("Doctor warns of launch-bound tasks that share an interpreter", "[unit][cli]") {
    const auto chain_of = [](const std::string& name, nanoseconds launching, nanoseconds gpu) {
        config::TaskProfile task;
        task.kernels.resize(1);
        task.kernels[0].gpu_time = gpu;
        task.kernels[0].launch_time = launching;
        task.segments.resize(1);
        task.segments[0].num_launches = 1;
        task.segments[0].latency = launching + gpu;
        return config::ChainProfile{name, {task}};
    };
    config::Profile profile;
    profile.program = "python3.11";
    profile.chains = {chain_of("a", 3ms, 1ms), chain_of("b", 1ms, 3ms)};
    CHECK(check_launching(profile).empty());  // one alone shares it with no other
    profile.chains.push_back(chain_of("c", 5ms, 1ms));
    const std::string warning = of(check_launching(profile), "launching");
    CHECK(starts(warning, "warn 2 of 3 tasks take longer to launch than to execute"));
    profile.program = "stack";
    CHECK(check_launching(profile).empty());
}

TEST_CASE("Doctor says whether a program's calls would be seen", "[unit][cli]") {
    const Folder folder;
    const Environment environment{{"PATH", "/usr/bin:/bin"}};
    CHECK(check_program_file({}, environment).findings.empty());
    const ProgramFindings shell = check_program_file({"sh", "-c", "x"}, environment);
    CHECK(shell.name == "sh");
    CHECK(starts(of(shell.findings, "program"), "ok /"));
    CHECK(starts(of(check_program_file({"/nonexistent"}, environment).findings, "program"),
                 "bad /nonexistent: no such file"));
    const std::string text = folder.write("script", "#!/nonexistent/python\n");
    REQUIRE(chmod(text.c_str(), 0755) == 0);
    CHECK(starts(of(check_program_file({text}, environment).findings, "program"), "bad "));
    CHECK(of(check_library(Error{"not there"}), "UrgenGo's library") == "bad not there");
    CHECK(starts(of(check_library(std::string("/a b/libcuda.so.1")), "UrgenGo's library"), "bad "));
}

TEST_CASE("Doctor reads capabilities and never fails over rights", "[unit][cli]") {
    const std::string status = "Name:\tx\nCapEff:\t0000000000800000\n";
    CHECK(has_capability(status, 23));
    CHECK_FALSE(has_capability(status, 22));
    CHECK_FALSE(has_capability("Name:\tx\n", 23));
    const Findings findings = check_rights();
    CHECK(worst(findings) != Verdict::kBad);
    CHECK(of(findings, "real-time rights").find("RLIMIT_RTPRIO") != std::string::npos);
    CHECK_FALSE(of(findings, "timer slack").empty());
    // Either way, a config that asks for it is told whether it gets it.
    const std::string nice = of(check_rights(-7), "nice values");
    INFO(nice);
    CHECK((nice == "ok cpu: {nice: -7} is allowed" ||
           nice.find("warn cpu: nice -7 is refused") == 0));
    CHECK(starts(of(findings, "nice values"), "ok -15 is "));
}

}  // namespace
}  // namespace urgengo::cli
