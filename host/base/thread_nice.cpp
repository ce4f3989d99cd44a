// SPDX-License-Identifier: Apache-2.0
#include "host/base/thread_nice.h"

#include <fmt/format.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "host/base/log.h"

namespace urgengo {
namespace {

/// As the kernel has it (sched_setattr(2)), its first version; C libraries lack it, or call it so.
struct Attributes {
    std::uint32_t size = sizeof(Attributes);
    std::uint32_t policy = SCHED_OTHER;
    std::uint64_t flags = 0;
    std::int32_t nice = 0;
    std::uint32_t priority = 0;
    std::uint64_t runtime = 0, deadline = 0, period = 0;
};
static_assert(sizeof(Attributes) == 48);
constexpr std::uint64_t kResetOnFork = 1;

bool set(pid_t thread, int nice, std::uint64_t flags) {
    Attributes attributes;
    attributes.flags = flags;
    attributes.nice = nice;
    return syscall(SYS_sched_setattr, thread, &attributes, 0) == 0;
}

std::optional<Attributes> attributes_of(pid_t thread) {
    Attributes attributes;
    if (syscall(SYS_sched_getattr, thread, &attributes, sizeof attributes, 0) != 0)
        return std::nullopt;
    return attributes;
}

}  // namespace

void ThreadNice::take_now(Seen& seen) {
    const int saved_errno = errno;
    const auto thread = static_cast<pid_t>(syscall(SYS_gettid));
    const std::lock_guard lock(mutex_);
    seen = round_.load();
    const std::optional<Attributes> own = attributes_of(thread);
    const bool is_for_it =
        own && own->policy == SCHED_OTHER && own->flags == 0 && own->nice > wanted_;
    if (is_for_it && set(thread, wanted_, kResetOnFork)) {
        holders_.push_back({thread, own->nice});
    } else if (is_for_it && is_on_.exchange(false)) {
        log_line(
            fmt::format("cpu: {{nice: {}}} is refused ({}): allow it by CAP_SYS_NICE, or by a "
                        "limit of nice (ulimit -e {})",
                        wanted_, std::strerror(errno), 20 - wanted_));
    }
    errno = saved_errno;
}

// Without CAP_SYS_NICE the flag stays: it says something only of threads with a nice below 0.
void ThreadNice::give_back() {
    const int saved_errno = errno;
    const std::lock_guard lock(mutex_);
    round_.fetch_add(1);
    for (const Holder& holder : holders_)
        if (!set(holder.thread, holder.own, 0)) set(holder.thread, holder.own, kResetOnFork);
    holders_.clear();
    errno = saved_errno;
}

void ThreadNice::thread_ends() {
    if (!is_on_.load(std::memory_order_relaxed)) return;
    const auto thread = static_cast<pid_t>(syscall(SYS_gettid));
    const std::lock_guard lock(mutex_);
    std::erase_if(holders_, [thread](const Holder& holder) { return holder.thread == thread; });
}

}  // namespace urgengo
