// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/measure/instance_match.h"

#include <algorithm>

namespace urgengo::cli {
namespace {

using std::chrono::nanoseconds;

double to_us(nanoseconds time) {
    return std::chrono::duration<double, std::micro>(time).count();
}

template <typename Timed>
void sort_by_begin(std::vector<Timed>& list) {
    std::stable_sort(list.begin(), list.end(),
                     [](const Timed& a, const Timed& b) { return a.begin < b.begin; });
}

/// Leaves out the first frames, and the instances that begin before the first one left.
void skip(std::vector<TrueFrame>& frames, std::vector<DetectedInstance>& detected,
          std::size_t count) {
    if (count == 0) return;
    count = std::min(count, frames.size());
    frames.erase(frames.begin(), frames.begin() + static_cast<std::ptrdiff_t>(count));
    std::erase_if(detected, [&](const DetectedInstance& instance) {
        return frames.empty() || instance.begin < frames.front().begin - kMatchTolerance;
    });
}

bool begins_with(const DetectedInstance& instance, const TrueFrame& frame) {
    return instance.begin >= frame.begin - kMatchTolerance &&
           instance.begin <= frame.first_launched + kMatchTolerance;
}

/// Whether the instance covers more of the frame than readings of the clock can differ by.
bool covers(nanoseconds begin, nanoseconds end, const TrueFrame& frame) {
    return frame.begin + kMatchTolerance < end && begin < frame.end - kMatchTolerance;
}

void append(std::vector<double>& to, const std::vector<double>& from) {
    to.insert(to.end(), from.begin(), from.end());
}

}  // namespace

InstanceMatch& InstanceMatch::operator+=(const InstanceMatch& other) {
    frames += other.frames;
    detected += other.detected;
    false_starts += other.false_starts;
    missed_starts += other.missed_starts;
    merged += other.merged;
    observed += other.observed;
    resyncs += other.resyncs;
    append(begin_error_us, other.begin_error_us);
    append(end_error_us, other.end_error_us);
    append(arrival_error_us, other.arrival_error_us);
    return *this;
}

InstanceMatch match_instances(std::vector<TrueFrame> frames, std::vector<DetectedInstance> detected,
                              std::size_t skip_first) {
    sort_by_begin(frames);
    sort_by_begin(detected);
    skip(frames, detected, skip_first);

    InstanceMatch match;
    match.frames = frames.size();
    match.detected = detected.size();
    std::vector<bool> found(frames.size());
    std::size_t first = 0;  // of the frames that may still be covered
    for (std::size_t i = 0; i < detected.size(); i++) {
        const DetectedInstance& instance = detected[i];
        match.observed += instance.observed;
        match.resyncs += instance.resync;
        nanoseconds end = instance.end.value_or(nanoseconds::max());
        if (i + 1 < detected.size()) end = std::min(end, detected[i + 1].begin);

        while (first < frames.size() && frames[first].end < instance.begin) first++;
        std::optional<std::size_t> begun;
        std::size_t covered = 0;
        for (std::size_t f = first; f < frames.size(); f++) {
            if (frames[f].begin - kMatchTolerance > std::max(instance.begin, end)) break;
            if (!begun && !found[f] && begins_with(instance, frames[f])) begun = f;
            covered += covers(instance.begin, end, frames[f]);
        }
        match.false_starts += !begun;
        match.merged += covered > 1;
        if (!begun) continue;
        found[*begun] = true;
        if (covered > 1) continue;
        const TrueFrame& frame = frames[*begun];
        match.begin_error_us.push_back(to_us(instance.begin - frame.begin));
        match.arrival_error_us.push_back(to_us(instance.arrival - frame.arrival));
        if (instance.end) match.end_error_us.push_back(to_us(*instance.end - frame.end));
    }
    match.missed_starts = static_cast<std::uint64_t>(std::count(found.begin(), found.end(), false));
    return match;
}

}  // namespace urgengo::cli
