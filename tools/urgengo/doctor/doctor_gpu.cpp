// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/doctor/doctor_gpu.h"

#include <cuda.h>
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "interposer/driver_file.h"
#include "tools/urgengo/program/program_setup.h"
#include "tools/urgengo/program/pruned_library.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

constexpr int kOldestCuda = 12000;  // driver 525

std::string version_text(int version) {
    return fmt::format("{}.{}", version / 1000, version % 1000 / 10);
}

Finding compute_mode(const GpuDevice& device) {
    const auto found = [](Verdict verdict, const std::string& text) {
        return Finding{"compute mode", verdict, text};
    };
    switch (device.compute_mode) {
        case CU_COMPUTEMODE_DEFAULT:
            return found(Verdict::kOk, "default: several processes may use the GPU");
        case CU_COMPUTEMODE_PROHIBITED:
            return found(Verdict::kBad, "prohibited: no process may use the GPU (nvidia-smi -c 0)");
        case CU_COMPUTEMODE_EXCLUSIVE_PROCESS:
            return found(
                Verdict::kWarn,
                "exclusive process: a second process finds the GPU taken, unless MPS runs");
        default:
            return found(Verdict::kWarn,
                         fmt::format("{}: not known to this version", device.compute_mode));
    }
}

Finding way(const char* topic, const PriorityWay& way, Verdict otherwise) {
    return {topic, way.honoured == Honoured::kYes ? Verdict::kOk : otherwise, describe(way)};
}

}  // namespace

Findings check_driver_file(const std::string& driver, const std::string& interposer) {
    if (driver.empty()) {
        return {{"driver file", Verdict::kBad,
                 "no libcuda.so.1 in LD_LIBRARY_PATH, the loader's cache and the default folders"}};
    }
    std::error_code error;
    const fs::path real = fs::canonical(driver, error);
    if (error) return {{"driver file", Verdict::kBad, driver + ": " + error.message()}};
    const bool is_link = real.filename() != fs::path(driver).filename();
    Findings findings{{"driver file", Verdict::kOk,
                       driver + (is_link ? " (" + real.filename().string() + ")" : "")}};
    const std::size_t missing = count_missing_names(interposer, driver);
    if (missing > 0) {
        findings.push_back(
            {"driver functions", Verdict::kOk,
             fmt::format(
                 "{} that this version knows are not in this driver; `urgengo run` preloads "
                 "a copy of the library without them",
                 missing)});
    }
    return findings;
}

Findings check_nvtx_tools(const std::string& driver, const std::string& interposer,
                          const Environment& environment) {
    constexpr char kName[] = "cuNvtxGetInjectionInitializer";
    if (driver.empty() || interposer.empty() || value_of(environment, "URGENGO_NEW_NAMES") == "1" ||
        !lacks_name_of(interposer, driver, kName))
        return {};
    return {{"NVTX tools", Verdict::kWarn,
             fmt::format("the driver has {}, which UrgenGo does not know: tools that NVTX finds by "
                         "it get no data, unless URGENGO_NEW_NAMES=1",
                         kName)}};
}

Findings check_gpu(const Result<GpuFacts>& facts) {
    if (!facts) return {{"GPU", Verdict::kBad, "none that the driver can use: " + facts.error()}};
    Findings findings;
    const bool too_old = facts->cuda_version < kOldestCuda;
    findings.push_back({"driver", too_old ? Verdict::kBad : Verdict::kOk,
                        "for CUDA " + version_text(facts->cuda_version) +
                            (too_old ? ", accepted: 12.0 or newer (525 on)" : "")});
    for (std::size_t i = 0; i < facts->devices.size(); ++i) {
        const GpuDevice& device = facts->devices[i];
        findings.push_back(
            {fmt::format("GPU {}", i), Verdict::kOk,
             fmt::format("{}, compute capability {}.{}, {} SMs, {} MiB{}", device.name,
                         device.compute_major, device.compute_minor, device.num_sms,
                         device.memory_mib,
                         i == 0 ? "" : "; not scheduled yet, its work passes through untouched")});
    }
    if (facts->devices.empty()) {
        findings.push_back({"GPU", Verdict::kBad, "the driver knows of none"});
        return findings;
    }
    findings.push_back(compute_mode(facts->devices[0]));
    if (!facts->context_problem.empty()) {
        findings.push_back({"context", Verdict::kBad, "cannot be made: " + facts->context_problem});
        return findings;
    }
    const std::string& problem = facts->memory_operation_problem;
    findings.push_back({"stream memory operations", problem.empty() ? Verdict::kOk : Verdict::kWarn,
                        problem.empty() ? "work (a stream wrote a value and waited for it)"
                                        : "do not work: " + problem});
    return findings;
}

Findings check_priority(const GpuFacts& facts,
                        const std::optional<Result<PriorityMeasurement>>& measured) {
    const int levels = facts.least_priority - facts.greatest_priority + 1;
    Findings findings{
        {"priority levels", levels > 1 ? Verdict::kOk : Verdict::kWarn,
         levels > 1 ? fmt::format("{}: from {} (least) to {} (greatest)", levels,
                                  facts.least_priority, facts.greatest_priority)
                    : "one: priorities do nothing on this GPU; launches are held, and no more"}};
    if (levels <= 1) return findings;
    if (!measured) {
        findings.push_back({"priorities", Verdict::kOk, "not measured: --no-probe"});
        return findings;
    }
    if (!*measured) {
        findings.push_back({"priorities", Verdict::kWarn, "not measured: " + measured->error()});
        return findings;
    }
    const PriorityMeasurement& m = **measured;
    // One of the first two is enough; without priority on streams there is none at all.
    const bool any = m.launch_attribute.honoured == Honoured::kYes ||
                     m.stream_attribute.honoured == Honoured::kYes;
    const Verdict otherwise = any ? Verdict::kOk : Verdict::kWarn;
    findings.push_back(way("priority of a launch", m.launch_attribute, otherwise));
    findings.push_back(way("priority set on a stream", m.stream_attribute, otherwise));
    findings.push_back(way("stream made with priority", m.stream, Verdict::kWarn));
    return findings;
}

Findings check_mps(const Environment& environment, const std::string& processes) {
    const std::string asked = value_of(environment, "CUDA_MPS_PIPE_DIRECTORY");
    const std::string folder = asked.empty() ? "/tmp/nvidia-mps" : asked;
    std::error_code ignored;
    const bool has_pipe = fs::exists(folder + "/control", ignored);
    std::ifstream file(folder + "/nvidia-cuda-mps-control.pid");
    int pid = 0;
    const bool runs =
        file >> pid && pid > 0 && fs::exists(processes + "/" + std::to_string(pid), ignored);
    const auto found = [&](Verdict verdict, const std::string& text) {
        return Findings{{"MPS", verdict, text}};
    };
    if (runs) {
        return found(Verdict::kOk,
                     fmt::format("a control daemon runs (process {}, {}): programs share the GPU, "
                                 "and priorities hold across them",
                                 pid, folder));
    }
    if (has_pipe) {
        return found(Verdict::kWarn, folder +
                                         "/control is there, but no daemon that can be seen "
                                         "from here: programs may hang or find no GPU");
    }
    if (!asked.empty()) {
        return found(Verdict::kWarn, "CUDA_MPS_PIPE_DIRECTORY is " + asked +
                                         ", where no control daemon runs: programs do without");
    }
    return found(Verdict::kOk,
                 "no control daemon: several processes take turns on the GPU, and priorities hold "
                 "within each only");
}

Findings check_mig(const GpuFacts& facts, const std::string& capabilities) {
    const bool on_instance =
        !facts.devices.empty() && facts.devices[0].name.find(" MIG ") != std::string::npos;
    if (on_instance) {
        return {{"MIG", Verdict::kOk, "the program runs on an instance: " + facts.devices[0].name}};
    }
    std::error_code error;
    std::size_t instances = 0;
    for (fs::directory_iterator gpu(capabilities, error), end; !error && gpu != end;
         gpu.increment(error)) {
        std::error_code ignored;
        for (fs::directory_iterator entry(gpu->path() / "mig", ignored); !ignored && entry != end;
             entry.increment(ignored)) {
            if (entry->path().filename().string().starts_with("gi")) ++instances;
        }
    }
    if (instances == 0) return {{"MIG", Verdict::kOk, "no instances"}};
    return {
        {"MIG", Verdict::kOk,
         fmt::format("{} instances on this machine; the program runs on none of them", instances)}};
}

}  // namespace urgengo::cli
