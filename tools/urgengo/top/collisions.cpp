// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/top/collisions.h"

#include <condition_variable>

#include "host/base/clock.h"
#include "tools/trace/collision.h"

namespace urgengo::cli {
namespace {

constexpr std::int64_t kSeconds = 60;

std::int64_t second_of(nanoseconds time) {
    return time.count() / 1'000'000'000;
}

std::pair<std::uint64_t, std::uint32_t> process_of(const PageReading& page) {
    return {page.process.start_ticks, page.process.process};
}

}  // namespace

std::vector<bool> colliding_chains(const PageReading& page) {
    std::vector<std::size_t> which;
    std::vector<trace::ChainOnGpu> on_gpu;
    for (std::size_t i = 0; i < page.chains.size(); ++i) {
        const TaskReading* first = nullptr;
        for (const std::size_t index : page.chains[i].tasks) {
            const TaskReading& task = page.tasks[index];
            const bool is_there = task.state == abi::TaskState::kGpu && task.priority;
            if (is_there && (!first || task.deadline < first->deadline)) first = &task;
        }
        if (!first) continue;
        which.push_back(i);
        on_gpu.push_back({first->deadline.count(), *first->priority});
    }
    const std::vector<bool> collide = trace::colliding(on_gpu);
    std::vector<bool> chains(page.chains.size());
    for (std::size_t i = 0; i < which.size(); ++i) chains[which[i]] = collide[i];
    return chains;
}

void Collisions::looked(const PageReading& page, nanoseconds now) {
    const std::vector<bool> collide = colliding_chains(page);
    const std::lock_guard lock(mutex_);
    std::deque<Second>& seconds = seen_[process_of(page)];
    if (seconds.empty() || seconds.back().number != second_of(now))
        seconds.push_back({second_of(now), {}});
    Second& second = seconds.back();
    second.chains.resize(collide.size());
    for (std::size_t i = 0; i < collide.size(); ++i) {
        ++second.chains[i].looks;
        second.chains[i].collided += collide[i];
    }
}

void Collisions::set(std::vector<PageReading>& pages, nanoseconds now) {
    const std::lock_guard lock(mutex_);
    std::map<Process, std::deque<Second>> still_there;
    stems_.clear();
    for (PageReading& page : pages) {
        stems_.push_back(page.stem);
        std::deque<Second>& seconds = still_there[process_of(page)] =
            std::move(seen_[process_of(page)]);
        while (!seconds.empty() && seconds.front().number <= second_of(now) - kSeconds)
            seconds.pop_front();
        for (const Second& second : seconds)
            for (std::size_t i = 0; i < page.chains.size() && i < second.chains.size(); ++i) {
                page.chains[i].collisions.looks += second.chains[i].looks;
                page.chains[i].collisions.collided += second.chains[i].collided;
            }
    }
    seen_ = std::move(still_there);
}

void Collisions::look() {
    std::vector<std::string> stems;
    {
        const std::lock_guard lock(mutex_);
        stems = stems_;
    }
    for (const std::string& stem : stems) {
        const nanoseconds now = monotonic_now();
        if (const auto page = read_page(stem, now)) looked(*page, now);
    }
}

CollisionLooks::CollisionLooks(Collisions& collisions)
    : thread_([&collisions](const std::stop_token& stop) {
          std::mutex mutex;
          std::condition_variable_any wakes;
          std::unique_lock lock(mutex);
          while (!wakes.wait_for(lock, stop, Collisions::kBetween, [] { return false; }) &&
                 !stop.stop_requested())
              collisions.look();
      }) {}

}  // namespace urgengo::cli
