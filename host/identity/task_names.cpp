// SPDX-License-Identifier: Apache-2.0
#include "host/identity/task_names.h"

#include <sys/prctl.h>

#include <algorithm>
#include <cstring>

#include "host/identity/glob.h"

namespace urgengo::identity {
namespace {

constexpr std::size_t kMaxUnmatched = 32;
constexpr std::uint16_t kMaxPatience = 1024;

}  // namespace

void TaskNames::add_task(int task, const config::Task& match, bool is_off) {
    // A task with a range is known by nothing else.
    const bool by_thread = match.nvtx_glob.empty() && !is_off &&
                           (!match.thread_glob.empty() || !match.kernels.empty());
    tasks_.push_back({.task = task,
                      .thread_glob = match.thread_glob,
                      .nvtx_glob = match.nvtx_glob,
                      .by_thread = by_thread,
                      .any_thread = by_thread && match.thread_glob.empty()});
    knows_ranges_ = knows_ranges_ || !match.nvtx_glob.empty();
}

void TaskNames::read(NamedThread& thread) {
    char name[16] = {};
    prctl(PR_GET_NAME, name);
    const bool known = std::memcmp(name, thread.name, sizeof name) == 0;
    if (known && thread.was_read) {
        thread.patience = std::min<std::uint16_t>(kMaxPatience, thread.patience + 1);
        return;
    }
    thread.patience = 1;
    thread.was_read = true;
    std::memcpy(thread.name, name, sizeof name);
    thread.num_candidates = 0;
    for (const Known& known_task : tasks_)
        if (known_task.by_thread &&
            (known_task.any_thread || glob_fits(known_task.thread_glob, name)))
            thread.candidates[thread.num_candidates++] = static_cast<std::int16_t>(known_task.task);
    if (thread.num_candidates > 0) return;
    const std::lock_guard lock(mutex_);
    if (unmatched_.size() < kMaxUnmatched) unmatched_.insert(name);
}

int TaskNames::task_of_range(const std::string& range) const {
    for (const Known& known : tasks_)
        if (!known.nvtx_glob.empty() && glob_fits(known.nvtx_glob, range.c_str()))
            return known.task;
    return -1;
}

std::vector<std::string> TaskNames::unmatched() {
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock.owns_lock()) return {};
    return {unmatched_.begin(), unmatched_.end()};
}

}  // namespace urgengo::identity
