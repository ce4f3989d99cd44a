// SPDX-License-Identifier: Apache-2.0
//
// A program that is made of chances, in virtual time: what part of its deadline a frame takes is
// drawn, and what it is drawn from depends on the modes that the guard gives its chains.
#pragma once

#include <algorithm>
#include <chrono>
#include <functional>
#include <optional>
#include <ostream>
#include <queue>
#include <random>
#include <vector>

#include "host/sched/guard.h"

namespace urgengo::testing {

using namespace std::chrono_literals;
using sched::Guard;
using sched::nanoseconds;

/// @returns the part of its deadline that a frame takes
using Program =
    std::function<double(std::size_t chain, const Guard&, nanoseconds now, std::mt19937_64&)>;

/// Chains with periods of 50, 62, 74 ... ms, or others, whose deadlines are their periods.
class World {
  public:
    World(std::size_t num_chains, std::uint64_t seed, Program program, nanoseconds first = 50ms,
          nanoseconds step = 12ms)
        : random_(seed), program_(std::move(program)), late_(num_chains), frames_(num_chains) {
        for (std::size_t i = 0; i < num_chains; ++i)
            periods_.push_back(first + static_cast<int>(i) * step);
        guard.emplace(periods_);
        for (std::size_t i = 0; i < num_chains; ++i)
            events_.push({1s + static_cast<int>(i) * 7ms, i, false, {}, {}});
    }

    void run_to(nanoseconds end) {
        while (events_.top().time < end) {
            const Event e = events_.top();
            events_.pop();
            now = e.time;
            e.is_end ? ends(e) : begins(e);
        }
    }
    /// Of all chains' frames since the last call.
    double late_share() {
        const double frames = sum(frames_), late = sum(late_);
        forget();
        return late / frames;
    }
    double late_share_of(std::size_t chain) const {
        return static_cast<double>(late_[chain]) / static_cast<double>(frames_[chain]);
    }
    void forget() {
        std::fill(late_.begin(), late_.end(), 0);
        std::fill(frames_.begin(), frames_.end(), 0);
    }

    bool all_settled(sched::GuardMode mode) const {
        for (std::size_t i = 0; i < periods_.size(); ++i)
            if (guard->settled(i).mode != mode) return false;
        return true;
    }

    std::optional<Guard> guard;
    nanoseconds now{0};

  private:
    struct Event {
        nanoseconds time;
        std::size_t chain;
        bool is_end;
        nanoseconds arrival;
        double ratio;
        bool operator<(const Event& e) const { return time > e.time; }
    };
    static double sum(const std::vector<int>& v) {
        double all = 0;
        for (int x : v) all += x;
        return all;
    }
    void begins(const Event& e) {
        const nanoseconds period = periods_[e.chain];
        guard->frame_began(e.chain, now, period);
        const double ratio = program_(e.chain, *guard, now, random_);
        const auto took =
            nanoseconds(static_cast<std::int64_t>(ratio * static_cast<double>(period.count())));
        events_.push({now + took, e.chain, true, now, ratio});
    }
    // A thread that is late begins its next frame late; it has arrived when it was due.
    void ends(const Event& e) {
        const nanoseconds period = periods_[e.chain];
        guard->frame_ended(e.chain, now - e.arrival, period, now);
        ++frames_[e.chain];
        late_[e.chain] += e.ratio > 1;
        events_.push({std::max(e.arrival + period, now + 1ms), e.chain, false, {}, {}});
    }

    std::mt19937_64 random_;
    Program program_;
    std::vector<nanoseconds> periods_;
    std::priority_queue<Event> events_;
    std::vector<int> late_, frames_;
};

/// What something took, in the worlds of several seeds.
class Durations {
  public:
    void add(nanoseconds time) {
        const double time_s = 1e-9 * static_cast<double>(time.count());
        sorted_s_.insert(std::ranges::upper_bound(sorted_s_, time_s), time_s);
    }
    double median_s() const { return sorted_s_[sorted_s_.size() / 2]; }
    double nine_of_ten_s() const {
        return sorted_s_[std::min(sorted_s_.size() * 9 / 10 + 1, sorted_s_.size() - 1)];
    }
    double most_s() const { return sorted_s_.back(); }

    friend std::ostream& operator<<(std::ostream& out, const Durations& its) {
        return out << its.median_s() << " s (median), " << its.nine_of_ten_s() << " s (9 of 10), "
                   << its.most_s() << " s (most)";
    }

  private:
    std::vector<double> sorted_s_;
};

/// @returns a ratio that is above 1 with this probability
inline double with_late(double share, std::mt19937_64& random) {
    std::uniform_real_distribution<> spread(0, 1);
    return spread(random) < share ? 1.05 + 0.9 * spread(random) : 0.3 + 0.65 * spread(random);
}

}  // namespace urgengo::testing
