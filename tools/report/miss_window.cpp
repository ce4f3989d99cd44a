// SPDX-License-Identifier: Apache-2.0
#include "tools/report/miss_window.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "tools/trace/run_summary.h"

namespace urgengo::report {
namespace {

using Kind = trace::RunSlice::Kind;

BarKind kind_of(const trace::RunSlice& slice) {
    switch (slice.kind) {
        case Kind::kTask:
            return BarKind::kWork;
        case Kind::kSegment:
            return BarKind::kGpu;
        case Kind::kWait:
            return BarKind::kWait;
        case Kind::kHold:
            break;
    }
    if (slice.flags & abi::kRunGate) return BarKind::kGate;
    return slice.is_paced() ? BarKind::kPaced : BarKind::kHeld;
}

std::string words_of(const trace::Run& run, const trace::RunStory& story,
                     const trace::RunSlice& slice) {
    std::string words = slice.frame == trace::kNoFrame
                            ? run.chains[slice.chain].name
                            : trace::frame_name(run, story.frames[slice.frame]);
    switch (slice.kind) {
        case Kind::kTask:
            return words + ": works on it";
        case Kind::kWait:
            return words + ": waits for the GPU";
        case Kind::kSegment:
            words += ": GPU segment";
            if (slice.estimate_ns > 0)
                words += fmt::format(", by the plan {:.3f} ms", trace::to_ms(slice.estimate_ns));
            return words;
        case Kind::kHold:
            break;
    }
    words += ": " + trace::hold_words(run, slice);
    if (*trace::in_words(slice.why) != 0) words += std::string(", ") + trace::in_words(slice.why);
    return words;
}

}  // namespace

const char* in_words(BarKind kind) {
    switch (kind) {
        case BarKind::kWork:
            return "works";
        case BarKind::kGpu:
            return "GPU segment";
        case BarKind::kHeld:
            return "held";
        case BarKind::kPaced:
            return "paced";
        case BarKind::kGate:
            return "at a gate";
        case BarKind::kWait:
            return "waits for the GPU";
    }
    return "";
}

MissWindow miss_window(const trace::Run& run, const trace::RunStory& story, std::size_t index) {
    const trace::RunFrame& frame = story.frames[index];
    const std::int64_t deadline_ns = run.chains[frame.chain].deadline_ns;
    const std::int64_t end_ns = std::max(frame.end_ns, frame.arrival_ns + deadline_ns);
    const std::int64_t from_ns = frame.arrival_ns - deadline_ns / 3;
    const std::int64_t until_ns = end_ns + (end_ns - frame.arrival_ns) / 10;
    const auto at_ms = [&](std::int64_t ns) { return trace::to_ms(ns - frame.arrival_ns); };
    MissWindow window{
        at_ms(from_ns), at_ms(until_ns), trace::to_ms(deadline_ns), at_ms(frame.end_ns), {}, {}};
    // The frame's own tasks come first, then others as the config has them.
    std::map<std::pair<bool, std::size_t>, std::vector<const trace::RunSlice*>> by_task;
    for (const trace::RunSlice& slice : story.slices) {
        if (slice.begin_ns >= until_ns || slice.end_ns <= from_ns) continue;
        by_task[{slice.chain != frame.chain, slice.task}].push_back(&slice);
    }
    for (const auto& [place, slices] : by_task) {
        window.rows.push_back(trace::task_name(run, place.second));
        for (const trace::RunSlice* slice : slices)
            window.bars.push_back(
                {kind_of(*slice), window.rows.size() - 1, at_ms(std::max(slice->begin_ns, from_ns)),
                 at_ms(std::min(slice->end_ns, until_ns)), words_of(run, story, *slice)});
    }
    return window;
}

std::vector<std::size_t> choose_misses(const trace::Run& run, const trace::RunStory& story,
                                       std::size_t most) {
    std::vector<std::vector<std::size_t>> by_chain(run.chains.size());
    for (const std::size_t index : trace::late_frames(story))
        by_chain[story.frames[index].chain].push_back(index);
    for (auto& late : by_chain)
        std::stable_sort(late.begin(), late.end(), [&](std::size_t a, std::size_t b) {
            return story.frames[a].latency_ns > story.frames[b].latency_ns;
        });
    std::vector<std::size_t> chosen;
    for (std::size_t round = 0, found = 1; found > 0 && chosen.size() < most; ++round) {
        found = 0;
        for (const auto& late : by_chain) {
            if (round >= late.size() || chosen.size() == most) continue;
            chosen.push_back(late[round]);
            ++found;
        }
    }
    std::stable_sort(chosen.begin(), chosen.end(), [&](std::size_t a, std::size_t b) {
        return story.frames[a].arrival_ns < story.frames[b].arrival_ns;
    });
    return chosen;
}

}  // namespace urgengo::report
