// SPDX-License-Identifier: Apache-2.0
//
// Kernel launches: the runtime may hold the calling thread, and says at which priority to launch.
#include "interposer/manual/launch.h"

#include <algorithm>
#include <array>

#include "interposer/real_driver.h"

namespace urgengo::interposer {
namespace {

using exec::StreamFlavor;
using runtime::Launch;

constexpr unsigned kMaxAttributes = 32;

bool has_attribute(const CUlaunchConfig& config, CUlaunchAttributeID id) {
    return std::any_of(config.attrs, config.attrs + config.numAttrs,
                       [&](const CUlaunchAttribute& a) { return a.id == id; });
}

CUresult launch_ex(const CUlaunchConfig& config, CUfunction f, void** parameters, void** extra,
                   StreamFlavor flavor) {
    return flavor == StreamFlavor::kPerThread
               ? real().cuLaunchKernelEx_ptsz(&config, f, parameters, extra)
               : real().cuLaunchKernelEx(&config, f, parameters, extra);
}

// The program's launch with our priority added, unless the program chose one itself.
CUresult launch_with_priority(const CUlaunchConfig& config, int priority, CUfunction f,
                              void** parameters, void** extra, StreamFlavor flavor) {
    if (config.numAttrs >= kMaxAttributes || has_attribute(config, CU_LAUNCH_ATTRIBUTE_PRIORITY))
        return launch_ex(config, f, parameters, extra, flavor);
    std::array<CUlaunchAttribute, kMaxAttributes> attributes;
    std::copy_n(config.attrs, config.numAttrs, attributes.begin());
    CUlaunchAttribute& ours = attributes[config.numAttrs];
    ours = {};
    ours.id = CU_LAUNCH_ATTRIBUTE_PRIORITY;
    ours.value.priority = priority;
    CUlaunchConfig with_ours = config;
    with_ours.attrs = attributes.data();
    with_ours.numAttrs = config.numAttrs + 1;
    return launch_ex(with_ours, f, parameters, extra, flavor);
}

template <typename Plain>
CUresult launch_kernel(const CUlaunchConfig& config, CUfunction f, void** parameters, void** extra,
                       StreamFlavor flavor, Plain&& plain) {
    Launch launch;
    launch.function = f;
    launch.grid_blocks =
        static_cast<std::uint64_t>(config.gridDimX) * config.gridDimY * config.gridDimZ;
    launch.block_threads = config.blockDimX * config.blockDimY * config.blockDimZ;
    launch.stream = config.hStream;
    launch.flavor = flavor;
    launch.shared_bytes = config.sharedMemBytes;
    launch.depends_on_previous =
        has_attribute(config, CU_LAUNCH_ATTRIBUTE_PROGRAMMATIC_STREAM_SERIALIZATION);
    return scheduled_launch(launch, plain, [&](int priority) {
        return launch_with_priority(config, priority, f, parameters, extra, flavor);
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
        return function(f, gx, gy, gz, bx, by, bz, shared_bytes, stream, parameters, extra);
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
        return flavor == StreamFlavor::kPerThread
                   ? real().cuLaunchKernelEx_ptsz(config, f, parameters, extra)
                   : real().cuLaunchKernelEx(config, f, parameters, extra);
    };
    const bool well_formed = config && (config->attrs || config->numAttrs == 0);
    if (!well_formed || !acts()) return forward();
    return launch_kernel(*config, f, parameters, extra, flavor, forward);
}

// Cooperative launches keep their entry point, and so their stream's priority.
template <typename Forward>
CUresult launch_cooperative(CUfunction f, std::uint64_t grid_blocks, unsigned block_threads,
                            CUstream stream, StreamFlavor flavor, Forward&& forward) {
    if (!acts()) return forward();
    Launch launch;
    launch.function = f;
    launch.grid_blocks = grid_blocks;
    launch.block_threads = block_threads;
    launch.stream = stream;
    launch.flavor = flavor;
    return scheduled_launch(launch, forward, [&](int) { return forward(); });
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
    return launch_cooperative(f, std::uint64_t{gx} * gy * gz, bx * by * bz, stream,
                              StreamFlavor::kLegacy, [&] {
                                  return real().cuLaunchCooperativeKernel(
                                      f, gx, gy, gz, bx, by, bz, shared_bytes, stream, parameters);
                              });
}

CUresult CUDAAPI cuLaunchCooperativeKernel_ptsz(CUfunction f, unsigned gx, unsigned gy, unsigned gz,
                                                unsigned bx, unsigned by, unsigned bz,
                                                unsigned shared_bytes, CUstream stream,
                                                void** parameters) {
    return launch_cooperative(f, std::uint64_t{gx} * gy * gz, bx * by * bz, stream,
                              StreamFlavor::kPerThread, [&] {
                                  return real().cuLaunchCooperativeKernel_ptsz(
                                      f, gx, gy, gz, bx, by, bz, shared_bytes, stream, parameters);
                              });
}

}  // extern "C"
