// SPDX-License-Identifier: Apache-2.0
//
// A copy engine and its streams in virtual time, as a GPU's was seen to behave: copies are served
// in order of a stream, and the engine goes to another stream's only when the one at hand has none
// left. And the clock of it, that does things at their times while somebody sleeps.
#pragma once

#include <algorithm>
#include <deque>
#include <functional>
#include <map>
#include <vector>

#include <cuda.h>

#include "host/base/clock.h"

namespace urgengo::testing {

class ScriptedClock final : public Clock {
  public:
    nanoseconds now() override { return now_; }
    void sleep_for(nanoseconds duration) override {
        ++num_sleeps;
        pass(duration);
    }
    /// What is due meanwhile is done at its time, and may itself take some.
    void pass(nanoseconds duration) {
        const nanoseconds end = now_ + duration;
        while (!script_.empty() && script_.begin()->first <= end) {
            now_ = std::max(now_, script_.begin()->first);
            const auto action = script_.begin()->second;
            script_.erase(script_.begin());
            action();
        }
        now_ = std::max(now_, end);
    }
    void at(nanoseconds time, std::function<void()> action) { script_.emplace(time, action); }

    int num_sleeps = 0;

  private:
    nanoseconds now_{1'000'000'000};
    std::multimap<nanoseconds, std::function<void()>> script_;
};

class CopyEngine {
  public:
    using nanoseconds = std::chrono::nanoseconds;
    static constexpr nanoseconds kEach{3'000}, kSwitch{15'000};

    explicit CopyEngine(Clock& clock) : clock_(clock) {}

    /// @returns a number for end_of()
    std::size_t copy(CUstream stream, std::size_t bytes) {
        const nanoseconds time(static_cast<std::int64_t>(static_cast<double>(bytes) / gbps));
        ends_.push_back(nanoseconds(0));
        submit(stream, {Kind::kCopy, time + kEach, ends_.size() - 1});
        return ends_.size() - 1;
    }
    /// Something on the stream that takes so long, and not the engine.
    void work(CUstream stream, nanoseconds time) { submit(stream, {Kind::kWork, time, 0}); }
    void record(CUevent event, CUstream stream) {
        submit(stream, {Kind::kEvent, nanoseconds(0), ++events_[event].recorded, event});
    }

    bool is_over(CUevent event) {
        run();
        return events_[event].seen == events_[event].recorded;
    }
    bool is_idle(CUstream stream) {
        run();
        return streams_[stream].empty();
    }
    /// 0: not yet
    nanoseconds end_of(std::size_t copy) {
        run();
        return ends_[copy];
    }

    std::size_t num_copies() const { return ends_.size(); }

    double gbps = 55;

  private:
    enum class Kind { kCopy, kWork, kEvent };
    struct Command {
        Kind kind;
        nanoseconds time;
        std::size_t number;
        CUevent event = nullptr;
        nanoseconds end{0};  ///< of work that has begun
        std::size_t order = 0;
    };
    struct Event {
        std::size_t recorded = 0, seen = 0;
    };

    void submit(CUstream stream, Command command) {
        run();
        command.order = ++num_commands_;
        streams_[stream].push_back(command);
        settle();
    }
    /// What takes no time happens, and what can begin begins.
    void settle() {
        for (auto& [stream, commands] : streams_) {
            while (!commands.empty() && commands.front().kind == Kind::kEvent) {
                events_[commands.front().event].seen = commands.front().number;
                commands.pop_front();
            }
            if (!commands.empty() && commands.front().kind == Kind::kWork &&
                commands.front().end.count() == 0)
                commands.front().end = time_ + commands.front().time;
        }
        if (end_.count() != 0) return;
        const auto wants = [&](const auto& s) {
            return !s.second.empty() && s.second.front().kind == Kind::kCopy;
        };
        auto next = streams_.find(at_hand_);
        if (next == streams_.end() || !wants(*next)) {
            next = streams_.end();
            for (auto s = streams_.begin(); s != streams_.end(); ++s)
                if (wants(*s) && (next == streams_.end() ||
                                  s->second.front().order < next->second.front().order))
                    next = s;
        }
        if (next == streams_.end()) return;
        end_ = time_ + next->second.front().time +
               (next->first == at_hand_ ? nanoseconds(0) : kSwitch);
        at_hand_ = next->first;
    }
    void run() {
        for (;;) {
            nanoseconds next = nanoseconds::max();
            if (end_.count() != 0) next = end_;
            for (const auto& [stream, commands] : streams_)
                if (!commands.empty() && commands.front().kind == Kind::kWork)
                    next = std::min(next, commands.front().end);
            if (next > clock_.now()) break;
            time_ = next;
            if (end_ == time_) {
                auto& commands = streams_[at_hand_];
                ends_[commands.front().number] = time_;
                commands.pop_front();
                end_ = nanoseconds(0);
            }
            for (auto& [stream, commands] : streams_)
                if (!commands.empty() && commands.front().kind == Kind::kWork &&
                    commands.front().end <= time_)
                    commands.pop_front();
            settle();
        }
        time_ = clock_.now();
    }

    Clock& clock_;
    nanoseconds time_{0}, end_{0};  ///< of the copy under way; 0: none is
    CUstream at_hand_ = nullptr;
    std::map<CUstream, std::deque<Command>> streams_;
    std::map<CUevent, Event> events_;
    std::vector<nanoseconds> ends_;
    std::size_t num_commands_ = 0;
};

}  // namespace urgengo::testing
