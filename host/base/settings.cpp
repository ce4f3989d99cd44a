// SPDX-License-Identifier: Apache-2.0
#include "host/base/settings.h"

#include <unistd.h>

#include <charconv>
#include <cstdlib>

namespace urgengo {
namespace {

const char kConfig[] = "URGENGO_CONFIG";
const char kMode[] = "URGENGO_MODE";
const char kRealLibcuda[] = "URGENGO_REAL_LIBCUDA";
const char kStats[] = "URGENGO_STATS";
const char kSummary[] = "URGENGO_SUMMARY";
const char kTrace[] = "URGENGO_TRACE";
const char kTraceKernels[] = "URGENGO_TRACE_KERNELS";
const char kCupti[] = "URGENGO_CUPTI";
const char kTestHolds[] = "URGENGO_TEST_HOLDS";

const SettingInfo kTable[] = {
    {kConfig, "the config: a resolved JSON file, or a .yaml with an up-to-date resolved sibling"},
    {kMode, "off, observe or enforce: overrides the config's mode"},
    {kRealLibcuda,
     "absolute path of the real libcuda.so.1, instead of searching as the loader does"},
    {kStats,
     "write the statistics of every chain to this JSON file when the program exits; %p in it "
     "stands "
     "for the process id"},
    {kSummary, "1 or 0: print each chain's misses on stderr when the program exits"},
    {kTrace,
     "write what the program does on the GPU to this file, for `urgengo profile` and others; %p in "
     "it stands for the process id"},
    {kTraceKernels,
     "marks (or 1), cupti, auto or 0: how every kernel in the trace is timed: by marks of its own, "
     "by CUPTI, by whichever can be"},
    {kCupti, "a libcupti.so, where the program has none of its own"},
    {kTestHolds, "for tests: a number, the seed of holds at random on top of what is decided"},
    {nullptr, nullptr},
};

std::string get(const char* name) {
    const char* value = std::getenv(name);
    return value ? value : "";
}

std::uint64_t get_number(const char* name, std::string& wrong) {
    const std::string value = get(name);
    std::uint64_t number = 0;
    const char* last = value.data() + value.size();
    const auto [end, error] = std::from_chars(value.data(), last, number);
    if (value.empty() || (error == std::errc{} && end == last)) return number;
    if (wrong.empty()) wrong = std::string(name) + ": found '" + value + "', accepted: a number";
    return 0;
}

/// A file of this process: several of one stack inherit the variable, and each writes its own.
std::string get_file(const char* name) {
    std::string path = get(name);
    const std::string pid = std::to_string(getpid());
    for (std::size_t at = 0; (at = path.find("%p", at)) != std::string::npos; at += pid.size()) {
        path.replace(at, 2, pid);
    }
    return path;
}

KernelTimes get_kernel_times(std::string& wrong) {
    const std::string value = get(kTraceKernels);
    if (value == "1" || value == "marks") return KernelTimes::kMarks;
    if (value == "cupti") return KernelTimes::kCupti;
    if (value == "auto") return KernelTimes::kAuto;
    if (!value.empty() && value != "0" && wrong.empty()) {
        wrong =
            std::string(kTraceKernels) + ": found '" + value + "', accepted: 0, marks, cupti, auto";
    }
    return KernelTimes::kNone;
}

/// A value that is not accepted is noted, and counts as 0.
bool get_flag(const char* name, std::string& wrong) {
    const std::string value = get(name);
    if (!value.empty() && value != "0" && value != "1" && wrong.empty()) {
        wrong = std::string(name) + ": found '" + value + "', accepted: 0, 1";
    }
    return value == "1";
}

}  // namespace

const SettingInfo* setting_table() {
    return kTable;
}

Settings read_settings() {
    Settings s;
    s.config = get(kConfig);
    s.mode = get(kMode);
    s.real_libcuda = get(kRealLibcuda);
    s.stats = get_file(kStats);
    s.summary = get_flag(kSummary, s.wrong);
    s.trace = get_file(kTrace);
    s.trace_kernels = get_kernel_times(s.wrong);
    s.cupti = get(kCupti);
    s.test_holds = get_number(kTestHolds, s.wrong);
    return s;
}

}  // namespace urgengo
