// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/position_sampler.h"

#include <pthread.h>
#include <sys/prctl.h>
#include <time.h>

#include <algorithm>
#include <cerrno>
#include <random>

namespace urgengo::chains {

using std::chrono::nanoseconds;

namespace {

/// However long the mean: an end must be noticed.
constexpr nanoseconds kLongestSleep{20'000'000};

nanoseconds time_of(clockid_t clock) {
    timespec now{};
    clock_gettime(clock, &now);
    return std::chrono::seconds(now.tv_sec) + nanoseconds(now.tv_nsec);
}

void sleep_until(nanoseconds when) {
    const timespec until{static_cast<time_t>(when.count() / 1'000'000'000),
                         static_cast<long>(when.count() % 1'000'000'000)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
    }
}

}  // namespace

PositionSampler::PositionSampler(const ug_hints& hints, std::vector<Target> targets,
                                 nanoseconds mean, std::size_t room, std::uint32_t seed)
    : hints_(hints), targets_(std::move(targets)), mean_(mean), seed_(seed) {
    samples_.reserve(room);
}

void PositionSampler::start() {
    thread_ = std::thread([this] { run(); });
}

void PositionSampler::stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
}

void PositionSampler::run() {
    pthread_setname_np(pthread_self(), "sampler");
    prctl(PR_SET_TIMERSLACK, 1);
    std::mt19937_64 random(seed_);
    std::exponential_distribution<double> distance(1 / static_cast<double>(mean_.count()));
    const nanoseconds begin = time_of(CLOCK_MONOTONIC);
    nanoseconds next = begin;
    while (!stop_.load(std::memory_order_relaxed)) {
        next += std::min(nanoseconds(static_cast<std::int64_t>(distance(random))), kLongestSleep);
        sleep_until(next);
        ++summary_.wakes;
        look();
    }
    summary_.cpu_s = std::chrono::duration<double>(time_of(CLOCK_THREAD_CPUTIME_ID)).count();
    summary_.wall_s = std::chrono::duration<double>(time_of(CLOCK_MONOTONIC) - begin).count();
}

void PositionSampler::look() {
    for (std::size_t i = 0; i < targets_.size(); i++) {
        const Target& target = targets_[i];
        const TaskRuns::Current current = target.runs->current();
        if (!current) continue;
        if (samples_.size() == samples_.capacity()) {
            ++summary_.lost;
            continue;
        }
        ug_position_t position{};
        position.size = sizeof(position);
        const nanoseconds before = time_of(CLOCK_MONOTONIC);
        const bool answered =
            hints_.position(target.chain.c_str(), target.tasks[current.task()].c_str(), &position);
        const nanoseconds after = time_of(CLOCK_MONOTONIC);
        if (target.runs->current() != current) {
            ++summary_.changed;
            continue;
        }
        PositionSample sample;
        sample.before_ns = before.count();
        sample.took_ns = static_cast<std::uint32_t>((after - before).count());
        sample.target = static_cast<std::uint16_t>(i);
        sample.run = current.run();
        if (answered) {
            sample.flags = static_cast<std::uint16_t>(
                PositionSample::kAnswered | (position.busy ? PositionSample::kBusy : 0) |
                (position.overdue ? PositionSample::kOverdue : 0));
            sample.launch = position.launch;
            sample.instance = position.instance;
            sample.remaining_ns = position.remaining_ns;
            sample.unexecuted_ns = position.unexecuted_ns;
            sample.uncertain_ns = position.uncertain_ns;
        }
        samples_.push_back(sample);
    }
}

}  // namespace urgengo::chains
