// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/run_pieces.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <map>
#include <unordered_map>

namespace urgengo::trace {
namespace {

struct Segment {
    std::uint32_t instance = 0;
    std::int64_t arrival_ns = 0;
    std::int64_t begin_ns = 0;
    std::int64_t end_ns = std::numeric_limits<std::int64_t>::max();  ///< open
    std::uint32_t first = 0;
    std::uint32_t end = std::numeric_limits<std::uint32_t>::max();
    std::uint16_t stream = 0;
    bool is_idle = false;  ///< all of it has executed by its end
};

/// An instance's marks, each position's first.
using Marks = std::map<std::uint32_t, const RunRecord*>;

class Cutter {
  public:
    Cutter(const Run& run, const RunStory& story) : of_task_(run.tasks.size()) {
        for (std::size_t i = 0; i < story.frames.size(); ++i)
            frames_.try_emplace({story.frames[i].chain, story.frames[i].arrival_ns}, i);
        for (const RunRecord& record : run.records) take(record);
    }

    std::vector<RunPiece> cut() {
        for (std::size_t task = 0; task < of_task_.size(); ++task) {
            std::vector<Segment>& segments = of_task_[task].segments;
            for (std::size_t i = 0; i < segments.size(); ++i) {
                // The end of one may have been lost.
                if (i + 1 < segments.size() && segments[i + 1].instance == segments[i].instance)
                    segments[i].end = std::min(segments[i].end, segments[i + 1].first);
                cut(task, segments[i]);
            }
        }
        std::stable_sort(pieces_.begin(), pieces_.end(), [](const RunPiece& a, const RunPiece& b) {
            return a.begin_ns < b.begin_ns;
        });
        return std::move(pieces_);
    }

  private:
    struct OfTask {
        std::size_t chain = 0;
        std::vector<Segment> segments;                   ///< the last one may be open
        std::unordered_map<std::uint32_t, Marks> marks;  ///< by instance
    };

    void take(const RunRecord& record) {
        if (record.task < 0) return;
        OfTask& task = of_task_[static_cast<std::size_t>(record.task)];
        task.chain = static_cast<std::size_t>(record.chain);
        if (record.kind == RunKind::kSegmentBegin) {
            Segment& segment = task.segments.emplace_back();
            segment.instance = record.number;
            segment.arrival_ns = record.arrival_ns;
            segment.begin_ns = record.time_ns;
            segment.first = record.segment.position;
            segment.stream = record.stream;
        } else if (record.kind == RunKind::kSegmentEnd) {
            // Else its begin was overwritten, and so it is not known which launches it has.
            if (task.segments.empty() || task.segments.back().begin_ns != record.begin_ns) return;
            Segment& segment = task.segments.back();
            segment.end_ns = record.time_ns;
            segment.end = record.segment.position;
            segment.is_idle = (record.flags & abi::kRunIdle) != 0;
            if (record.stream != 0) segment.stream = record.stream;
        } else if (record.kind == RunKind::kMark) {
            const auto [found, is_new] =
                task.marks[record.number].try_emplace(record.mark.position, &record);
            if (!is_new && end_of(record) < end_of(*found->second)) found->second = &record;
        }
    }

    static std::int64_t end_of(const RunRecord& mark) {
        return mark.begin_ns != 0 ? mark.begin_ns : mark.time_ns;
    }

    void cut(std::size_t task, const Segment& segment) {
        RunPiece piece;
        piece.task = task;
        const auto frame = frames_.find({of_task_[task].chain, segment.arrival_ns});
        if (frame != frames_.end()) piece.frame = frame->second;
        piece.begin_ns = segment.begin_ns;
        piece.first_launch = segment.first;
        const auto its_marks = of_task_[task].marks.find(segment.instance);
        if (its_marks != of_task_[task].marks.end()) {
            // A mark is of one segment: however many a file claims, each is looked at once.
            Marks& marks = its_marks->second;
            for (auto mark = marks.upper_bound(segment.first);
                 mark != marks.end() && mark->first <= segment.end; mark = marks.erase(mark)) {
                const RunRecord& record = *mark->second;
                piece.is_on_gpu_clock = record.begin_ns > piece.begin_ns;
                const std::int64_t end_ns =
                    piece.is_on_gpu_clock ? record.begin_ns : record.time_ns;
                // Of an instance whose number has come round, or a mark that says nothing new.
                if (end_ns <= piece.begin_ns) continue;
                piece.stream = record.stream != 0 ? record.stream : segment.stream;
                add(piece, segment.is_idle ? std::min(end_ns, segment.end_ns) : end_ns,
                    mark->first);
            }
        }
        piece.is_on_gpu_clock = false;
        piece.stream = segment.stream;
        if (segment.is_idle && segment.end > piece.first_launch && segment.end_ns > piece.begin_ns)
            add(piece, segment.end_ns, segment.end);
    }

    /// Its end is the next one's begin.
    void add(RunPiece& piece, std::int64_t end_ns, std::uint32_t end_launch) {
        if (end_ns <= piece.begin_ns) return;
        piece.end_ns = end_ns;
        piece.end_launch = end_launch;
        pieces_.push_back(piece);
        piece.begin_ns = end_ns;
        piece.first_launch = end_launch;
    }

    std::vector<OfTask> of_task_;
    std::map<std::pair<std::size_t, std::int64_t>, std::size_t> frames_;
    std::vector<RunPiece> pieces_;
};

}  // namespace

std::vector<RunPiece> gpu_pieces(const Run& run, const RunStory& story) {
    return Cutter(run, story).cut();
}

std::string launches_words(const RunPiece& piece) {
    if (piece.end_launch == piece.first_launch + 1)
        return fmt::format("launch {}", piece.first_launch);
    return fmt::format("launches {}..{}", piece.first_launch, piece.end_launch - 1);
}

}  // namespace urgengo::trace
