// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/page/planned_kernels.h"

#include <algorithm>
#include <cstring>

#include "tools/trace/clean_text.h"

namespace urgengo::cli {
namespace {

abi::StatusSection checked(const abi::StatusSection& section, std::size_t least, std::uint32_t most,
                           std::size_t bytes) {
    const bool fits =
        section.element_bytes >= least && section.count <= most && section.offset <= bytes &&
        std::uint64_t{section.count} * section.element_bytes <= bytes - section.offset;
    return fits ? section : abi::StatusSection{};
}

/// Of times that were multiplied by a factor, and are divided by it again.
constexpr double kInexact = 1e-6;

}  // namespace

PlannedKernels::PlannedKernels(std::span<const std::byte> page, const abi::StatusSection& launches,
                               const abi::StatusSection& names)
    : page_(page),
      launches_(
          checked(launches, sizeof(abi::PlannedLaunch), abi::kMostPlannedLaunches, page.size())),
      names_(checked(names, sizeof(abi::KernelName), abi::kMostKernelNames, page.size())),
      left_(launches_.count) {}

abi::PlannedLaunch PlannedKernels::launch(std::uint64_t index) const {
    abi::PlannedLaunch launch;
    std::memcpy(&launch, page_.data() + launches_.offset + index * launches_.element_bytes,
                sizeof launch);
    return launch;
}

std::string PlannedKernels::name(std::uint16_t index) const {
    if (index >= names_.count) return {};
    abi::KernelName kernel;
    std::memcpy(&kernel, page_.data() + names_.offset + std::uint64_t{index} * names_.element_bytes,
                sizeof kernel);
    return trace::clean_text({kernel.name, strnlen(kernel.name, sizeof kernel.name)});
}

// What is left is counted from the plan's end: the launch at which as much is left is the one.
void PlannedKernels::find(const abi::TaskStatus& status, TaskReading& task) {
    if (task.state == abi::TaskState::kIdle || status.first_launch == 0 || status.num_kernels == 0)
        return;
    const std::uint64_t first = status.first_launch - 1;
    if (first + status.num_kernels > launches_.count || status.num_kernels > left_) return;
    left_ -= status.num_kernels;
    const double left = static_cast<double>(task.remaining_gpu.count()) / task.factor;
    double planned = 0;
    std::uint32_t at = status.num_kernels;
    do planned += launch(first + --at).gpu_ns;
    while (at > 0 && planned + 2 + kInexact * left < left);
    task.kernel = at + 1;
    task.kernel_name = name(launch(first + at).name);
}

}  // namespace urgengo::cli
