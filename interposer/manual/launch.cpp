// SPDX-License-Identifier: Apache-2.0
//
// Kernel launches: the runtime may hold the calling thread, and says at which priority to launch.
#include "interposer/manual/launch.h"

#include <algorithm>
#include <array>

#include "host/runtime/as_planned.h"
#include "interposer/manual/launch_config.h"
#include "interposer/own_time.h"
#include "interposer/real_driver.h"

namespace urgengo::interposer {
namespace {

using exec::StreamFlavor;
using runtime::Launch;

/// To cache lines: wherever the code of a launch comes to lie, it takes no line more.
#define ALIGNED __attribute__((aligned(64)))

constexpr unsigned kMaxAttributes = 32;

struct Extent {
    unsigned x, y, z;
};

// The driver's functions, from the line that every call reads.

template <StreamFlavor flavor>
auto driver_launch() {
    constexpr bool kPtsz = flavor == StreamFlavor::kPerThread;
    const auto& known = kPtsz ? g_every_call.launch_ptsz : g_every_call.launch;
    const auto function = known.load(std::memory_order_relaxed);
    if (function) [[likely]]
        return function;
    return kPtsz ? real().cuLaunchKernel_ptsz : real().cuLaunchKernel;
}

template <StreamFlavor flavor>
auto driver_launch_ex() {
    constexpr bool kPtsz = flavor == StreamFlavor::kPerThread;
    const auto& known = kPtsz ? g_every_call.launch_ex_ptsz : g_every_call.launch_ex;
    const auto function = known.load(std::memory_order_relaxed);
    if (function) [[likely]]
        return function;
    return kPtsz ? real().cuLaunchKernelEx_ptsz : real().cuLaunchKernelEx;
}

// Ways to make a launch, unchanged: (config, f, parameters, extra) -> CUresult.

template <StreamFlavor flavor>
constexpr auto launch_ex =
    [](const CUlaunchConfig& config, CUfunction f, void** parameters, void** extra) {
        const auto function = driver_launch_ex<flavor>();
        return OwnTime::in_driver([&] { return function(&config, f, parameters, extra); });
    };

template <StreamFlavor flavor>
constexpr auto launch = [](const CUlaunchConfig& c, CUfunction f, void** parameters, void** extra) {
    const auto function = driver_launch<flavor>();
    return OwnTime::in_driver([&] {
        return function(f, c.gridDimX, c.gridDimY, c.gridDimZ, c.blockDimX, c.blockDimY,
                        c.blockDimZ, c.sharedMemBytes, c.hStream, parameters, extra);
    });
};

template <StreamFlavor flavor>
constexpr auto launch_cooperatively = [](const CUlaunchConfig& c, CUfunction f, void** parameters,
                                         void**) {
    const auto function = flavor == StreamFlavor::kPerThread ? real().cuLaunchCooperativeKernel_ptsz
                                                             : real().cuLaunchCooperativeKernel;
    return OwnTime::in_driver([&] {
        return function(f, c.gridDimX, c.gridDimY, c.gridDimZ, c.blockDimX, c.blockDimY,
                        c.blockDimZ, c.sharedMemBytes, c.hStream, parameters);
    });
};

/// @param config  of a launch without attributes
template <StreamFlavor flavor>
[[gnu::always_inline]] inline CUresult launch_at_priority(CUlaunchConfig& config, int priority,
                                                          CUfunction f, void** parameters,
                                                          void** extra) {
    CUlaunchAttribute ours{};
    ours.id = CU_LAUNCH_ATTRIBUTE_PRIORITY;
    ours.value.priority = priority;
    config.attrs = &ours;
    config.numAttrs = 1;
    return launch_ex<flavor>(config, f, parameters, extra);
}

/// The program's launch with our priority in the place of its own, or added. Out of line: room for
/// attributes is stack that the driver needs, of a thread that may have little.
/// @tparam most  attributes, ours included
template <StreamFlavor flavor, std::size_t most>
[[gnu::noinline]] CUresult launch_with_attributes(const CUlaunchConfig& config, int priority,
                                                  CUfunction f, void** parameters, void** extra) {
    CUlaunchConfig with_ours = config;
    std::array<CUlaunchAttribute, most> attributes;
    const auto end = std::copy_n(config.attrs, config.numAttrs, attributes.begin());
    const auto own = std::find_if(attributes.begin(), end, [](const CUlaunchAttribute& a) {
        return a.id == CU_LAUNCH_ATTRIBUTE_PRIORITY;
    });
    with_ours.attrs = attributes.data();
    if (own == end) {
        *own = {};
        own->id = CU_LAUNCH_ATTRIBUTE_PRIORITY;
        ++with_ours.numAttrs;
    }
    own->value.priority = priority;
    return launch_ex<flavor>(with_ours, f, parameters, extra);
}

template <StreamFlavor flavor>
CUresult launch_with_priority(const CUlaunchConfig& config, int priority, CUfunction f,
                              void** parameters, void** extra) {
    constexpr std::size_t kFew = 4;
    if (config.numAttrs == 0) {
        CUlaunchConfig with_ours = config;
        return launch_at_priority<flavor>(with_ours, priority, f, parameters, extra);
    }
    if (config.numAttrs < kFew)
        return launch_with_attributes<flavor, kFew>(config, priority, f, parameters, extra);
    if (config.numAttrs < kMaxAttributes)
        return launch_with_attributes<flavor, kMaxAttributes>(config, priority, f, parameters,
                                                              extra);
    return launch_ex<flavor>(config, f, parameters, extra);
}

/// The fast path: a launch that is the next one of its plan (runtime/as_planned.h).
/// @param at_priority  makes the launch at a priority of ours
template <typename AtPriority, typename Plain>
[[gnu::always_inline]] inline CUresult launch_planned(runtime::ThreadLine& thread,
                                                      AtPriority&& at_priority, Plain&& plain) {
    const auto& planned = thread.as_planned;
    CUresult result;
    if (planned.set_priority) [[likely]]
        result = at_priority(planned.priority);
    else
        result = plain();
    if (result == CUDA_SUCCESS) [[likely]]
        runtime::went_as_planned(thread);
    return result;
}

/// Any launch that launch_simple() does not make.
/// @param plain_launch  the program's own call
template <StreamFlavor flavor, typename Plain>
[[gnu::noinline]] CUresult launch_kernel(const CUlaunchConfig& config, CUfunction f,
                                         void** parameters, void** extra,
                                         const Plain& plain_launch) {
    const auto plain = [&] { return plain_launch(config, f, parameters, extra); };
    const auto at_priority = [&](int priority) {
        return launch_with_priority<flavor>(config, priority, f, parameters, extra);
    };
    if (!acts()) return plain();
    if (config.numAttrs != 0 && is_cooperative(config)) [[unlikely]]
        protect([] { the_runtime().gate_keeper().whole_gpu_is_needed(); });
    const OwnTime own_time(CallClass::kLaunch);
    const Launch launch = described(config, f, flavor);
    runtime::ThreadState* const thread = t_this.state;
    bool as_planned = false;
    const Inside inside;
    protect([&] { as_planned = thread && the_runtime().planned().goes(*thread, launch); });
    if (as_planned) return launch_planned(thread->line, at_priority, plain);
    return scheduled_launch(launch, plain, [&](const runtime::Grant& grant) {
        // What the driver says to a priority that there is not, it says to the program.
        if (launch.asks_priority && (launch.priority < grant.context->greatest_priority ||
                                     launch.priority > grant.context->least_priority))
            return plain();
        const config::PriorityVia via = the_runtime().launches().priority_via();
        const bool by_stream =
            (via == config::PriorityVia::kStreamAttribute && !launch.asks_priority) ||
            (via == config::PriorityVia::kStreamPool && !launch.depends_on_previous);
        if (by_stream)
            return launch_by_stream(launch, grant, [&](CUstream stream) {
                if (stream == config.hStream) return plain();
                CUlaunchConfig there = config;
                there.hStream = stream;
                return launch_ex<flavor>(there, f, parameters, extra);
            });
        return at_priority(grant.priority);
    });
}

/// A launch without attributes, whose config is ours to change. The fast path is here: its cost is
/// what it takes of the program's caches.
/// @param plain  the program's own call
template <StreamFlavor flavor, typename Plain>
[[gnu::always_inline]] inline CUresult launch_simple(CUlaunchConfig& config, CUfunction f,
                                                     void** parameters, void** extra, Plain plain) {
    if (!is_armed()) [[unlikely]]
        return launch_kernel<flavor>(config, f, parameters, extra, plain);
    ThisThread& its = this_thread_when_armed();
    runtime::ThreadLine& thread = its.line;
    if (thread.inside) [[unlikely]]
        return launch_kernel<flavor>(config, f, parameters, extra, plain);
    bool is_planned = runtime::is_next_planned(thread, f, grid_blocks(config),
                                               block_threads(config), config.hStream, flavor);
    if (thread.as_planned.is_watched) [[unlikely]]
        is_planned = is_planned && the_runtime().planned().is_reckoned_with(*its.state);
    if (!is_planned) [[unlikely]]
        return launch_kernel<flavor>(config, f, parameters, extra, plain);
    const OwnTime own_time(CallClass::kLaunch);
    const Inside inside(thread);
    runtime::publish_next_planned(thread);
    return launch_planned(
        thread,
        [&](int priority) {
            return launch_at_priority<flavor>(config, priority, f, parameters, extra);
        },
        [&] { return plain(config, f, parameters, extra); });
}

// As the plain entry points take it.
template <StreamFlavor flavor>
[[gnu::always_inline]] inline CUresult launch_plain(CUfunction f, Extent grid, Extent block,
                                                    unsigned shared_bytes, CUstream stream,
                                                    void** parameters, void** extra) {
    CUlaunchConfig config{grid.x,  grid.y,       grid.z, block.x, block.y,
                          block.z, shared_bytes, stream, nullptr, 0};
    return launch_simple<flavor>(config, f, parameters, extra, launch<flavor>);
}

template <StreamFlavor flavor>
[[gnu::noinline]] CUresult launch_config(const CUlaunchConfig* config, CUfunction f,
                                         void** parameters, void** extra) {
    const bool well_formed = config && (config->attrs || config->numAttrs == 0);
    if (!well_formed) return driver_launch_ex<flavor>()(config, f, parameters, extra);
    if (config->numAttrs == 0) {
        CUlaunchConfig copy = *config;
        return launch_simple<flavor>(copy, f, parameters, extra, launch_ex<flavor>);
    }
    return launch_kernel<flavor>(*config, f, parameters, extra, launch_ex<flavor>);
}

// A cooperative launch is one with that attribute: the driver gives the same answers (measured,
// H200), and it can carry a priority.
template <StreamFlavor flavor>
CUresult launch_cooperative(CUfunction f, Extent grid, Extent block, unsigned shared_bytes,
                            CUstream stream, void** parameters) {
    CUlaunchAttribute cooperative{};
    cooperative.id = CU_LAUNCH_ATTRIBUTE_COOPERATIVE;
    cooperative.value.cooperative = 1;
    const CUlaunchConfig config{grid.x,  grid.y,       grid.z, block.x,      block.y,
                                block.z, shared_bytes, stream, &cooperative, 1};
    return launch_kernel<flavor>(config, f, parameters, nullptr, launch_cooperatively<flavor>);
}

}  // namespace
}  // namespace urgengo::interposer

using namespace urgengo::interposer;
using urgengo::exec::StreamFlavor;

extern "C" {

ALIGNED CUresult CUDAAPI cuLaunchKernel(CUfunction f, unsigned gx, unsigned gy, unsigned gz,
                                        unsigned bx, unsigned by, unsigned bz,
                                        unsigned shared_bytes, CUstream stream, void** parameters,
                                        void** extra) {
    if (is_bystanders_launch(stream))
        if (const auto launch = g_every_call.launch.load(std::memory_order_relaxed)) [[likely]] {
            note_bystander();
            return launch(f, gx, gy, gz, bx, by, bz, shared_bytes, stream, parameters, extra);
        }
    return launch_plain<StreamFlavor::kLegacy>(f, {gx, gy, gz}, {bx, by, bz}, shared_bytes, stream,
                                               parameters, extra);
}

ALIGNED CUresult CUDAAPI cuLaunchKernel_ptsz(CUfunction f, unsigned gx, unsigned gy, unsigned gz,
                                             unsigned bx, unsigned by, unsigned bz,
                                             unsigned shared_bytes, CUstream stream,
                                             void** parameters, void** extra) {
    if (is_bystanders_launch(stream))
        if (const auto launch = g_every_call.launch_ptsz.load(std::memory_order_relaxed))
            [[likely]] {
            note_bystander();
            return launch(f, gx, gy, gz, bx, by, bz, shared_bytes, stream, parameters, extra);
        }
    return launch_plain<StreamFlavor::kPerThread>(f, {gx, gy, gz}, {bx, by, bz}, shared_bytes,
                                                  stream, parameters, extra);
}

ALIGNED CUresult CUDAAPI cuLaunchKernelEx(const CUlaunchConfig* config, CUfunction f,
                                          void** parameters, void** extra) {
    if (is_bystanders_launch(config ? config->hStream : nullptr))
        if (const auto launch = g_every_call.launch_ex.load(std::memory_order_relaxed)) [[likely]] {
            note_bystander();
            return launch(config, f, parameters, extra);
        }
    return launch_config<StreamFlavor::kLegacy>(config, f, parameters, extra);
}

ALIGNED CUresult CUDAAPI cuLaunchKernelEx_ptsz(const CUlaunchConfig* config, CUfunction f,
                                               void** parameters, void** extra) {
    if (is_bystanders_launch(config ? config->hStream : nullptr))
        if (const auto launch = g_every_call.launch_ex_ptsz.load(std::memory_order_relaxed))
            [[likely]] {
            note_bystander();
            return launch(config, f, parameters, extra);
        }
    return launch_config<StreamFlavor::kPerThread>(config, f, parameters, extra);
}

CUresult CUDAAPI cuLaunchCooperativeKernel(CUfunction f, unsigned gx, unsigned gy, unsigned gz,
                                           unsigned bx, unsigned by, unsigned bz,
                                           unsigned shared_bytes, CUstream stream,
                                           void** parameters) {
    return launch_cooperative<StreamFlavor::kLegacy>(f, {gx, gy, gz}, {bx, by, bz}, shared_bytes,
                                                     stream, parameters);
}

CUresult CUDAAPI cuLaunchCooperativeKernel_ptsz(CUfunction f, unsigned gx, unsigned gy, unsigned gz,
                                                unsigned bx, unsigned by, unsigned bz,
                                                unsigned shared_bytes, CUstream stream,
                                                void** parameters) {
    return launch_cooperative<StreamFlavor::kPerThread>(f, {gx, gy, gz}, {bx, by, bz}, shared_bytes,
                                                        stream, parameters);
}

}  // extern "C"
