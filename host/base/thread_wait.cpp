// SPDX-License-Identifier: Apache-2.0
#include "host/base/thread_wait.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <string_view>

#include "host/base/file_descriptor.h"

namespace urgengo {
namespace {

constexpr std::string_view kRuns = "running";  // on a core, or waits for one

bool sleeps_until_a_time(std::string_view line) {
    long call = -1;
    std::from_chars(line.data(), line.data() + line.size(), call);
    return call == SYS_nanosleep || call == SYS_clock_nanosleep;
}

}  // namespace

// The system call in which it waits, and its arguments: proc_pid_syscall(5).
bool goes_on_by_itself(pid_t thread) {
    const int saved_errno = errno;
    std::array<char, 48> path{};
    fmt::format_to_n(path.data(), path.size() - 1, "/proc/self/task/{}/syscall", thread);
    std::array<char, 32> text{};
    ssize_t size = -1;
    if (const FileDescriptor file(open(path.data(), O_RDONLY | O_CLOEXEC)); file.get() >= 0)
        size = read(file.get(), text.data(), text.size());
    errno = saved_errno;
    if (size <= 0) return false;
    const std::string_view line(text.data(), static_cast<std::size_t>(size));
    return line.starts_with(kRuns) || sleeps_until_a_time(line);
}

}  // namespace urgengo
