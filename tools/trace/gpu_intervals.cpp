// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/gpu_intervals.h"

#include <algorithm>
#include <map>
#include <optional>

namespace urgengo::trace {
namespace {

constexpr int kGpuTimeBits = 48;
/// Measured: 1.3 to 4 us. More was another thread's work.
constexpr std::uint32_t kMostMarkNs = 10'000;
constexpr std::uint32_t kMostPauseNs = 3'000;
/// The shortest kernels take about 1 us: those of no instructions.
constexpr std::int64_t kLeastKernelNs = 500;

/// Turns 48-bit times into times since the first of them. Differences are right as long as they are
/// below 39 hours.
class GpuClock {
  public:
    std::int64_t since_first(std::uint64_t gpu_ns) {
        if (!first_) first_ = gpu_ns;
        constexpr int kUnused = 64 - kGpuTimeBits;
        return static_cast<std::int64_t>((gpu_ns - *first_) << kUnused) >> kUnused;
    }

  private:
    std::optional<std::uint64_t> first_;
};

/// The launches of one stream, chained.
class StreamChain {
  public:
    explicit StreamChain(const MarkTimes& of_marks) : of_marks_(of_marks) {}

    /// @param begin_ns  as marked, if it was
    void add_marked(GpuInterval& interval, std::optional<std::int64_t> begin_ns,
                    std::int64_t end_ns) {
        unmarked_.push_back(&interval);
        // A begin that was marked is that of this launch, not of the unmarked ones before it.
        if (begin_ns) unmarked_.erase(unmarked_.begin(), unmarked_.end() - 1);
        const std::optional<std::int64_t> from = begin_ns ? begin_ns : last_end_ns_;
        if (from) {
            const std::int64_t begin = std::min(*from + of_marks_.mark_ns, end_ns);
            const std::int64_t most_pause =
                std::max<std::int64_t>(0, end_ns - begin - kLeastKernelNs);
            share_out(begin, end_ns - std::min(of_marks_.pause_ns, most_pause));
        }
        unmarked_.clear();
        last_end_ns_ = end_ns;
    }

    void add_unmarked(GpuInterval& interval) { unmarked_.push_back(&interval); }

  private:
    void share_out(std::int64_t begin_ns, std::int64_t end_ns) {
        const auto count = static_cast<std::int64_t>(unmarked_.size());
        const std::int64_t length = end_ns - begin_ns;
        for (std::int64_t i = 0; i < count; ++i) {
            GpuInterval& interval = *unmarked_[static_cast<std::size_t>(i)];
            interval.known = true;
            interval.begin_ns = begin_ns + length * i / count;
            interval.end_ns = begin_ns + length * (i + 1) / count;
            interval.shared = static_cast<std::uint32_t>(count);
            interval.loose = (unmarked_.front()->launch->flags & abi::kTraceLoose) != 0;
        }
    }

    const MarkTimes of_marks_;
    std::optional<std::int64_t> last_end_ns_;
    std::vector<GpuInterval*> unmarked_;
};

/// Launches of one stream in the order in which the stream has them: by their ends where known. An
/// unmarked one stays behind the launch that came before it in time.
void chain(std::vector<GpuInterval*>& launches, GpuClock& clock, const MarkTimes& of_marks) {
    struct Entry {
        std::int64_t end_ns;
        GpuInterval* interval;
    };
    std::stable_sort(launches.begin(), launches.end(), [](const auto* a, const auto* b) {
        return a->launch->time_ns < b->launch->time_ns;
    });
    std::vector<Entry> entries;
    std::int64_t last_end_ns = INT64_MIN;
    for (GpuInterval* interval : launches) {
        const std::uint64_t end = interval->launch->launch.gpu_end_ns;
        if (end != 0) last_end_ns = clock.since_first(end);
        entries.push_back({last_end_ns, interval});
    }
    std::stable_sort(entries.begin(), entries.end(),
                     [](const Entry& a, const Entry& b) { return a.end_ns < b.end_ns; });
    StreamChain stream(of_marks);
    for (const Entry& entry : entries) {
        const abi::TraceLaunch& launch = entry.interval->launch->launch;
        if (launch.gpu_end_ns == 0) {
            stream.add_unmarked(*entry.interval);
            continue;
        }
        std::optional<std::int64_t> begin;
        if (launch.gpu_begin_ns != 0) begin = clock.since_first(launch.gpu_begin_ns);
        stream.add_marked(*entry.interval, begin, entry.end_ns);
    }
}

}  // namespace

MarkTimes plausible_mark_times(const abi::TraceHeader& header) {
    if (header.mark_ns == 0 || header.mark_ns > kMostMarkNs) return {};
    return {header.mark_ns, header.pause_ns <= kMostPauseNs ? header.pause_ns : 0};
}

double utilization_of(const TraceRecord& record) {
    constexpr double kFull = 65535;
    return record.launch.utilization / kFull;
}

std::vector<std::vector<GpuInterval>> gpu_intervals(const Trace& trace) {
    std::vector<std::vector<GpuInterval>> intervals;
    for (const ThreadTrace& thread : trace.threads()) {
        std::vector<GpuInterval>& launches = intervals.emplace_back();
        for (const TraceRecord* event : thread.events) {
            if (event->kind == TraceKind::kLaunch) launches.push_back({event});
        }
    }
    std::map<std::uint64_t, std::vector<GpuInterval*>> streams;
    for (auto& launches : intervals) {
        for (GpuInterval& interval : launches) {
            streams[interval.launch->launch.stream].push_back(&interval);
        }
    }
    GpuClock clock;
    for (auto& [stream, launches] : streams) {
        chain(launches, clock, plausible_mark_times(trace.header()));
    }
    return intervals;
}

}  // namespace urgengo::trace
