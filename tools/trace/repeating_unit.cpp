// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/repeating_unit.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "tools/trace/median.h"

namespace urgengo::trace {
namespace {

constexpr std::size_t kMaxPeriod = 512;
constexpr double kMinMatch = 0.9;
/// A shorter period is taken although a longer one matches better: with up to this many times the
/// mismatches, and this much more.
constexpr double kMismatchFactor = 2;
constexpr double kMismatchSlack = 0.005;
/// A period is the chain's if it is within this share of it.
constexpr double kPeriodTolerance = 0.25;
/// A unit may differ from the typical one in this share of its segments, though not in its first.
constexpr double kMaxUnitMismatch = 0.1;
/// Less than this off the CPU before a segment is scheduling noise.
constexpr std::int64_t kMinIdleNs = 20'000;
/// Gaps stand out if the shortest of them is this many times the longest other one.
constexpr double kGapRatio = 1.5;

using Types = std::vector<std::uint64_t>;

Types types_of(const UnitSequence& sequence, std::size_t level) {
    Types types;
    for (const UnitSegment& segment : sequence) types.push_back(segment.types[level]);
    return types;
}

/// The share of segments in the last two thirds that equal the one `lag` later. Where the lag fits
/// in several times, one mismatch is forgiven: the program's end may have cut a segment short.
double match_at(const std::vector<Types>& sequences, std::size_t lag) {
    std::size_t compared = 0, equal = 0;
    for (const Types& types : sequences) {
        for (std::size_t i = types.size() / 3; i + lag < types.size(); ++i) {
            ++compared;
            equal += types[i] == types[i + lag];
        }
    }
    if (compared < lag) return 0;
    if (compared >= 3 * lag && equal < compared) ++equal;
    return static_cast<double>(equal) / static_cast<double>(compared);
}

/// @returns whether the shorter lag matches itself as well as the longer one, give or take
bool as_good(double shorter, double longer) {
    return shorter >= kMinMatch && 1 - shorter <= (1 - longer) * kMismatchFactor + kMismatchSlack;
}

/// @returns the median time from a segment to the one `lag` later; 0 if there is none
std::int64_t spacing_ns(const std::vector<UnitSequence>& sequences, std::size_t lag) {
    std::vector<std::int64_t> spacings;
    for (const UnitSequence& sequence : sequences) {
        for (std::size_t i = sequence.size() / 3; i + lag < sequence.size(); ++i) {
            spacings.push_back(sequence[i + lag].begin_ns - sequence[i].begin_ns);
        }
    }
    return spacings.empty() ? 0 : median(std::move(spacings));
}

/// @param matches  of every lag
/// @returns the lag that matches, is no multiple of one that does, and takes about the chain's
///          period; 0 if there is none
std::size_t lag_of_period(const std::vector<UnitSequence>& sequences,
                          const std::vector<double>& matches, std::int64_t period_ns) {
    std::size_t closest = 0;
    double least = kPeriodTolerance;
    for (std::size_t lag = 1; lag < matches.size(); ++lag) {
        if (matches[lag] < kMinMatch) continue;
        bool multiple = false;
        for (std::size_t part = 1; part <= lag / 2 && !multiple; ++part) {
            multiple = lag % part == 0 && as_good(matches[part], matches[lag]);
        }
        if (multiple) continue;
        const double ratio =
            static_cast<double>(spacing_ns(sequences, lag)) / static_cast<double>(period_ns);
        if (std::abs(ratio - 1) < least) least = std::abs(ratio - 1), closest = lag;
    }
    return closest;
}

/// The lags that one level of types matches itself at.
struct Level {
    std::vector<Types> types;
    std::vector<double> matches;  ///< of every lag, from 0

    Level(const std::vector<UnitSequence>& sequences, std::size_t level) {
        std::size_t longest = 0;
        for (const UnitSequence& sequence : sequences) {
            types.push_back(types_of(sequence, level));
            longest = std::max(longest, sequence.size());
        }
        // The part compared must hold the unit twice.
        const std::size_t max_lag = std::min(kMaxPeriod, (longest - longest / 3) / 2);
        matches.resize(max_lag + 1);
        for (std::size_t lag = 1; lag <= max_lag; ++lag) matches[lag] = match_at(types, lag);
    }

    /// @returns the shortest lag that matches about as well as the best; 0 if none matches
    std::size_t shortest_lag() const {
        const double best = *std::max_element(matches.begin(), matches.end());
        for (std::size_t lag = 1; lag < matches.size(); ++lag) {
            if (as_good(matches[lag], best)) return lag;
        }
        return 0;
    }
};

/// @returns the unit, at whatever phase: from the longest stretch that repeats without a flaw
Types clean_unit(const std::vector<Types>& sequences, std::size_t lag) {
    Types unit;
    std::size_t longest = 0;
    for (const Types& types : sequences) {
        std::size_t length = 0;
        for (std::size_t i = types.size() / 3; i + lag < types.size(); ++i) {
            length = types[i] == types[i + lag] ? length + 1 : 0;
            if (length <= longest) continue;
            longest = length;
            const auto begin = types.begin() + static_cast<std::ptrdiff_t>(i + 1 - length);
            unit.assign(begin, begin + static_cast<std::ptrdiff_t>(lag));
        }
    }
    return unit;
}

bool stands_at(const Types& types, std::size_t at, const Types& unit) {
    if (at + unit.size() > types.size() || types[at] != unit[0]) return false;
    std::size_t allowed =
        static_cast<std::size_t>(kMaxUnitMismatch * static_cast<double>(unit.size()));
    for (std::size_t k = 1; k < unit.size(); ++k) {
        if (types[at + k] == unit[k]) continue;
        if (allowed-- == 0) return false;
    }
    return true;
}

std::vector<UnitSpan> scan(const Types& types, const Types& unit) {
    std::vector<UnitSpan> spans;
    for (std::size_t at = 0; at + unit.size() <= types.size();) {
        const bool found = stands_at(types, at, unit);
        if (found) spans.push_back({at, unit.size()});
        at += found ? unit.size() : 1;
    }
    return spans;
}

/// What the segments at one place of the unit have in common.
struct Place {
    std::vector<std::int64_t> idle_ns, gap_ns;
    std::size_t begins_task = 0;

    bool mostly_begins_task() const { return 2 * begins_task > idle_ns.size(); }
};

std::vector<Place> places(const std::vector<UnitSequence>& sequences, std::size_t level,
                          const Types& unit) {
    std::vector<Place> places(unit.size());
    for (const UnitSequence& sequence : sequences) {
        for (const UnitSpan& span : scan(types_of(sequence, level), unit)) {
            if (span.begin < sequence.size() / 3) continue;
            for (std::size_t k = 0; k < span.count; ++k) {
                const UnitSegment& segment = sequence[span.begin + k];
                places[k].idle_ns.push_back(segment.idle_ns);
                places[k].gap_ns.push_back(segment.gap_ns);
                places[k].begins_task += segment.begins_task;
            }
        }
    }
    return places;
}

/// @returns the place in the unit at which an instance begins
std::size_t find_phase(const std::vector<Place>& places) {
    const bool known = std::any_of(places.begin(), places.end(),
                                   [](const Place& place) { return place.mostly_begins_task(); });
    std::size_t idlest = 0, furthest = 0;
    std::int64_t most_idle_ns = -1, longest_gap_ns = -1;
    for (std::size_t k = 0; k < places.size(); ++k) {
        if (places[k].idle_ns.empty()) continue;
        if (known && !places[k].mostly_begins_task()) continue;
        const std::int64_t idle_ns = median(places[k].idle_ns);
        const std::int64_t gap_ns = median(places[k].gap_ns);
        if (idle_ns > most_idle_ns) most_idle_ns = idle_ns, idlest = k;
        if (gap_ns > longest_gap_ns) longest_gap_ns = gap_ns, furthest = k;
    }
    return most_idle_ns >= kMinIdleNs ? idlest : furthest;
}

}  // namespace

std::optional<RepeatingUnit> find_unit(const std::vector<UnitSequence>& sequences,
                                       std::int64_t period_ns) {
    std::vector<Level> levels;
    for (std::size_t level = 0; level < kTypeLevels; ++level) levels.emplace_back(sequences, level);
    const auto unit_of = [&](std::size_t level, std::size_t lag) -> std::optional<RepeatingUnit> {
        if (lag == 0) return std::nullopt;
        RepeatingUnit unit{level, clean_unit(levels[level].types, lag), levels[level].matches[lag]};
        if (unit.types.empty()) return std::nullopt;
        const std::size_t phase = find_phase(places(sequences, level, unit.types));
        std::rotate(unit.types.begin(), unit.types.begin() + static_cast<std::ptrdiff_t>(phase),
                    unit.types.end());
        return unit;
    };
    for (std::size_t level = 0; level < kTypeLevels && period_ns > 0; ++level) {
        const std::size_t lag = lag_of_period(sequences, levels[level].matches, period_ns);
        if (auto unit = unit_of(level, lag)) return unit;
    }
    for (std::size_t level = 0; level < kTypeLevels; ++level) {
        if (auto unit = unit_of(level, levels[level].shortest_lag())) return unit;
    }
    return std::nullopt;
}

std::vector<UnitSpan> find_spans(const UnitSequence& sequence, const RepeatingUnit& unit) {
    return scan(types_of(sequence, unit.level), unit.types);
}

std::vector<UnitSpan> find_bursts(const UnitSequence& sequence, std::int64_t period_ns) {
    if (sequence.size() < 2) return {};
    // The thread is either off the CPU between frames, or it polls: then only the wall knows.
    std::int64_t idle_ns = 0, gap_ns = 0;
    for (const UnitSegment& segment : sequence) {
        idle_ns += segment.idle_ns, gap_ns += segment.gap_ns;
    }
    const auto before = 2 * idle_ns >= gap_ns ? &UnitSegment::idle_ns : &UnitSegment::gap_ns;

    std::vector<std::int64_t> gaps;
    for (std::size_t i = 1; i < sequence.size(); ++i) gaps.push_back(sequence[i].*before);
    std::sort(gaps.rbegin(), gaps.rend());
    std::size_t fewest = 1, most = gaps.size();
    if (period_ns > 0) {
        const auto length = static_cast<double>(sequence.back().begin_ns - sequence[0].begin_ns);
        const double expected = length / static_cast<double>(period_ns);
        fewest = static_cast<std::size_t>(std::max(1.0, std::floor(expected / 2)));
        most = std::min(most, static_cast<std::size_t>(std::ceil(expected * 1.5)));
    }
    double best = 0;
    std::int64_t threshold_ns = 0;
    for (std::size_t count = fewest; count < most; ++count) {
        const auto shortest = static_cast<double>(gaps[count - 1]);
        const double ratio = shortest / static_cast<double>(std::max<std::int64_t>(gaps[count], 1));
        if (ratio > best) best = ratio, threshold_ns = gaps[count - 1];
    }
    if (best < kGapRatio || threshold_ns < kMinIdleNs) return {};

    std::vector<UnitSpan> spans{{0, 0}};
    for (std::size_t i = 0; i < sequence.size(); ++i) {
        if (i > 0 && sequence[i].*before >= threshold_ns) spans.push_back({i, 0});
        ++spans.back().count;
    }
    return spans;
}

std::int64_t median_spacing_ns(const UnitSequence& sequence, const std::vector<UnitSpan>& spans) {
    std::vector<std::int64_t> spacings;
    for (std::size_t i = 1; i < spans.size(); ++i) {
        spacings.push_back(sequence[spans[i].begin].begin_ns -
                           sequence[spans[i - 1].begin].begin_ns);
    }
    return spacings.empty() ? 0 : median(spacings);
}

}  // namespace urgengo::trace
