// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/doctor/doctor_rights.h"

#include <fmt/format.h>
#include <linux/capability.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <system_error>

namespace urgengo::cli {
namespace {

constexpr int kDefaultSlack_ns = 50'000;

/// @returns the error of becoming real-time; 0: it was possible
int try_real_time() {
    const pid_t child = fork();
    if (child < 0) return errno;
    if (child == 0) {
        sched_param parameters{};
        parameters.sched_priority = sched_get_priority_min(SCHED_FIFO);
        const bool done = sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters) == 0;
        _exit(done ? 0 : errno);
    }
    int status = 0;
    if (waitpid(child, &status, 0) != child || !WIFEXITED(status)) return ECHILD;
    return WEXITSTATUS(status);
}

std::string real_time_limit() {
    rlimit limit{};
    if (getrlimit(RLIMIT_RTPRIO, &limit) != 0) return "unknown";
    return limit.rlim_cur == RLIM_INFINITY ? "unlimited" : std::to_string(limit.rlim_cur);
}

std::string own_status() {
    std::ifstream file("/proc/self/status");
    return {std::istreambuf_iterator<char>(file), {}};
}

Finding real_time() {
    const int error = try_real_time();
    const std::string rights = fmt::format("RLIMIT_RTPRIO {}, {}CAP_SYS_NICE", real_time_limit(),
                                           has_capability(own_status(), CAP_SYS_NICE) ? "" : "no ");
    if (error == 0)
        return {"real-time rights", Verdict::kOk, "SCHED_FIFO allowed (" + rights + ")"};
    // Nothing that this version does asks for it.
    return {"real-time rights", Verdict::kOk,
            fmt::format("SCHED_FIFO: {} ({}); UrgenGo does without",
                        std::generic_category().message(error), rights)};
}

Finding timer_slack() {
    const int slack_ns = prctl(PR_GET_TIMERSLACK);
    if (slack_ns < 0) return {"timer slack", Verdict::kWarn, "cannot be read"};
    const bool is_long = slack_ns > kDefaultSlack_ns;
    return {"timer slack", is_long ? Verdict::kWarn : Verdict::kOk,
            fmt::format("{} us{}", slack_ns / 1000.0,
                        is_long ? ": the program's own sleeps end late; holds set theirs"
                                : " (holds set their own)")};
}

}  // namespace

bool has_capability(const std::string& status, unsigned capability) {
    constexpr std::string_view kLine = "\nCapEff:";
    const std::size_t at = status.find(kLine);
    if (at == std::string::npos) return false;
    const std::uint64_t set = std::strtoull(status.c_str() + at + kLine.size(), nullptr, 16);
    return (set >> capability & 1) != 0;
}

Findings check_rights() {
    return {real_time(), timer_slack()};
}

}  // namespace urgengo::cli
