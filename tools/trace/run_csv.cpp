// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <optional>

#include "host/observe/miss_cause.h"
#include "tools/trace/csv_field.h"
#include "tools/trace/run_export.h"
#include "tools/trace/run_pieces.h"

namespace urgengo::trace {
namespace {

struct Line {
    std::int64_t begin_ns;
    std::string text;
};

const char* kind_of(const RunSlice& slice) {
    switch (slice.kind) {
        case RunSlice::Kind::kTask:
            return "task";
        case RunSlice::Kind::kSegment:
            return "gpu_segment";
        case RunSlice::Kind::kWait:
            return "wait";
        case RunSlice::Kind::kHold:
            break;
    }
    return slice.is_paced() ? "paced" : (slice.flags & abi::kRunGate) ? "gate" : "held";
}

}  // namespace

std::string to_csv(const Run& run, const RunStory& story) {
    std::vector<Line> lines;
    const auto number = [](std::uint32_t n) { return n == 0 ? "" : std::to_string(n); };
    const auto chain = [&](int index) {
        return index < 0 ? "" : csv_field(run.chains[static_cast<std::size_t>(index)].name);
    };
    const auto task = [&](int index) {
        return index < 0 ? "" : csv_field(run.tasks[static_cast<std::size_t>(index)].name);
    };
    for (const RunFrame& frame : story.frames)
        lines.push_back(
            {frame.arrival_ns,
             fmt::format("frame,{},{},,,{},{},{},{},{},,\n", chain(static_cast<int>(frame.chain)),
                         number(frame.number), frame.arrival_ns,
                         frame.has_ended ? std::to_string(frame.end_ns) : "",
                         frame.is_late() ? observe::to_word(frame.cause) : "", chain(frame.behind),
                         frame.is_late() ? std::to_string(frame.amount_ns) : "")});
    for (const RunSlice& slice : story.slices) {
        const std::uint32_t of = slice.frame == kNoFrame ? 0 : story.frames[slice.frame].number;
        lines.push_back(
            {slice.begin_ns,
             fmt::format(
                 "{},{},{},{},{},{},{},{},{},,{},\n", kind_of(slice),
                 chain(static_cast<int>(slice.chain)), number(of),
                 task(static_cast<int>(slice.task)), slice.thread, slice.begin_ns,
                 slice.is_open ? "" : std::to_string(slice.end_ns), csv_field(in_words(slice.why)),
                 chain(slice.behind_chain),
                 slice.kind == RunSlice::Kind::kSegment ? std::to_string(slice.estimate_ns) : "")});
    }
    for (const RunPiece& piece : gpu_pieces(run, story)) {
        const std::uint32_t of = piece.frame == kNoFrame ? 0 : story.frames[piece.frame].number;
        lines.push_back(
            {piece.begin_ns,
             fmt::format("gpu_launches,{},{},{},,{},{},,,,{}-{},{}\n",
                         chain(static_cast<int>(run.tasks[piece.task].chain)), number(of),
                         task(static_cast<int>(piece.task)), piece.begin_ns, piece.end_ns,
                         piece.first_launch, piece.end_launch - 1, number(piece.stream))});
    }
    for (const RunRecord& point : story.points) {
        const char* kind = "";
        std::string value;
        std::int64_t at = point.time_ns;
        std::optional<std::int64_t> end;
        if (point.kind == RunKind::kMark) {
            kind = "executed";
            value = std::to_string(point.mark.position);
            if (point.begin_ns != 0) at = point.begin_ns;
        } else if (point.kind == RunKind::kPriority) {
            kind = "priority";
            value = std::to_string(point.priority.now);
        } else if (point.kind == RunKind::kMode) {
            kind = "mode";
            value = std::to_string(static_cast<std::uint32_t>(point.mode));
        } else if (point.kind == RunKind::kCpuUse) {
            kind = "cpu_time";
            value = std::to_string(point.cpu.used_ns);
        } else if (point.kind == RunKind::kChainMode) {
            kind = "chain_mode";
            value = std::to_string(static_cast<std::uint32_t>(point.mode));
        } else if (point.kind == RunKind::kGuard) {
            kind = "guard";
            value = std::to_string(point.way);
        } else if (point.kind == RunKind::kClock) {
            kind = "gpu_clock";
            value = std::to_string(point.clock.gpu_ns);
            at = point.clock.host_ns;
        } else if (point.kind == RunKind::kPark || point.kind == RunKind::kRound) {
            const bool is_park = point.kind == RunKind::kPark;
            kind = is_park ? "park" : (point.flags & abi::kRunByGpu) ? "gpu_rounds" : "round";
            value = std::to_string(is_park ? point.park.gated : point.round.opened);
            at = point.begin_ns;
            end = point.time_ns;
        } else {
            kind = point.kind == RunKind::kTrip     ? "trip"
                   : point.kind == RunKind::kReload ? "reload"
                                                    : "frame_dropped";
        }
        lines.push_back({at, fmt::format("{},{},,{},{},{},{},,,,{},{}\n", kind, chain(point.chain),
                                         task(point.task), point.thread, at, end.value_or(at),
                                         value, number(point.stream))});
    }
    std::stable_sort(lines.begin(), lines.end(),
                     [](const Line& a, const Line& b) { return a.begin_ns < b.begin_ns; });
    std::string csv =
        "kind,chain,frame,task,thread,begin_ns,end_ns,why,behind,cause_ns,value,stream\n";
    for (const Line& line : lines) csv += line.text;
    return csv;
}

}  // namespace urgengo::trace
