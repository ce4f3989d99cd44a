// SPDX-License-Identifier: Apache-2.0
#include "tools/simgpu/engine/kernel_failures.h"

#include <map>

namespace urgengo::simgpu {
namespace {

std::map<std::string, KernelFailures>& by_kernel() {
    static auto* const all = new std::map<std::string, KernelFailures>;
    return *all;
}

}  // namespace

bool KernelFailures::any_ = false;

void KernelFailures::add(const InjectedError& error) {
    by_kernel()[error.name].errors_.push_back(error);
    any_ = true;
}

KernelFailures* KernelFailures::find(const std::string& kernel) {
    if (!any_) return nullptr;
    const auto found = by_kernel().find(kernel);
    return found == by_kernel().end() ? nullptr : &found->second;
}

const InjectedError* KernelFailures::next_launch() {
    const std::uint64_t launch = num_launches_.fetch_add(1) + 1;
    for (const InjectedError& error : errors_) {
        if (error.call == launch) return &error;
    }
    return nullptr;
}

}  // namespace urgengo::simgpu
