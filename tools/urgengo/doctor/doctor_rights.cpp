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
constexpr int kUsefulNice = -15;

/// @param act  in a child; returns whether it was possible, and else errno
/// @returns the error; 0: it was possible
template <typename Act>
int try_in_child(Act&& act) {
    const pid_t child = fork();
    if (child < 0) return errno;
    if (child == 0) _exit(act() ? 0 : errno);
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
    const int error = try_in_child([] {
        sched_param parameters{};
        parameters.sched_priority = sched_get_priority_min(SCHED_FIFO);
        return sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters) == 0;
    });
    const std::string rights = fmt::format("RLIMIT_RTPRIO {}, {}CAP_SYS_NICE", real_time_limit(),
                                           has_capability(own_status(), CAP_SYS_NICE) ? "" : "no ");
    if (error == 0)
        return {"real-time rights", Verdict::kOk, "SCHED_FIFO allowed (" + rights + ")"};
    // Nothing that this version does asks for it.
    return {"real-time rights", Verdict::kOk,
            fmt::format("SCHED_FIFO: {} ({}); UrgenGo does without",
                        std::generic_category().message(error), rights)};
}

Finding nice_value(std::optional<int> asked) {
    const int value = asked.value_or(kUsefulNice);
    const int error = try_in_child([&] { return setpriority(PRIO_PROCESS, 0, value) == 0; });
    if (error == 0)
        return {"nice values", Verdict::kOk,
                asked ? fmt::format("cpu: {{nice: {}}} is allowed", value)
                      : fmt::format("{} is allowed: where other programs keep the cores busy, cpu: "
                                    "{{nice: {}}} lets threads of chains go first",
                                    value, value)};
    return {"nice values", asked ? Verdict::kWarn : Verdict::kOk,
            fmt::format("{}{} is refused ({}): CAP_SYS_NICE or a limit of nice (ulimit -e {}) "
                        "allows it",
                        asked ? "cpu: nice " : "", value, std::generic_category().message(error),
                        20 - value)};
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

Findings check_rights(std::optional<int> nice) {
    return {real_time(), nice_value(nice), timer_slack()};
}

}  // namespace urgengo::cli
