// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/kernel_times.h"

#include <algorithm>

namespace urgengo::trace {
/// The utilisation changes by this much at this time.
struct Contention::Change {
    std::int64_t time_ns;
    double by;
};

Contention::Integral Contention::integrate(std::vector<Change> changes) {
    std::sort(changes.begin(), changes.end(),
              [](const Change& a, const Change& b) { return a.time_ns < b.time_ns; });
    Integral integral;
    double busy_ns = 0, slope = 0;
    for (const Change& change : changes) {
        if (!integral.times_ns.empty()) {
            busy_ns += slope * static_cast<double>(change.time_ns - integral.times_ns.back());
        }
        slope += change.by;
        integral.times_ns.push_back(change.time_ns);
        integral.busy_ns.push_back(busy_ns);
        integral.slopes.push_back(slope);
    }
    return integral;
}

double Contention::Integral::until(std::int64_t time_ns) const {
    const auto after = std::upper_bound(times_ns.begin(), times_ns.end(), time_ns);
    if (after == times_ns.begin()) return 0;
    const auto i = static_cast<std::size_t>(after - times_ns.begin()) - 1;
    return busy_ns[i] + slopes[i] * static_cast<double>(time_ns - times_ns[i]);
}

Contention::Contention(const std::vector<std::vector<GpuInterval>>& intervals) {
    std::vector<Change> all;
    for (const auto& launches : intervals) {
        std::vector<Change> changes;
        for (const GpuInterval& interval : launches) {
            if (!interval.known) continue;
            const double utilization = interval.launch ? utilization_of(*interval.launch) : 1;
            changes.push_back({interval.begin_ns, utilization});
            changes.push_back({interval.end_ns, -utilization});
        }
        all.insert(all.end(), changes.begin(), changes.end());
        threads_.push_back(integrate(std::move(changes)));
    }
    all_ = integrate(std::move(all));
}

double Contention::of(std::size_t thread, const GpuInterval& interval) const {
    if (interval.length_ns() <= 0) return 0;
    const auto busy_ns = [&interval](const Integral& integral) {
        return integral.until(interval.end_ns) - integral.until(interval.begin_ns);
    };
    const double others_ns = busy_ns(all_) - busy_ns(threads_[thread]);
    return std::max(0.0, others_ns / static_cast<double>(interval.length_ns()));
}

OwnTime own_time(std::vector<KernelSample> samples) {
    if (samples.empty()) return {};
    OwnTime own;
    own.clean = static_cast<std::uint32_t>(std::count_if(
        samples.begin(), samples.end(),
        [](const KernelSample& sample) { return sample.contention <= kCleanContention; }));
    // A part of an interval is a guess, so those count only if there is too little else.
    const auto guesses = std::stable_partition(samples.begin(), samples.end(),
                                               [](const auto& sample) { return !sample.shared; });
    if (static_cast<std::size_t>(guesses - samples.begin()) >= kMinCleanSamples) {
        samples.erase(guesses, samples.end());
    }
    std::stable_sort(samples.begin(), samples.end(),
                     [](const auto& a, const auto& b) { return a.contention < b.contention; });
    const auto contended = std::find_if(samples.begin(), samples.end(), [](const auto& sample) {
        return sample.contention > kCleanContention;
    });
    auto count = static_cast<std::size_t>(contended - samples.begin());
    const bool clean = count >= kMinCleanSamples;
    if (!clean) count = std::min(samples.size(), std::max(kMinCleanSamples, samples.size() / 4));
    std::vector<std::int64_t> lengths;
    for (std::size_t i = 0; i < count; ++i) lengths.push_back(samples[i].length_ns);
    std::sort(lengths.begin(), lengths.end());
    own.ns = lengths[(count - 1) / (clean ? 2 : 4)];
    own.samples = static_cast<std::uint32_t>(count);
    return own;
}

}  // namespace urgengo::trace
