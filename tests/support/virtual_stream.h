// SPDX-License-Identifier: Apache-2.0
//
// One task's stream on a virtual GPU, for tests of how progress is told: launches with true
// durations that differ from their estimates, marks between, times in which others have the GPU.
//
// First the program is put down in the order of its calls; truth is known at once. Then time is
// moved on: the launch log and the mark's line show what they would show then.
#pragma once

#include <algorithm>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include "host/model/launch_log.h"
#include "host/model/position.h"
#include "urgengo/abi/device_mailbox.h"

namespace urgengo::testing {

using std::chrono::nanoseconds;

/// A %globaltimer that runs at another rate than the host's clock and counts in steps.
struct VirtualTimer {
    std::int64_t epoch_ns = 1'000'000'000'000;
    double ppm = 0;
    std::int64_t granularity_ns = 32;

    std::uint64_t stamp(nanoseconds host) const {
        const std::int64_t exact =
            epoch_ns + host.count() +
            static_cast<std::int64_t>(static_cast<double>(host.count()) * ppm * 1e-6);
        const std::int64_t shown = exact / granularity_ns * granularity_ns;
        return static_cast<std::uint64_t>(shown) & ((std::uint64_t{1} << 48) - 1);
    }
};

class VirtualStream {
  public:
    struct Launch {
        nanoseconds call{0}, begin{0}, end{0};
        nanoseconds estimate{0};
        model::LoggedLaunch logged;
    };
    struct Mark {
        nanoseconds call{0}, run{0};
        std::uint32_t sequence = 0;
        std::uint32_t launches = 0;
        bool lost = false;  ///< never runs; so nothing behind it shows
    };

    static constexpr nanoseconds kLatency{3'000};  ///< from call to begin, on an idle GPU
    static constexpr nanoseconds kVisible{1'000};  ///< from a mark's run until the host sees it
    static constexpr nanoseconds kMarkCost{830};

    explicit VirtualStream(std::uint32_t first_launch = 0, std::uint32_t first_mark = 0)
        : log(first_launch, first_mark), first_launch_(first_launch), first_mark_(first_mark) {
        line.word[0] = ug_mark_word0(0, 0, first_mark);
        line.word[1] = first_mark & 0xffffu;
    }

    // --- the program

    /// Others have the GPU from begin to end: what runs is stopped so long. In order of time.
    void others(nanoseconds begin, nanoseconds end) { others_.push_back({begin, end}); }

    void launch(nanoseconds call, nanoseconds truth, nanoseconds estimate, std::uint32_t position,
                std::uint16_t instance = 1, std::uint64_t kernel = 1) {
        Launch l;
        l.call = call;
        l.begin = not_before(std::max(gpu_free_, call + kLatency));
        l.end = advanced(l.begin, truth);
        l.estimate = estimate;
        l.logged = {nanoseconds{0}, call, kernel, position, instance};
        gpu_free_ = l.end;
        launches.push_back(l);
    }

    void mark(nanoseconds call, bool lost = false) {
        Mark m;
        m.call = call;
        m.run = not_before(std::max(gpu_free_, call + kLatency));
        m.sequence = first_mark_ + static_cast<std::uint32_t>(marks.size()) + 1;
        m.launches = static_cast<std::uint32_t>(launches.size());
        m.lost = lost;
        if (!lost) gpu_free_ = m.run + kMarkCost;
        marks.push_back(m);
    }

    nanoseconds gpu_free() const { return gpu_free_; }

    // --- what the host sees at a time; times never go back

    void move_to(nanoseconds now) {
        for (;;) {
            const bool launch_next =
                num_launched_ < launches.size() && launches[num_launched_].call <= now;
            const bool mark_next = num_marked_ < marks.size() && marks[num_marked_].call <= now &&
                                   marks[num_marked_].launches <= num_launched_;
            if (mark_next) {
                log.marked(marks[num_marked_].call, marks[num_marked_].sequence);
                ++num_marked_;
            } else if (launch_next) {
                log.launched(launches[num_launched_].estimate, launches[num_launched_].logged);
                ++num_launched_;
            } else {
                break;
            }
        }
        while (num_run_ < num_marked_ &&
               (marks[num_run_].lost || marks[num_run_].run + kVisible <= now)) {
            const Mark& m = marks[num_run_++];
            if (m.lost) continue;
            const model::LoggedLaunch last =
                m.launches > 0 ? launches[m.launches - 1].logged : model::LoggedLaunch{};
            line.word[0] = ug_mark_word0(last.position + 1, last.instance, m.sequence);
            line.word[1] = timer.stamp(m.run) << 16 | (m.sequence & 0xffffu);
        }
    }

    /// @returns index of the launch that the GPU is at, or would be at next
    std::size_t truth(nanoseconds now) const {
        return static_cast<std::size_t>(
            std::upper_bound(launches.begin(), launches.end(), now,
                             [](nanoseconds t, const Launch& l) { return t < l.end; }) -
            launches.begin());
    }
    /// @returns true GPU time of what is launched and not executed
    nanoseconds truly_left(nanoseconds now) const {
        nanoseconds left{0};
        for (std::size_t i = truth(now); i < launches.size() && launches[i].call <= now; ++i)
            left += launches[i].end - std::max(launches[i].begin, std::min(now, launches[i].end));
        return left;
    }

    /// @returns the mark that ran last as far as the host sees, with its exact time
    model::SeenMark seen() const {
        const auto mark = model::read_mark(line, log.last_mark());
        const std::uint32_t index = mark->sequence - first_mark_;
        return {mark->sequence, index == 0 ? nanoseconds{0} : marks[index - 1].run};
    }
    std::uint32_t first_launch() const { return first_launch_; }

    model::LaunchLog log;
    ug_mark_line line{};
    VirtualTimer timer;
    std::vector<Launch> launches;
    std::vector<Mark> marks;

  private:
    nanoseconds not_before(nanoseconds t) const {
        for (const auto& [begin, end] : others_)
            if (t >= begin && t < end) t = end;
        return t;
    }
    nanoseconds advanced(nanoseconds t, nanoseconds work) const {
        for (const auto& [begin, end] : others_) {
            if (end <= t) continue;
            if (t + work <= begin) break;
            work -= std::max(begin - t, nanoseconds{0});
            t = end;
        }
        return t + work;
    }

    std::uint32_t first_launch_, first_mark_;
    nanoseconds gpu_free_{0};
    std::vector<std::pair<nanoseconds, nanoseconds>> others_;
    std::size_t num_launched_ = 0, num_marked_ = 0, num_run_ = 0;
};

/// One instance of a task: what its kernels take, and what is thought of them.
struct VirtualInstance {
    std::vector<nanoseconds> truth;
    std::vector<nanoseconds> estimates;  ///< shape as truth
    std::vector<std::uint64_t> kernels;  ///< shape as truth; empty: its position + 1
    nanoseconds every{200'000};          ///< estimated work between marks
    nanoseconds run_ahead{1'000'000};    ///< launched and not executed, at most
    std::uint16_t instance = 1;
};

/// Launches an instance from `begin` on, 2 to 5 us a launch, with marks, one behind the last.
/// @returns when the program comes back from waiting for it
inline nanoseconds launch_instance(VirtualStream& stream, const VirtualInstance& instance,
                                   nanoseconds begin, std::mt19937& random) {
    std::uniform_int_distribution<std::int64_t> launch_ns(2'000, 5'000);
    nanoseconds call = begin, unmarked{0}, ahead{0};
    std::size_t oldest = stream.launches.size();
    for (std::size_t i = 0; i < instance.truth.size(); ++i) {
        const nanoseconds estimate = instance.estimates[i];
        for (ahead += estimate; ahead > instance.run_ahead && oldest < stream.launches.size();
             ++oldest) {
            call = std::max(call, stream.launches[oldest].end);
            ahead -= stream.launches[oldest].estimate;
        }
        call += nanoseconds(launch_ns(random));
        stream.launch(call, instance.truth[i], estimate, static_cast<std::uint32_t>(i),
                      instance.instance, instance.kernels.empty() ? i + 1 : instance.kernels[i]);
        unmarked += estimate;
        if (unmarked < instance.every && i + 1 < instance.truth.size()) continue;
        stream.mark(call += nanoseconds(launch_ns(random)));
        unmarked = nanoseconds{0};
    }
    return stream.gpu_free() + VirtualStream::kVisible;
}

}  // namespace urgengo::testing
