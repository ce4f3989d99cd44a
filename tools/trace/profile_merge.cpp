// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/profile_merge.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <string>
#include <tuple>

#include "tools/trace/kernel_set.h"

namespace urgengo::trace {
namespace {

using config::ChainProfile;
using config::KernelProfile;
using config::Profile;
using config::SegmentProfile;
using config::TaskProfile;
using std::chrono::nanoseconds;
using Names = std::set<std::string>;

/// @returns a name in `of` that `in` lacks; "" if it lacks none
std::string lacking(const Names& of, const Names& in) {
    const auto it = std::find_if(of.begin(), of.end(),
                                 [&in](const std::string& name) { return in.count(name) == 0; });
    return it == of.end() ? "" : *it;
}

/// @returns why the two are not of the same program on the same GPU; "" if they are
std::string why_not(const Profile& older, const Profile& newer) {
    const auto differ = [](const std::string& what, const auto& found, const auto& accepted) {
        return fmt::format("another {}: found {}, accepted: {}", what, found, accepted);
    };
    // What one of the two does not know is not compared.
    if (!older.program.empty() && !newer.program.empty() && older.program != newer.program) {
        return differ("program", newer.program, older.program);
    }
    if (older.gpu != newer.gpu) return differ("GPU", newer.gpu, older.gpu);
    const auto clock_differs = [](std::uint32_t a, std::uint32_t b) {
        return a != 0 && b != 0 && a != b;
    };
    if (clock_differs(older.sm_clock_mhz, newer.sm_clock_mhz)) {
        return differ("SM clock (MHz)", newer.sm_clock_mhz, older.sm_clock_mhz);
    }
    if (clock_differs(older.memory_clock_mhz, newer.memory_clock_mhz)) {
        return differ("memory clock (MHz)", newer.memory_clock_mhz, older.memory_clock_mhz);
    }
    const Names old_names = kernel_names(older), new_names = kernel_names(newer);
    const std::string only_old = lacking(old_names, new_names);
    const std::string only_new = lacking(new_names, old_names);
    if (!only_old.empty() && !only_new.empty()) {
        return fmt::format(
            "another set of kernels: found '{}', which the older profile lacks, and no '{}', which "
            "it has",
            only_new, only_old);
    }
    return {};
}

double mean(double a, double weight_a, double b, double weight_b) {
    const double weight = weight_a + weight_b;
    return weight == 0 ? (a + b) / 2 : (a * weight_a + b * weight_b) / weight;
}

nanoseconds mean(nanoseconds a, double weight_a, nanoseconds b, double weight_b) {
    return nanoseconds{static_cast<std::int64_t>(
        mean(static_cast<double>(a.count()), weight_a, static_cast<double>(b.count()), weight_b))};
}

/// Where one of the two does not know it, it is the other's.
nanoseconds mean_if_known(nanoseconds a, double weight_a, nanoseconds b, double weight_b) {
    if (a == nanoseconds{0}) return b;
    if (b == nanoseconds{0}) return a;
    return mean(a, weight_a, b, weight_b);
}

/// Of the same name; the size is that of the one with more samples.
KernelProfile merge(const KernelProfile& a, const KernelProfile& b) {
    KernelProfile merged = a.samples >= b.samples ? a : b;
    merged.gpu_time = mean(a.gpu_time, a.samples, b.gpu_time, b.samples);
    merged.utilization = mean(a.utilization, a.samples, b.utilization, b.samples);
    merged.samples = a.samples + b.samples;
    return merged;
}

auto size_key(const KernelProfile& kernel) {
    return std::tie(kernel.name, kernel.grid_blocks, kernel.block_threads);
}

std::vector<KernelProfile> merge_sizes(std::vector<KernelProfile> sizes,
                                       const std::vector<KernelProfile>& others) {
    for (const KernelProfile& other : others) {
        const auto same = std::find_if(sizes.begin(), sizes.end(), [&](const auto& kernel) {
            return size_key(kernel) == size_key(other);
        });
        if (same == sizes.end()) {
            sizes.push_back(other);
        } else {
            *same = merge(*same, other);
        }
    }
    std::sort(sizes.begin(), sizes.end(),
              [](const auto& a, const auto& b) { return size_key(a) < size_key(b); });
    return sizes;
}

bool same_shape(const TaskProfile& a, const TaskProfile& b) {
    const auto same_name = [](const KernelProfile& x, const KernelProfile& y) {
        return x.name == y.name;
    };
    const auto same_count = [](const SegmentProfile& x, const SegmentProfile& y) {
        return x.num_launches == y.num_launches;
    };
    return std::equal(a.kernels.begin(), a.kernels.end(), b.kernels.begin(), b.kernels.end(),
                      same_name) &&
           std::equal(a.segments.begin(), a.segments.end(), b.segments.begin(), b.segments.end(),
                      same_count);
}

void widen(SegmentProfile& segment, const SegmentProfile& other) {
    segment.min_launches = std::min(segment.min_launches, other.min_launches);
    segment.max_launches = std::max(segment.max_launches, other.max_launches);
}

TaskProfile merge(const TaskProfile& a, const TaskProfile& b) {
    if (a.kernels.empty()) return b;
    if (b.kernels.empty()) return a;
    TaskProfile merged = a.instances > b.instances ? a : b;
    if (same_shape(a, b)) {
        for (std::size_t i = 0; i < a.kernels.size(); ++i) {
            merged.kernels[i] = merge(a.kernels[i], b.kernels[i]);
            merged.kernels[i].launch_time = mean_if_known(a.kernels[i].launch_time, a.instances,
                                                          b.kernels[i].launch_time, b.instances);
        }
        for (std::size_t i = 0; i < a.segments.size(); ++i) {
            merged.segments[i].cpu_time =
                mean(a.segments[i].cpu_time, a.instances, b.segments[i].cpu_time, b.instances);
            merged.segments[i].latency = mean_if_known(a.segments[i].latency, a.instances,
                                                       b.segments[i].latency, b.instances);
        }
        merged.cpu_time = mean(a.cpu_time, a.instances, b.cpu_time, b.instances);
    }
    if (a.segments.size() == b.segments.size()) {
        for (std::size_t i = 0; i < a.segments.size(); ++i) {
            widen(merged.segments[i], a.segments[i]);
            widen(merged.segments[i], b.segments[i]);
        }
    }
    merged.sizes = merge_sizes(a.sizes, b.sizes);
    merged.instances = a.instances + b.instances;
    merged.start_up_launches = std::max(a.start_up_launches, b.start_up_launches);
    return merged;
}

ChainProfile merge(const ChainProfile& a, const ChainProfile& b);

/// In the order of the newer, which is that of the config; then what only the older knows.
template <typename Named>
std::vector<Named> merge_lists(const std::vector<Named>& older, const std::vector<Named>& newer) {
    const auto find = [](const std::vector<Named>& list, const std::string& name) {
        return std::find_if(list.begin(), list.end(),
                            [&name](const Named& each) { return each.name == name; });
    };
    std::vector<Named> merged;
    for (const Named& each : newer) {
        const auto same = find(older, each.name);
        merged.push_back(same == older.end() ? each : merge(*same, each));
    }
    for (const Named& each : older) {
        if (find(newer, each.name) == newer.end()) merged.push_back(each);
    }
    return merged;
}

ChainProfile merge(const ChainProfile& a, const ChainProfile& b) {
    return {b.name, merge_lists(a.tasks, b.tasks)};
}

}  // namespace

Result<Profile> merge_profiles(const Profile& older, const Profile& newer) {
    const std::string wrong = why_not(older, newer);
    if (!wrong.empty()) return Error{"cannot be merged: " + wrong};
    Profile merged = newer;
    if (merged.program.empty()) merged.program = older.program;
    if (merged.sm_clock_mhz == 0) merged.sm_clock_mhz = older.sm_clock_mhz;
    if (merged.memory_clock_mhz == 0) merged.memory_clock_mhz = older.memory_clock_mhz;
    merged.runs = older.runs + newer.runs;
    merged.chains = merge_lists(older.chains, newer.chains);
    merged.kernel_set_hash = kernel_set_hash(kernel_names(merged));
    return merged;
}

}  // namespace urgengo::trace
