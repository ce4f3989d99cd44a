// SPDX-License-Identifier: Apache-2.0
#include "tools/simgpu/api/launch_call.h"

#include <atomic>

namespace urgengo::simgpu {
namespace {

std::atomic<std::uint64_t> g_last{0};
std::atomic<simgpu_launch_hook> g_hook{nullptr};
thread_local std::uint64_t t_current = 0;

void tell(int begins) {
    if (const simgpu_launch_hook hook = g_hook.load(std::memory_order_acquire))
        hook(t_current, begins);
}

}  // namespace

LaunchCall::LaunchCall() : outer_(t_current) {
    if (outer_ != 0) return;  // one entry point calls another
    t_current = ++g_last;
    tell(1);
}

LaunchCall::~LaunchCall() {
    if (outer_ != 0) return;
    tell(0);
    t_current = 0;
}

std::uint64_t LaunchCall::current() {
    return t_current;
}

void LaunchCall::set_hook(simgpu_launch_hook hook) {
    g_hook.store(hook, std::memory_order_release);
}

}  // namespace urgengo::simgpu
