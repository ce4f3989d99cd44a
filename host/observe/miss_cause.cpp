// SPDX-License-Identifier: Apache-2.0
#include "host/observe/miss_cause.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

namespace urgengo::observe {
namespace {

/// A cause takes at least this part of the lateness, and this much.
constexpr double kFairShare = 0.25;
constexpr nanoseconds kLeast{50'000};
/// A time that is far from the usual counts as this many times that, and this much more.
constexpr int kMostTimes = 4;
constexpr nanoseconds kMostMore{1'000'000};

/// A detail that is a time is in these units.
constexpr nanoseconds kUnit{10'000};

std::uint16_t saturated(double value) {
    constexpr double kMost = std::numeric_limits<std::uint16_t>::max();
    return static_cast<std::uint16_t>(std::clamp(value, 0.0, kMost));
}

std::uint16_t in_units(nanoseconds time) {
    return saturated(static_cast<double>(time.count()) / static_cast<double>(kUnit.count()));
}

std::uint16_t percent(nanoseconds longer, nanoseconds expected) {
    if (expected.count() <= 0) return 0;
    return saturated(100 + 100 * static_cast<double>(longer.count()) /
                               static_cast<double>(expected.count()));
}

nanoseconds part(nanoseconds time, double share) {
    return nanoseconds(static_cast<std::int64_t>(static_cast<double>(time.count()) * share));
}

/// The kind of what a chain took the most by.
MissCause kind_of(const LostTo& lost) {
    if (lost.by_urgent >= std::max(lost.by_kernel, lost.by_priority)) return MissCause::kShared;
    return lost.by_kernel >= lost.by_priority ? MissCause::kKernelInFront
                                              : MissCause::kPriorityLate;
}

}  // namespace

Cause cause_of(const FrameFacts& facts) {
    const nanoseconds late = facts.latency - facts.deadline;
    if (facts.exited)
        return {MissCause::kEndedEarly, -1, std::max(late, nanoseconds{0}),
                in_units(*facts.exited)};
    if (late.count() <= 0) return {};
    if (facts.was_off) return {MissCause::kOff, -1, late};

    Cause best{MissCause::kUnknown, -1, std::max(kLeast, part(late, kFairShare))};
    const auto consider = [&](MissCause kind, nanoseconds amount, int behind = -1) {
        if (amount > best.amount) best = {kind, std::max(behind, -1), amount};
    };
    consider(MissCause::kArrivedLate, facts.began_late);
    consider(MissCause::kCpuLonger, facts.cpu_longer);
    consider(MissCause::kOutside, facts.outside);
    consider(MissCause::kGpuLonger, facts.gpu_longer);
    if (best.kind == MissCause::kGpuLonger)
        best.detail = percent(facts.gpu_longer, facts.gpu_expected);
    const bool is_its_own = best.kind != MissCause::kUnknown;
    const Cause its_own = best;
    // Many that took a little each are a cause together, and told by the one that took most.
    nanoseconds to_others{0};
    for (const LostTo& lost : facts.lost_to) to_others += lost.held + lost.taken() + lost.waited;
    if (!is_its_own && to_others > best.amount) best.amount = kLeast;
    for (const LostTo& lost : facts.lost_to) {
        consider(MissCause::kWaited, lost.waited, lost.chain);
        consider(kind_of(lost), lost.taken(), lost.chain);
        consider(MissCause::kHeld, lost.held, lost.chain);
    }
    if (facts.given_up) {
        if (is_its_own) return its_own;
        const sched::GivenUp& why = *facts.given_up;
        const bool names_other = !why.itself && why.chain >= 0;
        return {why.itself ? MissCause::kGivenUpItself : MissCause::kGivenUp,
                names_other ? why.chain : best.behind, std::max(best.amount, late),
                in_units(why.short_by)};
    }
    if (best.kind == MissCause::kUnknown) best.amount = nanoseconds{0};
    return best;
}

const char* to_word(MissCause cause) {
    constexpr const char* kWords[kNumCauses] = {
        "none",          "unknown",         "off",         "arrived_late",
        "cpu_longer",    "gpu_longer",      "held",        "kernel_in_front",
        "shared",        "given_up",        "waited",      "dropped",
        "priority_late", "given_up_itself", "ended_early", "outside"};
    const auto index = static_cast<std::size_t>(cause);
    return index < kNumCauses ? kWords[index] : "unknown";
}

nanoseconds short_by(MissCause cause, std::uint16_t detail) {
    const bool is_time = cause == MissCause::kGivenUp || cause == MissCause::kGivenUpItself ||
                         cause == MissCause::kEndedEarly;
    return is_time ? detail * kUnit : nanoseconds{0};
}

double times_as_long(MissCause cause, std::uint16_t detail) {
    return cause == MissCause::kGpuLonger ? detail / 100.0 : 0;
}

std::string in_words(MissCause cause, const std::string& behind, std::uint16_t detail) {
    const std::string whom = behind.empty() ? "others" : behind;
    const double late_ms = 1e-6 * static_cast<double>(short_by(cause, detail).count());
    switch (cause) {
        case MissCause::kNone:
            return "in time";
        case MissCause::kOff:
            return "UrgenGo was off, or only observed";
        case MissCause::kArrivedLate:
            return "began late after its arrival";
        case MissCause::kCpuLonger:
            return "CPU longer than usual";
        case MissCause::kGpuLonger:
            return detail == 0 ? "GPU longer than profiled"
                               : fmt::format("GPU longer than profiled: {:.1f} times as long",
                                             times_as_long(cause, detail));
        case MissCause::kOutside:
            return "waited for something outside the GPU";
        case MissCause::kHeld:
            return "held behind " + whom;
        case MissCause::kKernelInFront:
            return "a kernel of " + whom + " was in front";
        case MissCause::kShared:
            return "the GPU worked for " + (behind.empty() ? "programs of no chain" : whom);
        case MissCause::kGivenUp:
            return (behind.empty() ? "given up" : "given up for " + whom) +
                   (detail == 0
                        ? ""
                        : fmt::format(", which else would have been late by {:.1f} ms", late_ms));
        case MissCause::kGivenUpItself:
            return std::string("given up") + (behind.empty() ? "" : " beside " + whom) +
                   (detail == 0
                        ? ", as its own time did not fit"
                        : fmt::format(", as its own time did not fit by {:.1f} ms", late_ms));
        case MissCause::kEndedEarly:
            return detail == 0 ? "ended early, as it could not be in time"
                               : fmt::format("ended early, as it lacked {:.1f} ms", late_ms);
        case MissCause::kWaited:
            return "waited for work of " + whom;
        case MissCause::kDropped:
            return "never came to its end";
        case MissCause::kPriorityLate:
            return "priority too low beside " + whom;
        case MissCause::kUnknown:
            break;
    }
    return "unknown";
}

nanoseconds Usual::saw(nanoseconds value) {
    if (!has_seen_) {
        has_seen_ = true;
        mean_ = value;
        return nanoseconds{0};
    }
    const nanoseconds longer = value - mean_;
    const nanoseconds most = kMostTimes * mean_ + kMostMore;
    mean_ += (std::min(value, most) - mean_) / 8;
    return std::max(longer, nanoseconds{0});
}

}  // namespace urgengo::observe
