// SPDX-License-Identifier: Apache-2.0
//
// The launches of old: the block's size was set before, and is not known here.
#include <algorithm>

#include "interposer/manual/launch.h"
#include "interposer/own_time.h"
#include "interposer/real_driver.h"

namespace urgengo::interposer {
namespace {

template <typename OnStream>
CUresult launch_grid(CUfunction f, int width, int height, CUstream stream, OnStream&& on_stream) {
    if (!acts()) return on_stream(stream);
    const OwnTime own_time(CallClass::kLaunch);
    runtime::Launch launch;
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

extern "C" {

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
