// SPDX-License-Identifier: Apache-2.0
//
// Arrivals as they are guessed without hints, beside those of a program that is made of a queue:
// it keeps the last few frames, or all, and sleeps where there is none.
#include "host/sched/backlog.h"

#include <algorithm>
#include <deque>
#include <functional>
#include <random>
#include <vector>

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using sched::Backlog;
using sched::nanoseconds;

namespace {

constexpr nanoseconds kPeriod{10ms}, kCpu{200us};

/// A frame as it was, and as it was guessed to be, when the thread began with it.
struct Begun {
    nanoseconds age{0}, guessed{0};
};

class Program {
  public:
    /// @param most_kept  frames that wait; more of them, and the oldest are left out
    Program(std::size_t most_kept, nanoseconds deadline = kPeriod) : most_kept_(most_kept) {
        chain.config.period = kPeriod;
        chain.config.deadline = deadline;
    }

    /// @param time  -> how long the thread works on the frame, as drawn
    std::vector<Begun> run(nanoseconds length,
                           const std::function<nanoseconds(std::mt19937_64&)>& time) {
        std::vector<Begun> all;
        for (const nanoseconds end = now_ + length; now_ < end;) {
            come();
            while (waiting_.empty()) {
                now_ = std::max(now_, next_);
                come();
            }
            const nanoseconds arrival = waiting_.front();
            waiting_.pop_front();
            if (one_in_ten()) now_ += kept_from_cpu;
            now_ += kCpu;  // then it calls
            const nanoseconds guessed = backlog.begin_frame(chain, waited_, kCpu, now_);
            are_in_order &= guessed > nanoseconds(chain.last_arrival_ns);
            chain.last_arrival_ns = guessed.count();
            all.push_back({now_ - arrival, now_ - guessed});
            now_ += time(random_);
            waited_ = now_;
        }
        return all;
    }

    sched::GovernedChain chain;
    Backlog backlog;
    bool are_in_order = true;      ///< arrivals as guessed
    nanoseconds period = kPeriod;  ///< in truth
    nanoseconds latest{700us};     ///< frames come up to so much later than that
    nanoseconds kept_from_cpu{0};  ///< before one call in ten
    double skipped = 0;            ///< part of the frames that never come

  private:
    void come() {
        for (; next_ <= now_; ++count_, next_ = 1s + count_ * period + late()) {
            if (std::uniform_real_distribution<>()(random_) >= skipped) waiting_.push_back(next_);
            if (waiting_.size() > most_kept_) waiting_.pop_front();
        }
    }

    nanoseconds late() {
        return nanoseconds(std::uniform_int_distribution<std::int64_t>(0, latest / 1ns)(random_));
    }
    bool one_in_ten() { return std::uniform_int_distribution(1, 10)(random_) == 1; }

    const std::size_t most_kept_;
    std::deque<nanoseconds> waiting_;
    std::mt19937_64 random_{1};
    int count_ = 0;
    nanoseconds now_{1s}, next_{1s}, waited_{0};
};

constexpr std::size_t kAll = 1000;

auto always(nanoseconds time) {
    return [=](auto&) { return time; };
}

/// One frame in so many takes longer.
auto sometimes(nanoseconds usual, nanoseconds longer, int in) {
    return [=](auto& random) {
        return std::uniform_int_distribution(1, in)(random) == 1 ? longer : usual;
    };
}

/// @returns part of the frames whose arrival was guessed to within a third of a period
double right(const std::vector<Begun>& frames) {
    const auto is_right = [](const Begun& f) {
        return std::chrono::abs(f.age - f.guessed) < kPeriod / 3;
    };
    return static_cast<double>(std::count_if(frames.begin(), frames.end(), is_right)) /
           static_cast<double>(frames.size());
}

}  // namespace

TEST_CASE("Backlog guesses arrivals of a program that works off all frames", "[sched][backlog]") {
    // Now and then it is behind by up to five frames; eight is where a guess ends.
    Program program(kAll, 4 * kPeriod);
    const auto frames = program.run(100s, sometimes(7ms, 40ms, 25));
    CHECK(std::any_of(frames.begin(), frames.end(),
                      [](const Begun& f) { return f.age > 4 * kPeriod; }));
    CHECK(right(frames) > 0.95);
}

TEST_CASE("Backlog guesses arrivals of a program that leaves out frames", "[sched][backlog]") {
    const std::size_t kept = GENERATE(1, 2, 3);
    CAPTURE(kept);
    SECTION("now and then") {
        Program program(kept, 2 * kPeriod);
        program.run(20s, sometimes(7ms, 45ms, 10));
        CHECK(right(program.run(100s, sometimes(7ms, 45ms, 10))) > 0.95);
    }
    SECTION("and is never done, once it was") {
        Program program(kept, 2 * kPeriod);
        program.run(20s, sometimes(7ms, 45ms, 10));
        const auto frames = program.run(100s, always(12ms));
        CHECK(right(frames) > 0.95);
        CHECK(std::all_of(frames.begin(), frames.end(), [&](const Begun& f) {
            return f.guessed <= static_cast<int>(kept) * kPeriod + kPeriod / 2;
        }));
    }
}

TEST_CASE("Backlog takes a program that is never done to keep two frames", "[sched][backlog]") {
    // Behind from its first frame on: nothing is known of how many it keeps.
    Program program(2);
    program.run(2s, always(12ms));
    CHECK(right(program.run(100s, always(12ms))) > 0.95);
}

namespace {

/// Share of frames that end late, in truth or as guessed.
double late(const std::vector<Begun>& frames, nanoseconds Begun::*age, nanoseconds time,
            nanoseconds deadline = kPeriod) {
    const auto is_late = [&](const Begun& f) { return f.*age + time > deadline; };
    return static_cast<double>(std::count_if(frames.begin(), frames.end(), is_late)) /
           static_cast<double>(frames.size());
}

}  // namespace

TEST_CASE("Backlog finds a program in time whose thread hardly ever sleeps", "[sched][backlog]") {
    // The config's period is a little off.
    for (const nanoseconds period : {10ms + 10us, 10ms - 10us, 10ms + 1us}) {
        CAPTURE(period.count());
        Program program(kAll);
        program.period = period;
        program.latest = 0ns;
        const nanoseconds time = 9'700us;
        const auto frames = program.run(200s, always(time));
        CHECK(late(frames, &Begun::age, time) == 0);
        CHECK(late(frames, &Begun::guessed, time) < 0.01);
    }
}

TEST_CASE("Backlog is not misled for long by a thread that is kept from the CPU",
          "[sched][backlog]") {
    Program program(kAll, 4 * kPeriod);
    program.kept_from_cpu = 1ms;
    CHECK(right(program.run(100s, sometimes(7ms, 40ms, 25))) > 0.85);
}

TEST_CASE("Backlog is not misled for long by frames that never come", "[sched][backlog]") {
    Program program(kAll, 4 * kPeriod);
    program.skipped = 0.05;
    CHECK(right(program.run(100s, sometimes(7ms, 40ms, 25))) > 0.75);
}

TEST_CASE("Each arrival is later than the one before, as guessed", "[sched][backlog]") {
    const std::size_t kept = GENERATE(std::size_t{1}, std::size_t{2}, std::size_t{3}, kAll);
    CAPTURE(kept);
    Program program(kept, 2 * kPeriod);
    program.kept_from_cpu = 1ms;
    program.skipped = 0.05;
    program.run(100s, sometimes(8ms, 45ms, 10));
    CHECK(program.are_in_order);
}

TEST_CASE("Backlog guesses that no frame is older than two of the longer of period and deadline",
          "[sched][backlog]") {
    Program program(kAll);
    for (const Begun& f : program.run(1s, always(30ms))) CHECK(f.guessed <= 2 * kPeriod);
}

TEST_CASE("Backlog knows nothing of a chain that other threads serve, too", "[sched][backlog]") {
    Program program(1);
    program.run(20s, sometimes(7ms, 45ms, 10));
    // As of two threads in turns: its last frame was another's.
    const nanoseconds last = 100s;
    program.chain.last_arrival_ns = last.count();
    CHECK(program.backlog.begin_frame(program.chain, last + 15ms, 0ns, last + 15ms) ==
          last + kPeriod);
}
