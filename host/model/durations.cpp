// SPDX-License-Identifier: Apache-2.0
#include "host/model/durations.h"

#include <algorithm>

#include "host/model/gpu_clock.h"
#include "host/model/position.h"

namespace urgengo::model {
namespace {

/// Estimates may be too long by this much and a late launch is still noticed.
constexpr double kLateMargin = 0.5;
/// A span that begins with a launch, not a stamp, is as long as it seems if what is not known of
/// its begin is so many times shorter.
constexpr int kTrusted = 8;

double to_double(nanoseconds t) {
    return static_cast<double>(t.count());
}

}  // namespace

std::optional<MeasuredSpan> span_between(const LaunchLog& log, const StampedMark& from,
                                         const StampedMark& to, nanoseconds mark_cost,
                                         bool shared) {
    const std::uint32_t first = log.launches_before_mark(from.sequence);
    const std::uint32_t end = log.launches_before_mark(to.sequence);
    if (first == end) return std::nullopt;
    // A mark's stamp is its begin: `from` and those between took their time after that.
    const std::uint32_t num_marks = to.sequence - from.sequence;
    MeasuredSpan span{first, end,
                      nanoseconds(stamp_difference(to.stamp, from.stamp)) - mark_cost * num_marks,
                      shared, false};
    nanoseconds begin = from.time;
    if (const nanoseconds earliest = log.time(first) + kLaunchLatency; earliest > from.time) {
        // The GPU was done with all before, and waited for this launch.
        begin = earliest;
        const nanoseconds from_launch = to.time - earliest - mark_cost * (num_marks - 1);
        span.late = from_launch < kTrusted * (to.error + kLaunchLatency);
        if (!span.late) span.measured = from_launch;
    }
    if (span.measured.count() <= 0) return std::nullopt;
    const nanoseconds work = log.end(first - 1);
    for (std::uint32_t n = first + 1; n != end && !span.late; ++n) {
        const nanoseconds ahead(
            static_cast<std::int64_t>(kLateMargin * to_double(log.end(n - 1) - work)));
        span.late = log.time(n) + kLaunchLatency > begin + ahead;
    }
    if (!log.still_holds(first - 1, from.sequence)) return std::nullopt;
    return span;
}

Durations::Durations(std::span<const Planned> profile)
    : places_(std::min(profile.size(), kMaxPositions)),
      kernels_(kMaxKernels),
      num_profiled_(places_.size()) {
    for (std::size_t i = 0; i < places_.size(); ++i) {
        Place& place = places_[i];
        place.estimate.kernel = profile[i].kernel;
        place.estimate.ns = place.profiled_ns = to_double(profile[i].gpu_time);
        place.estimate.samples = 1;
        place.estimate.instances = kYoung;
    }
    sum_up(places_.size());
}

std::optional<nanoseconds> Durations::find(std::uint32_t position, std::uint64_t kernel) const {
    const Estimate* known = nullptr;
    if (position < places_.size() && places_[position].estimate.kernel == kernel)
        known = &places_[position].estimate;
    if (!known || known->samples == 0) known = find_kernel(kernel);
    if (!known || known->samples == 0) return std::nullopt;
    return nanoseconds(static_cast<std::int64_t>(known->ns));
}

const Durations::Estimate* Durations::find_kernel(std::uint64_t kernel) const {
    for (std::size_t i = 0; i < kMaxKernels; ++i) {
        const Estimate& e = kernels_[(kernel + i) % kMaxKernels];
        if (e.kernel == kernel) return &e;
        if (e.kernel == 0) return nullptr;
    }
    return nullptr;
}

// A table that is three quarters full takes no more: looking for what is not there stays short.
Durations::Estimate* Durations::kernel_slot(std::uint64_t kernel, bool add) {
    for (std::size_t i = 0; i < kMaxKernels; ++i) {
        Estimate& e = kernels_[(kernel + i) % kMaxKernels];
        if (e.kernel == kernel) return &e;
        if (e.kernel != 0) continue;
        if (!add || num_kernels_ >= kMaxKernels / 4 * 3) return nullptr;
        ++num_kernels_;
        e.kernel = kernel;
        return &e;
    }
    return nullptr;
}

Durations::Place* Durations::place_of(const LoggedLaunch& launch) {
    if (launch.position >= places_.size()) return nullptr;
    Place& place = places_[launch.position];
    if (place.estimate.kernel == launch.kernel) {
        place.strangers = 0;
        return &place;
    }
    if (place.estimate.kernel != 0) {
        if (place.stranger != launch.kernel) place.strangers = 0;
        place.stranger = launch.kernel;
        if (++place.strangers < kMaxStrangers) return nullptr;
    }
    place = Place{};
    place.estimate.kernel = launch.kernel;
    return &place;
}

void Durations::learn(Estimate& e, double sample_ns, bool is_own) {
    if (e.last_span == span_) return;  // several in one span have the same to say
    e.last_span = span_;
    // An upper bound is better than nothing, and gives way to the first measurement.
    if (e.samples == 0 || (e.is_bound && is_own)) {
        e.ns = e.ns_at_begin = sample_ns;
        e.instance = instance_;
        e.instances = e.samples = 1;
        e.is_bound = !is_own;
        return;
    }
    if (e.instance != instance_) {
        e.instance = instance_;
        e.ns_at_begin = e.ns;
        ++e.instances;
    }
    const double gain = is_own ? std::max(kGain, 1.0 / (e.samples + 1)) : kGain;
    const double most = e.instances <= kYoung ? kMaxChangeYoung : kMaxChange;
    const double wanted_ns = e.ns + gain * (sample_ns - e.ns);
    e.ns = std::clamp(wanted_ns, e.ns_at_begin / most, e.ns_at_begin * most);
    // What was held back has not been averaged in: the next samples weigh as much.
    if (is_own && e.ns == wanted_ns) ++e.samples;
}

void Durations::observe(const LaunchLog& log, const MeasuredSpan& span) {
    const double estimated = to_double(log.end(span.end - 1) - log.end(span.first - 1));
    if (span.first == span.end || estimated <= 0) return;
    const double measured = to_double(span.measured);
    const double ratio = measured / estimated;
    const bool tells = span.is_own() || ratio * kBoundMargin < 1;
    ++span_;
    double profiled = 0;
    bool all_profiled = span.is_own();
    nanoseconds begin = log.end(span.first - 1);
    for (std::uint32_t n = span.first; n != span.end; ++n) {
        const LoggedLaunch launch = log.at(n);
        const double sample_ns = ratio * to_double(launch.end - begin);
        begin = launch.end;
        Place* place = place_of(launch);
        if (place && place->profiled_ns > 0)
            profiled += place->profiled_ns;
        else
            all_profiled = false;
        if (place && (tells || place->estimate.samples == 0))
            learn(place->estimate, sample_ns, span.is_own());
        if (Estimate* e = kernel_slot(launch.kernel, true); e && (tells || e->samples == 0))
            learn(*e, sample_ns, span.is_own());
    }
    if (all_profiled) {
        measured_ns_ += measured;
        profiled_ns_ += profiled;
    }
}

void Durations::end_instance(std::uint32_t num_launches) {
    judge_profile();
    const std::size_t wanted = std::min<std::size_t>(num_launches, kMaxPositions);
    if (wanted > places_.size()) places_.resize(wanted);
    sum_up(num_profiled_ > 0 ? num_profiled_ : wanted);
    ++instance_;
}

void Durations::judge_profile() {
    if (profiled_ns_ > 0) {
        const double ratio = measured_ns_ / profiled_ns_;
        const int side = ratio > kMisfitRatio ? 1 : ratio * kMisfitRatio < 1 ? -1 : 0;
        fit_.ratio = ratio;
        fit_.instances = side == 0 ? 0 : side == side_ ? fit_.instances + 1 : 1;
        fit_.fits = fit_.instances < kMisfitInstances;
        side_ = side;
    }
    measured_ns_ = profiled_ns_ = 0;
}

// A position that was never measured counts nothing; its kernel may tell more when it comes.
void Durations::sum_up(std::size_t num_launches) {
    remaining_.resize(num_launches);
    double remaining = 0;
    for (std::size_t i = num_launches; i-- > 0;) {
        remaining += places_[i].estimate.ns;
        remaining_[i] = nanoseconds(static_cast<std::int64_t>(remaining));
    }
}

}  // namespace urgengo::model
