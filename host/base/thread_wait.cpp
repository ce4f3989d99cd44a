// SPDX-License-Identifier: Apache-2.0
#include "host/base/thread_wait.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>
#include <system_error>

#include "host/base/file_descriptor.h"
#include "host/base/uncancelled.h"

namespace urgengo {
namespace {

using For = ThreadWait::For;

constexpr std::string_view kRuns = "running";  // on a core, or waits for one
constexpr std::string_view kArgument = " 0x";

/// A system call and its first two arguments.
struct Call {
    long number = -1;
    std::uint64_t first = 0, second = 0;
};

/// @param line  "202 0x7f4e10 0x80 0x2 ..."
std::optional<Call> parse(std::string_view line) {
    Call call;
    const char *at = line.data(), *const end = at + line.size();
    const auto read = [&](auto& number, int base) {
        const auto [rest, error] = std::from_chars(at, end, number, base);
        at = rest;
        return error == std::errc{};
    };
    const auto skip = [&] {
        if (!std::string_view(at, static_cast<std::size_t>(end - at)).starts_with(kArgument))
            return false;
        at += kArgument.size();
        return true;
    };
    if (!read(call.number, 10) || !skip() || !read(call.first, 16) || !skip() ||
        !read(call.second, 16))
        return std::nullopt;
    return call;
}

/// The beginning of a pthread_mutex_t of glibc, 64 bits.
struct Mutex {
    static constexpr std::uint32_t kContended = 2;
    /// Normal, recursive, error-checking, adaptive; whether it is elided aside. Of
    /// priority-inheriting ones the word is the owner; of robust ones nothing is told.
    static constexpr std::uint32_t kMostPlainKind = 3, kKindBits = 0xff;

    std::uint32_t word;
    std::uint32_t count;
    pid_t owner;
    std::uint32_t users;
    std::uint32_t kind;

    bool is_plain() const {
        return word == kContended && users != 0 && (kind & kKindBits) <= kMostPlainKind;
    }
};

/// @returns 0 if it is no such mutex, or is there no more
pid_t owner_of(std::uint64_t address, bool inherits) {
    // It may be unmapped at any time: so it is not read as one's own memory.
    const FileDescriptor memory(open("/proc/self/mem", O_RDONLY | O_CLOEXEC));
    Mutex mutex{};
    if (memory.get() < 0 || pread(memory.get(), &mutex, sizeof mutex,
                                  static_cast<off_t>(address)) != ssize_t{sizeof mutex})
        return 0;
    if (inherits) return static_cast<pid_t>(mutex.word & FUTEX_TID_MASK);
    return mutex.is_plain() ? mutex.owner : 0;
}

ThreadWait wait_in(const Call& call) {
    if (call.number == SYS_nanosleep || call.number == SYS_clock_nanosleep) return {For::kNothing};
    // What processes share may have an owner in another one.
    if (call.number != SYS_futex || (call.second & FUTEX_PRIVATE_FLAG) == 0) return {};
    const auto operation = static_cast<int>(call.second) & FUTEX_CMD_MASK;
    const bool inherits = operation == FUTEX_LOCK_PI;
    if (operation != FUTEX_WAIT && !inherits) return {};
    const pid_t owner = owner_of(call.first, inherits);
    return owner > 0 ? ThreadWait{For::kMutex, owner} : ThreadWait{};
}

}  // namespace

ThreadWait what_waits_for(pid_t thread) {
    const Uncancelled uncancelled;
    const int saved_errno = errno;
    std::array<char, 48> path{};
    fmt::format_to_n(path.data(), path.size() - 1, "/proc/self/task/{}/syscall", thread);
    std::array<char, 80> text{};
    ssize_t size = -1;
    if (const FileDescriptor file(open(path.data(), O_RDONLY | O_CLOEXEC)); file.get() >= 0)
        size = read(file.get(), text.data(), text.size());
    ThreadWait wait;
    if (size > 0) {
        const std::string_view line(text.data(), static_cast<std::size_t>(size));
        if (line.starts_with(kRuns))
            wait.what = For::kNothing;
        else if (const auto call = parse(line))
            wait = wait_in(*call);
    }
    errno = saved_errno;
    return wait;
}

}  // namespace urgengo
