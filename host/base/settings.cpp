// SPDX-License-Identifier: Apache-2.0
#include "host/base/settings.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <string_view>

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
const char kShare[] = "URGENGO_SHARE";
const char kShareGroup[] = "URGENGO_SHARE_GROUP";
const char kLog[] = "URGENGO_LOG";
const char kLogFile[] = "URGENGO_LOG_FILE";
const char kNvtx[] = "URGENGO_NVTX";
const char kNvtxTool[] = "URGENGO_NVTX_TOOL";
const char kNewNames[] = "URGENGO_NEW_NAMES";
const char kRunTrace[] = "URGENGO_RUN_TRACE";
const char kFlightRecords[] = "URGENGO_FLIGHT_RECORDS";
const char kTestHolds[] = "URGENGO_TEST_HOLDS";

const SettingInfo kTable[] = {
    {kConfig, "the config: a resolved JSON file, or a .yaml with an up-to-date resolved sibling"},
    {kMode, "off, observe, shadow or enforce: overrides the config's mode"},
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
    {kShare,
     "folder in which this process is found by `urgengo ctl` and `top`, instead of /dev/shm; 0: it "
     "is not found"},
    {kShareGroup,
     "a group, by name or number, that may look at this process and steer it, besides its owner"},
    {kLog,
     "info, debug or off: write what UrgenGo does, and at debug why each late frame was late, to a "
     "file"},
    {kLogFile,
     "that file, instead of urgengo-<program>-<process id>.log in the working directory; %p in it "
     "stands for the process id"},
    {kNvtx, "auto, on or off: overrides the config's nvtx"},
    {kNvtxTool,
     "an NVTX injection library that gets the program's NVTX calls as if it were named in "
     "NVTX_INJECTION64_PATH, where UrgenGo is named"},
    {kNewNames,
     "1 or 0: names that the driver has and UrgenGo does not know are found through UrgenGo [0]"},
    {kRunTrace,
     "write what happens in the run, holds and late frames above all, to this file, for `urgengo "
     "trace`; %p in it stands for the process id"},
    {kFlightRecords,
     "how many events of each thread the flight recorder keeps for `urgengo ctl dump` [4096]; 0: "
     "there is none"},
    {kTestHolds, "for tests: a number, the seed of holds at random on top of what is decided"},
    {nullptr, nullptr},
};

std::string get(const char* name) {
    const char* value = std::getenv(name);
    return value ? value : "";
}

std::uint64_t get_number(const char* name, std::string& wrong, std::uint64_t unless = 0) {
    const std::string value = get(name);
    std::uint64_t number = 0;
    if (value.empty()) return unless;
    const char* last = value.data() + value.size();
    const auto [end, error] = std::from_chars(value.data(), last, number);
    if (error == std::errc{} && end == last) return number;
    if (wrong.empty()) wrong = std::string(name) + ": found '" + value + "', accepted: a number";
    return unless;
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

LogDetail get_log(std::string& wrong) {
    const std::string value = get(kLog);
    if (value == "info") return LogDetail::kInfo;
    if (value == "debug") return LogDetail::kDebug;
    if (!value.empty() && value != "off" && value != "0" && wrong.empty())
        wrong = std::string(kLog) + ": found '" + value + "', accepted: off, info, debug";
    return LogDetail::kOff;
}

std::string get_log_file() {
    const std::string file = get_file(kLogFile);
    if (!file.empty()) return file;
    return std::string("urgengo-") + program_invocation_short_name + "-" +
           std::to_string(getpid()) + ".log";
}

std::string get_share() {
    const char* const value = std::getenv(kShare);
    if (!value || !*value) return "/dev/shm";
    return std::string_view(value) == "0" ? "" : value;
}

/// A value that is not accepted is noted, and counts as none.
std::string get_nvtx(std::string& wrong) {
    const std::string value = get(kNvtx);
    if (value.empty() || value == "auto" || value == "on" || value == "off") return value;
    if (wrong.empty())
        wrong = std::string(kNvtx) + ": found '" + value + "', accepted: auto, on, off";
    return {};
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
    s.share.folder = get_share();
    s.share.group = get(kShareGroup);
    s.share.is_asked_for =
        !s.share.folder.empty() && (!get(kShare).empty() || !s.share.group.empty());
    s.log.detail = get_log(s.wrong);
    s.log.file = get_log_file();
    s.nvtx.events = get_nvtx(s.wrong);
    s.nvtx.tool = get(kNvtxTool);
    s.new_names = get_flag(kNewNames, s.wrong);
    s.records.trace = get_file(kRunTrace);
    constexpr std::uint64_t kMost = 1u << 22;
    s.records.flight = static_cast<std::uint32_t>(
        std::min(kMost, get_number(kFlightRecords, s.wrong, s.records.flight)));
    s.test_holds = get_number(kTestHolds, s.wrong);
    return s;
}

}  // namespace urgengo
