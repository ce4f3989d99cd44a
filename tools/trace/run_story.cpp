// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/run_story.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <unordered_map>
#include <utility>

#include "host/observe/mode_word.h"
#include "host/sched/guard_mode.h"

namespace urgengo::trace {
namespace {

using Kind = RunSlice::Kind;

std::optional<std::pair<Kind, bool>> slice_of(RunKind kind) {
    switch (kind) {
        case RunKind::kTaskBegin:
            return {{Kind::kTask, true}};
        case RunKind::kTaskEnd:
            return {{Kind::kTask, false}};
        case RunKind::kSegmentBegin:
            return {{Kind::kSegment, true}};
        case RunKind::kSegmentEnd:
            return {{Kind::kSegment, false}};
        case RunKind::kWaitBegin:
            return {{Kind::kWait, true}};
        case RunKind::kWaitEnd:
            return {{Kind::kWait, false}};
        case RunKind::kHoldBegin:
            return {{Kind::kHold, true}};
        case RunKind::kHoldEnd:
            return {{Kind::kHold, false}};
        default:
            return std::nullopt;
    }
}

class Teller {
  public:
    explicit Teller(const Run& run) : run_(run), open_(run.tasks.size()) {}

    RunStory tell() {
        for (const RunRecord& record : run_.records) take(record);
        for (std::size_t task = 0; task < open_.size(); ++task)
            for (auto& slot : open_[task].slices) close(slot, run_.last_ns());
        sort_frames();
        std::stable_sort(
            story_.slices.begin(), story_.slices.end(),
            [](const RunSlice& a, const RunSlice& b) { return a.begin_ns < b.begin_ns; });
        return std::move(story_);
    }

  private:
    static constexpr std::size_t kKinds = 5;  // holds of threads and of gates are apart
    struct OfTask {
        std::optional<RunSlice> slices[kKinds];
        std::unordered_map<std::uint32_t, std::int64_t> arrivals;  ///< by instance
    };

    static std::size_t place_of(Kind kind, std::uint8_t flags) {
        return static_cast<std::size_t>(kind) + (kind == Kind::kHold && (flags & abi::kRunGate));
    }

    void take(const RunRecord& record) {
        if (const auto slice = slice_of(record.kind)) return take_slice(record, *slice);
        const auto chain = static_cast<std::size_t>(std::max<int>(record.chain, 0));
        switch (record.kind) {
            case RunKind::kFrameBegin: {
                RunFrame& frame = frame_of(chain, record.arrival_ns, record.time_ns);
                frame.number = record.number;
                frame.begin_ns = record.time_ns;
                return;
            }
            case RunKind::kFrameEnd: {
                RunFrame& frame = frame_of(chain, record.arrival_ns, record.time_ns);
                frame.has_ended = true;
                frame.exited = (record.flags & abi::kRunExited) != 0;
                frame.latency_ns = record.frame.latency_ns;
                frame.amount_ns = record.frame.amount_ns;
                frame.cause = record.cause;
                frame.cause_detail = record.cause_detail;
                frame.behind = record.behind_chain;
                return;
            }
            default: {
                RunRecord& point = story_.points.emplace_back(record);
                if (record.task < 0 || record.arrival_ns != 0) return;
                const OfTask& task = open_[static_cast<std::size_t>(record.task)];
                const auto found = task.arrivals.find(record.number);
                if (found != task.arrivals.end()) point.arrival_ns = found->second;
                return;
            }
        }
    }

    void take_slice(const RunRecord& record, std::pair<Kind, bool> what) {
        const auto [kind, is_begin] = what;
        OfTask& task = open_[static_cast<std::size_t>(record.task)];
        if (kind == Kind::kTask) task.arrivals[record.number] = record.arrival_ns;
        if (record.arrival_ns != 0)
            frame_of(static_cast<std::size_t>(record.chain), record.arrival_ns, record.time_ns);
        std::optional<RunSlice>& slot = task.slices[place_of(kind, record.flags)];
        // What was left without an end cannot go on beside this one, nor beyond its task's end.
        const bool is_its_end = !is_begin && slot && slot->begin_ns == record.begin_ns;
        if (is_its_end)
            slot.reset();
        else
            close(slot, is_begin ? record.time_ns : std::max(record.begin_ns, begin_of(slot)));
        if (kind == Kind::kTask)
            for (auto& other : task.slices) close(other, record.time_ns);
        RunSlice slice;
        slice.kind = kind;
        slice.task = static_cast<std::size_t>(record.task);
        slice.chain = static_cast<std::size_t>(record.chain);
        slice.thread = record.thread;
        slice.begin_ns = is_begin ? record.time_ns : record.begin_ns;
        slice.end_ns = record.time_ns;
        slice.flags = record.flags;
        slice.why = record.why;
        slice.behind_task = record.behind_task;
        slice.behind_chain = record.behind_chain;
        if (kind == Kind::kSegment) slice.estimate_ns = record.segment.estimate_ns;
        slice.frame = index_of(slice.chain, record.arrival_ns);
        if (is_begin)
            slot = slice;
        else
            story_.slices.push_back(slice);
    }

    static std::int64_t begin_of(const std::optional<RunSlice>& slot) {
        return slot ? slot->begin_ns : 0;
    }

    void close(std::optional<RunSlice>& slot, std::int64_t end_ns) {
        if (!slot) return;
        slot->is_open = true;
        slot->end_ns = std::max(slot->begin_ns, end_ns);
        story_.slices.push_back(*slot);
        slot.reset();
    }

    std::size_t index_of(std::size_t chain, std::int64_t arrival_ns) const {
        const auto found = index_.find({chain, arrival_ns});
        return found == index_.end() ? kNoFrame : found->second;
    }

    RunFrame& frame_of(std::size_t chain, std::int64_t arrival_ns, std::int64_t now_ns) {
        const auto [found, is_new] = index_.try_emplace({chain, arrival_ns}, story_.frames.size());
        if (is_new) {
            RunFrame& frame = story_.frames.emplace_back();
            frame.chain = chain;
            frame.arrival_ns = frame.begin_ns = arrival_ns;
        }
        RunFrame& frame = story_.frames[found->second];
        if (!frame.has_ended) frame.end_ns = std::max({frame.end_ns, now_ns, frame.arrival_ns});
        return frame;
    }

    void sort_frames() {
        std::vector<std::size_t> order, place(story_.frames.size());
        for (const auto& entry : index_) order.push_back(entry.second);  // by chain and arrival
        std::vector<RunFrame> sorted;
        for (const std::size_t from : order) {
            place[from] = sorted.size();
            sorted.push_back(story_.frames[from]);
        }
        story_.frames = std::move(sorted);
        for (RunSlice& slice : story_.slices)
            if (slice.frame != kNoFrame) slice.frame = place[slice.frame];
        std::uint32_t next = 0;
        for (std::size_t i = story_.frames.size(); i-- > 0;) {
            RunFrame& frame = story_.frames[i];
            if (i + 1 < story_.frames.size() && story_.frames[i + 1].chain != frame.chain) next = 0;
            if (frame.number == 0 && next > 1) frame.number = next - 1;
            next = frame.number;
        }
    }

    const Run& run_;
    RunStory story_;
    std::vector<OfTask> open_;
    std::map<std::pair<std::size_t, std::int64_t>, std::size_t> index_;
};

}  // namespace

RunStory tell(const Run& run) {
    return Teller(run).tell();
}

std::size_t RunStory::find(std::size_t chain, std::uint32_t number) const {
    for (std::size_t i = 0; i < frames.size(); ++i)
        if (frames[i].chain == chain && frames[i].number == number) return i;
    return kNoFrame;
}

const char* in_words(abi::Why why) {
    switch (why) {
        case abi::Why::kNone:
            return "";
        case abi::Why::kRank:
            return "more urgent work fills the GPU";
        case abi::Why::kRunAhead:
            return "its own work is far enough ahead of the GPU";
        case abi::Why::kTurnToLaunch:
            return "enough others launch";
        case abi::Why::kDrain:
            return "a more urgent task waits for all GPU work";
        case abi::Why::kThreshold:
            return "another task is truly urgent";
        case abi::Why::kBucket:
            return "its range of priorities has a request on the GPU";
        case abi::Why::kGroup:
            return "another group has its turn";
        case abi::Why::kExclusive:
            return "one task at a time";
    }
    return "";
}

std::string chain_name(const Run& run, int chain) {
    return chain < 0 ? "" : run.chains[static_cast<std::size_t>(chain)].name;
}

std::string task_name(const Run& run, std::size_t task) {
    const RunTaskNames& its = run.tasks[task];
    return (its.chain < run.chains.size() ? run.chains[its.chain].name + "/" : "") + its.name;
}

std::string frame_name(const Run& run, const RunFrame& frame) {
    const std::string number = frame.number == 0 ? "?" : std::to_string(frame.number);
    return run.chains[frame.chain].name + " #" + number;
}

std::string hold_words(const Run& run, const RunSlice& slice) {
    std::string words = slice.is_paced() ? "paced" : "held";
    if (slice.flags & abi::kRunGate) words += " at a gate";
    if (slice.flags & abi::kRunCopy) words += " (copy)";
    if (slice.behind_chain >= 0 && !slice.is_paced())
        words += " behind " + chain_name(run, slice.behind_chain);
    return words;
}

std::string steered_words(const Run& run, const RunRecord& point) {
    const std::string chain = chain_name(run, point.chain);
    if (point.kind == RunKind::kChainMode)
        return chain + ": at most " + observe::to_word(point.mode);
    constexpr auto kLast = static_cast<std::uint32_t>(sched::GuardMode::kObserve);
    return chain + ": guard: " +
           (point.way <= kLast ? sched::to_word(static_cast<sched::GuardMode>(point.way))
                               : "unknown");
}

}  // namespace urgengo::trace
