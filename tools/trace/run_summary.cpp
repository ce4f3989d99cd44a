// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/run_summary.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <ctime>
#include <limits>

namespace urgengo::trace {
namespace {

using Kind = RunSlice::Kind;

std::string ms(std::int64_t ns) {
    return fmt::format("{:.3f} ms", to_ms(ns));
}

/// Each is a time that can be; sums of what a broken file tells may be none.
void add(std::int64_t& sum, std::int64_t time) {
    if (__builtin_add_overflow(sum, time, &sum)) sum = std::numeric_limits<std::int64_t>::max();
}

/// Holds of a task that follow each other, for the same reason.
bool go_together(const RunSlice& a, const RunSlice& b) {
    return a.kind == Kind::kHold && b.kind == Kind::kHold && a.task == b.task && a.why == b.why &&
           a.behind_task == b.behind_task && a.flags == b.flags;
}

std::string words_of(const Run& run, const RunSlice& slice, std::size_t count,
                     std::int64_t length_ns) {
    std::string words;
    switch (slice.kind) {
        case Kind::kTask:
            words =
                run.tasks[slice.task].name + " works on it, thread " + std::to_string(slice.thread);
            if (const auto found = run.threads.find(slice.thread); found != run.threads.end())
                words += " (" + found->second + ")";
            if (slice.flags & abi::kRunObserved) words += "; it is not scheduled";
            break;
        case Kind::kSegment:
            words = "GPU segment, " + ms(length_ns);
            if (slice.estimate_ns > 0) words += ", by the plan " + ms(slice.estimate_ns);
            break;
        case Kind::kWait:
            words = "waits for the GPU, " + ms(length_ns);
            break;
        case Kind::kHold:
            words = hold_words(run, slice) + ", " + ms(length_ns);
            if (count > 1) words += fmt::format(" in {} pieces", count);
            if (*in_words(slice.why) != 0) words += std::string(": ") + in_words(slice.why);
            break;
    }
    if (slice.is_open) words += "; its end is not recorded";
    return words;
}

std::vector<TimeOfChain> longest_first(const std::map<std::size_t, std::int64_t>& by_chain) {
    std::vector<TimeOfChain> all;
    for (const auto& [chain, time] : by_chain) all.push_back({chain, time});
    std::stable_sort(all.begin(), all.end(),
                     [](const auto& a, const auto& b) { return a.time_ns > b.time_ns; });
    return all;
}

std::int64_t percentile(const std::vector<std::int64_t>& sorted, double share) {
    if (sorted.empty()) return 0;
    const auto at = static_cast<std::size_t>(share * static_cast<double>(sorted.size()));
    return sorted[std::min(at, sorted.size() - 1)];
}

}  // namespace

std::vector<ChainSummary> summarize(const Run& run, const RunStory& story) {
    std::vector<ChainSummary> all(run.chains.size());
    std::vector<std::vector<std::int64_t>> latencies(run.chains.size());
    std::vector<std::map<std::pair<abi::MissCause, int>, std::uint64_t>> causes(run.chains.size());
    for (std::size_t c = 0; c < all.size(); ++c) {
        all[c].name = run.chains[c].name;
        all[c].deadline_ns = run.chains[c].deadline_ns;
    }
    for (const RunFrame& frame : story.frames) {
        ChainSummary& chain = all[frame.chain];
        ++chain.frames;
        if (!frame.has_ended) continue;
        ++chain.ended;
        chain.exited += frame.exited;
        if (!frame.exited) latencies[frame.chain].push_back(frame.latency_ns);
        if (!frame.is_late()) continue;
        ++chain.late;
        ++causes[frame.chain][{frame.cause, frame.behind}];
    }
    for (const RunSlice& slice : story.slices) {
        if (slice.kind != Kind::kHold) continue;
        ChainSummary& chain = all[slice.chain];
        chain.holds += !slice.is_paced();
        add(slice.is_paced() ? chain.paced_ns : chain.held_ns, slice.length_ns());
    }
    for (const RunRecord& point : story.points)
        if (point.kind == RunKind::kFrameDropped)
            ++all[static_cast<std::size_t>(point.chain)].dropped;
    for (std::size_t c = 0; c < all.size(); ++c) {
        std::sort(latencies[c].begin(), latencies[c].end());
        all[c].median_ns = percentile(latencies[c], 0.5);
        all[c].p99_ns = percentile(latencies[c], 0.99);
        all[c].max_ns = percentile(latencies[c], 1);
        for (const auto& [cause, count] : causes[c])
            all[c].causes.push_back({cause.first, chain_name(run, cause.second), count});
        std::stable_sort(all[c].causes.begin(), all[c].causes.end(),
                         [](const auto& a, const auto& b) { return a.count > b.count; });
    }
    return all;
}

GateSummary summarize_gates(const RunStory& story) {
    GateSummary gates;
    for (const RunRecord& point : story.points) {
        if (point.kind == RunKind::kPark) {
            const std::int64_t parked = point.time_ns - point.begin_ns;
            ++gates.parks;
            gates.refused += point.park.refused;
            add(gates.parked_ns, parked);
            gates.most_parked_ns = std::max(gates.most_parked_ns, parked);
            gates.most_opening_ns = std::max(gates.most_opening_ns, point.park.opening_ns);
        } else if (point.kind == RunKind::kRound && (point.flags & abi::kRunByGpu)) {
            gates.openings_by_gpu += point.round.opened;
            gates.gpu_rounds += point.round.rounds;
            add(gates.gpu_rounds_ns, point.round.took_ns);
        } else if (point.kind == RunKind::kRound) {
            ++gates.host_rounds;
            gates.opened_by_host += point.round.opened;
        }
    }
    return gates;
}

std::string gates_words(const GateSummary& gates) {
    std::string words;
    const auto say = [&](const std::string& what) { words += (words.empty() ? "" : "; ") + what; };
    if (gates.host_rounds > 0)
        say(fmt::format("{} rounds of the host opened {} gates", gates.host_rounds,
                        gates.opened_by_host));
    if (gates.openings_by_gpu > 0)
        say(fmt::format("the GPU opened some {} times, in {} rounds of {:.1f} us",
                        gates.openings_by_gpu, gates.gpu_rounds,
                        gates.gpu_rounds == 0 ? 0.0
                                              : 1e-3 * static_cast<double>(gates.gpu_rounds_ns) /
                                                    static_cast<double>(gates.gpu_rounds)));
    if (gates.parks > 0)
        say(
            fmt::format("no gate was closed in {} parks, {} in all, {} at most, of which opening "
                        "took {} at most; {} launches waited in their threads then",
                        gates.parks, ms(gates.parked_ns), ms(gates.most_parked_ns),
                        ms(gates.most_opening_ns), gates.refused));
    return words;
}

std::string most_often(const ChainSummary& chain) {
    if (chain.causes.empty()) return {};
    const observe::CauseCount& first = chain.causes[0];
    return fmt::format("{} x {}", first.count, observe::in_words(first.cause, first.behind));
}

std::string date_of(const Run& run, std::int64_t ns) {
    const std::int64_t real = run.begin_realtime_ns + (ns - run.begin_ns);
    const auto seconds = static_cast<std::time_t>(real / 1'000'000'000);
    std::tm utc{};
    if (real < 0 || !gmtime_r(&seconds, &utc)) return "?";
    return fmt::format("{:%Y-%m-%d %H:%M:%S} UTC", utc);
}

std::vector<std::size_t> late_frames(const RunStory& story) {
    std::vector<std::size_t> late;
    for (std::size_t i = 0; i < story.frames.size(); ++i)
        if (story.frames[i].is_late()) late.push_back(i);
    std::stable_sort(late.begin(), late.end(), [&](std::size_t a, std::size_t b) {
        return story.frames[a].end_ns < story.frames[b].end_ns;
    });
    return late;
}

std::string outcome_words(const Run& run, const RunFrame& frame) {
    if (!frame.has_ended) return "its end is not recorded";
    if (!frame.is_late()) return "in time";
    const std::int64_t late = frame.latency_ns - run.chains[frame.chain].deadline_ns;
    std::string words =
        observe::in_words(frame.cause, chain_name(run, frame.behind), frame.cause_detail);
    const bool says_so = frame.exited && frame.cause == abi::MissCause::kEndedEarly;
    if (!says_so) words = (frame.exited ? "ended early: " : "late by " + ms(late) + ": ") + words;
    if (frame.amount_ns > 0 && !says_so) words += " (" + ms(frame.amount_ns) + ")";
    return words;
}

std::vector<StoryLine> frame_story(const Run& run, const RunStory& story, std::size_t index) {
    const RunFrame& frame = story.frames[index];
    std::vector<const RunSlice*> slices;
    for (const RunSlice& slice : story.slices)
        if (slice.frame == index) slices.push_back(&slice);
    // What contains the others comes first.
    std::stable_sort(slices.begin(), slices.end(), [](const RunSlice* a, const RunSlice* b) {
        return a->begin_ns != b->begin_ns ? a->begin_ns < b->begin_ns : a->kind < b->kind;
    });
    std::vector<StoryLine> lines;
    const auto at = [&](std::int64_t ns) { return ns - frame.arrival_ns; };
    lines.push_back({0, 0, 0, "arrived"});
    if (frame.begin_ns > frame.arrival_ns + 1'000'000)
        lines.push_back({at(frame.begin_ns), at(frame.begin_ns), 0, "was seen"});
    for (std::size_t i = 0; i < slices.size();) {
        const RunSlice& first = *slices[i];
        std::size_t count = 0;
        std::int64_t length = 0, end = first.end_ns;
        do {
            add(length, slices[i]->length_ns());
            end = std::max(end, slices[i]->end_ns);
            ++count, ++i;
        } while (i < slices.size() && go_together(first, *slices[i]));
        const int depth = first.kind == Kind::kTask ? 0 : first.kind == Kind::kSegment ? 1 : 2;
        lines.push_back({at(first.begin_ns), at(end), depth, words_of(run, first, count, length)});
    }
    if (frame.has_ended)
        lines.push_back({at(frame.end_ns), at(frame.end_ns), 0,
                         frame.exited ? "was ended early" : "came to its end"});
    return lines;
}

std::vector<TimeOfChain> held_behind(const RunStory& story, std::size_t index) {
    std::map<std::size_t, std::int64_t> by_chain;
    for (const RunSlice& slice : story.slices)
        if (slice.kind == Kind::kHold && slice.frame == index && slice.behind_chain >= 0 &&
            !slice.is_paced())
            add(by_chain[static_cast<std::size_t>(slice.behind_chain)], slice.length_ns());
    return longest_first(by_chain);
}

std::vector<TimeOfChain> meanwhile(const RunStory& story, std::size_t index) {
    std::vector<const RunSlice*> own;
    for (const RunSlice& slice : story.slices)
        if (slice.kind == Kind::kSegment && slice.frame == index) own.push_back(&slice);
    std::map<std::size_t, std::int64_t> by_chain;
    const std::size_t chain = story.frames[index].chain;
    for (const RunSlice& other : story.slices) {
        if (other.kind != Kind::kSegment || other.chain == chain) continue;
        for (const RunSlice* mine : own) {
            const std::int64_t both =
                std::min(other.end_ns, mine->end_ns) - std::max(other.begin_ns, mine->begin_ns);
            if (both > 0) add(by_chain[other.chain], both);
        }
    }
    return longest_first(by_chain);
}

}  // namespace urgengo::trace
