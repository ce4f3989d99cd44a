// SPDX-License-Identifier: Apache-2.0
//
// Kernel launches: the runtime may hold the calling thread, and says at which priority to launch.
#include "interposer/manual/launch.h"

#include <algorithm>
#include <array>

#include "interposer/own_time.h"
#include "interposer/real_driver.h"

namespace urgengo::interposer {
namespace {

using exec::StreamFlavor;
using runtime::Launch;

constexpr unsigned kMaxAttributes = 32;

struct Extent {
    unsigned x, y, z;
};

CUresult launch_ex(const CUlaunchConfig& config, CUfunction f, void** parameters, void** extra,
                   StreamFlavor flavor) {
    return OwnTime::in_driver([&] {
        return flavor == StreamFlavor::kPerThread
                   ? real().cuLaunchKernelEx_ptsz(&config, f, parameters, extra)
                   : real().cuLaunchKernelEx(&config, f, parameters, extra);
    });
}

const CUlaunchAttribute* find_attribute(const CUlaunchConfig& config, CUlaunchAttributeID id) {
    const CUlaunchAttribute* const first = config.attrs;
    const CUlaunchAttribute* const last = first + config.numAttrs;
    const auto* found =
        std::find_if(first, last, [&](const CUlaunchAttribute& a) { return a.id == id; });
    return found == last ? nullptr : found;
}

// The program's launch with our priority in the place of its own, or added.
CUresult launch_with_priority(const CUlaunchConfig& config, int priority, CUfunction f,
                              void** parameters, void** extra, StreamFlavor flavor) {
    if (config.numAttrs >= kMaxAttributes) return launch_ex(config, f, parameters, extra, flavor);
    std::array<CUlaunchAttribute, kMaxAttributes> attributes;
    const auto end = std::copy_n(config.attrs, config.numAttrs, attributes.begin());
    const auto own = std::find_if(attributes.begin(), end, [](const CUlaunchAttribute& a) {
        return a.id == CU_LAUNCH_ATTRIBUTE_PRIORITY;
    });
    CUlaunchConfig with_ours = config;
    with_ours.attrs = attributes.data();
    if (own == end) {
        *own = {};
        own->id = CU_LAUNCH_ATTRIBUTE_PRIORITY;
        ++with_ours.numAttrs;
    }
    own->value.priority = priority;
    return launch_ex(with_ours, f, parameters, extra, flavor);
}

/// @param config  the launch as cuLaunchKernelEx takes it
/// @param plain   () -> CUresult: the program's own call
template <typename Plain>
CUresult launch_kernel(const CUlaunchConfig& config, CUfunction f, void** parameters, void** extra,
                       StreamFlavor flavor, Plain&& plain) {
    const OwnTime own_time(CallClass::kLaunch);
    Launch launch;
    launch.function = f;
    launch.grid_blocks =
        static_cast<std::uint64_t>(config.gridDimX) * config.gridDimY * config.gridDimZ;
    launch.block_threads = config.blockDimX * config.blockDimY * config.blockDimZ;
    launch.stream = config.hStream;
    launch.flavor = flavor;
    launch.shared_bytes = config.sharedMemBytes;
    launch.depends_on_previous =
        find_attribute(config, CU_LAUNCH_ATTRIBUTE_PROGRAMMATIC_STREAM_SERIALIZATION);
    if (const auto* own = find_attribute(config, CU_LAUNCH_ATTRIBUTE_PRIORITY)) {
        launch.asks_priority = true;
        launch.priority = own->value.priority;
    }
    runtime::ThreadState* const thread = t_state;
    bool as_planned = false;
    const Inside inside;
    protect([&] { as_planned = thread && the_runtime().goes_as_planned(*thread, launch); });
    if (as_planned) {
        const auto& planned = thread->as_planned;
        const CUresult result =
            planned.set_priority
                ? launch_with_priority(config, planned.priority, f, parameters, extra, flavor)
                : plain();
        if (result == CUDA_SUCCESS) the_runtime().went_as_planned(*thread);
        return result;
    }
    return scheduled_launch(launch, plain, [&](const runtime::Grant& grant) {
        // What the driver says to a priority that there is not, it says to the program.
        if (launch.asks_priority && (launch.priority < grant.context->greatest_priority ||
                                     launch.priority > grant.context->least_priority))
            return plain();
        const config::PriorityVia via = the_runtime().priority_via();
        const bool by_stream =
            (via == config::PriorityVia::kStreamAttribute && !launch.asks_priority) ||
            (via == config::PriorityVia::kStreamPool && !launch.depends_on_previous);
        if (by_stream)
            return launch_by_stream(launch, grant, [&](CUstream stream) {
                if (stream == config.hStream) return plain();
                CUlaunchConfig there = config;
                there.hStream = stream;
                return launch_ex(there, f, parameters, extra, flavor);
            });
        return launch_with_priority(config, grant.priority, f, parameters, extra, flavor);
    });
}

// A launch without attributes, as the plain entry points take it, unless UrgenGo is off.
template <StreamFlavor flavor>
[[gnu::noinline]] CUresult launch_plain(CUfunction f, unsigned gx, unsigned gy, unsigned gz,
                                        unsigned bx, unsigned by, unsigned bz,
                                        unsigned shared_bytes, CUstream stream, void** parameters,
                                        void** extra) {
    const auto forward = [&] {
        const auto function =
            flavor == StreamFlavor::kPerThread ? real().cuLaunchKernel_ptsz : real().cuLaunchKernel;
        return OwnTime::in_driver([&] {
            return function(f, gx, gy, gz, bx, by, bz, shared_bytes, stream, parameters, extra);
        });
    };
    if (!acts()) return forward();
    CUlaunchConfig config{};
    config.gridDimX = gx, config.gridDimY = gy, config.gridDimZ = gz;
    config.blockDimX = bx, config.blockDimY = by, config.blockDimZ = bz;
    config.sharedMemBytes = shared_bytes;
    config.hStream = stream;
    return launch_kernel(config, f, parameters, extra, flavor, forward);
}

template <StreamFlavor flavor>
[[gnu::noinline]] CUresult launch_config(const CUlaunchConfig* config, CUfunction f,
                                         void** parameters, void** extra) {
    const auto forward = [&] {
        return OwnTime::in_driver([&] {
            return flavor == StreamFlavor::kPerThread
                       ? real().cuLaunchKernelEx_ptsz(config, f, parameters, extra)
                       : real().cuLaunchKernelEx(config, f, parameters, extra);
        });
    };
    const bool well_formed = config && (config->attrs || config->numAttrs == 0);
    if (!well_formed || !acts()) return forward();
    return launch_kernel(*config, f, parameters, extra, flavor, forward);
}

// A cooperative launch is one with that attribute: the driver gives the same answers (measured,
// H200), and it can carry a priority.
template <typename Forward>
CUresult launch_cooperative(CUfunction f, Extent grid, Extent block, unsigned shared_bytes,
                            CUstream stream, void** parameters, StreamFlavor flavor,
                            Forward&& forward) {
    if (!acts() || !real().cuLaunchKernelEx) return forward();
    CUlaunchAttribute cooperative{};
    cooperative.id = CU_LAUNCH_ATTRIBUTE_COOPERATIVE;
    cooperative.value.cooperative = 1;
    CUlaunchConfig config{};
    config.gridDimX = grid.x, config.gridDimY = grid.y, config.gridDimZ = grid.z;
    config.blockDimX = block.x, config.blockDimY = block.y, config.blockDimZ = block.z;
    config.sharedMemBytes = shared_bytes;
    config.hStream = stream;
    config.attrs = &cooperative;
    config.numAttrs = 1;
    return launch_kernel(config, f, parameters, nullptr, flavor,
                         [&] { return OwnTime::in_driver(forward); });
}

// The launches of old: the block's size was set before, and is not known here.
template <typename OnStream>
CUresult launch_grid(CUfunction f, int width, int height, CUstream stream, OnStream&& on_stream) {
    if (!acts()) return on_stream(stream);
    const OwnTime own_time(CallClass::kLaunch);
    Launch launch;
    launch.function = f;
    launch.grid_blocks = static_cast<std::uint64_t>(std::max(width, 1)) *
                         static_cast<std::uint64_t>(std::max(height, 1));
    launch.stream = stream;
    return scheduled_on_stream(
        launch, [&](CUstream on) { return OwnTime::in_driver([&] { return on_stream(on); }); });
}

}  // namespace
}  // namespace urgengo::interposer

using namespace urgengo::interposer;
using urgengo::exec::StreamFlavor;

extern "C" {

CUresult CUDAAPI cuLaunchKernel(CUfunction f, unsigned gx, unsigned gy, unsigned gz, unsigned bx,
                                unsigned by, unsigned bz, unsigned shared_bytes, CUstream stream,
                                void** parameters, void** extra) {
    if (const auto* driver = real_if_nobodys(stream))
        return driver->cuLaunchKernel(f, gx, gy, gz, bx, by, bz, shared_bytes, stream, parameters,
                                      extra);
    return launch_plain<StreamFlavor::kLegacy>(f, gx, gy, gz, bx, by, bz, shared_bytes, stream,
                                               parameters, extra);
}

CUresult CUDAAPI cuLaunchKernel_ptsz(CUfunction f, unsigned gx, unsigned gy, unsigned gz,
                                     unsigned bx, unsigned by, unsigned bz, unsigned shared_bytes,
                                     CUstream stream, void** parameters, void** extra) {
    if (const auto* driver = real_if_nobodys(stream))
        return driver->cuLaunchKernel_ptsz(f, gx, gy, gz, bx, by, bz, shared_bytes, stream,
                                           parameters, extra);
    return launch_plain<StreamFlavor::kPerThread>(f, gx, gy, gz, bx, by, bz, shared_bytes, stream,
                                                  parameters, extra);
}

CUresult CUDAAPI cuLaunchKernelEx(const CUlaunchConfig* config, CUfunction f, void** parameters,
                                  void** extra) {
    if (const auto* driver = real_if_nobodys(config ? config->hStream : nullptr))
        return driver->cuLaunchKernelEx(config, f, parameters, extra);
    return launch_config<StreamFlavor::kLegacy>(config, f, parameters, extra);
}

CUresult CUDAAPI cuLaunchKernelEx_ptsz(const CUlaunchConfig* config, CUfunction f,
                                       void** parameters, void** extra) {
    if (const auto* driver = real_if_nobodys(config ? config->hStream : nullptr))
        return driver->cuLaunchKernelEx_ptsz(config, f, parameters, extra);
    return launch_config<StreamFlavor::kPerThread>(config, f, parameters, extra);
}

CUresult CUDAAPI cuLaunchCooperativeKernel(CUfunction f, unsigned gx, unsigned gy, unsigned gz,
                                           unsigned bx, unsigned by, unsigned bz,
                                           unsigned shared_bytes, CUstream stream,
                                           void** parameters) {
    return launch_cooperative(f, {gx, gy, gz}, {bx, by, bz}, shared_bytes, stream, parameters,
                              StreamFlavor::kLegacy, [&] {
                                  return real().cuLaunchCooperativeKernel(
                                      f, gx, gy, gz, bx, by, bz, shared_bytes, stream, parameters);
                              });
}

CUresult CUDAAPI cuLaunchCooperativeKernel_ptsz(CUfunction f, unsigned gx, unsigned gy, unsigned gz,
                                                unsigned bx, unsigned by, unsigned bz,
                                                unsigned shared_bytes, CUstream stream,
                                                void** parameters) {
    return launch_cooperative(f, {gx, gy, gz}, {bx, by, bz}, shared_bytes, stream, parameters,
                              StreamFlavor::kPerThread, [&] {
                                  return real().cuLaunchCooperativeKernel_ptsz(
                                      f, gx, gy, gz, bx, by, bz, shared_bytes, stream, parameters);
                              });
}

CUresult CUDAAPI cuLaunch(CUfunction f) {
    return launch_grid(f, 1, 1, nullptr, [&](CUstream stream) {
        return stream ? real().cuLaunchGridAsync(f, 1, 1, stream) : real().cuLaunch(f);
    });
}

CUresult CUDAAPI cuLaunchGrid(CUfunction f, int width, int height) {
    return launch_grid(f, width, height, nullptr, [&](CUstream stream) {
        return stream ? real().cuLaunchGridAsync(f, width, height, stream)
                      : real().cuLaunchGrid(f, width, height);
    });
}

CUresult CUDAAPI cuLaunchGridAsync(CUfunction f, int width, int height, CUstream stream) {
    return launch_grid(f, width, height, stream,
                       [&](CUstream on) { return real().cuLaunchGridAsync(f, width, height, on); });
}

}  // extern "C"
