// SPDX-License-Identifier: Apache-2.0
//
// Captures that nobody ends: they end with their stream, its context, or its thread. What comes
// after them is as if they had never been.
#include <string>
#include <thread>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

// cuCtxDetach: old, and still there.
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"

namespace twin {
namespace {

/// Begins a capture, in the mode that forbids most, on a stream of another context, which goes.
void leave_in_context(const Gpu& gpu, bool detach) {
    const CUcontext other = make_context();
    const CUstream stream = make_stream();
    SHOW(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_GLOBAL));
    SHOW(detach ? cuCtxDetach(other) : cuCtxDestroy(other));
    SHOW(cuCtxSetCurrent(gpu.context));
}

void leave_in_reset_device() {
    const Gpu gpu;
    const CUstream stream = make_stream();
    SHOW(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_GLOBAL));
    SHOW(cuDevicePrimaryCtxReset(0));
}

void leave_in_thread(const Gpu& gpu) {
    std::thread([&] {
        SHOW(cuCtxSetCurrent(gpu.context));
        SHOW(cuStreamBeginCapture(CU_STREAM_PER_THREAD, CU_STREAM_CAPTURE_MODE_GLOBAL));
        SHOW(launch_tiny(gpu.tiny, CU_STREAM_PER_THREAD));
    }).join();
}

void leave_in_stream() {
    const CUstream stream = make_stream();
    SHOW(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_GLOBAL));
    SHOW(cuStreamDestroy(stream));
}

/// @param where  what the capture ends with: context, detach, reset, thread, stream, or none
void leave_capture(const std::string& where) {
    if (where == "reset") leave_in_reset_device();
    const Gpu gpu;
    if (where == "context" || where == "detach") leave_in_context(gpu, where == "detach");
    if (where == "thread") leave_in_thread(gpu);
    if (where == "stream") leave_in_stream();
    CUdeviceptr memory = 0;
    SHOW(cuMemAlloc(&memory, 64));  // what a capture would forbid
    const CUstream stream = make_stream();
    std::uint64_t* to = make_mapped(2);
    int sum = 0;
    for (int frame = 0; frame < 10; ++frame) {
        for (int i = 0; i < 20; ++i) sum += launch_tiny(gpu.tiny, stream);
        sum += launch_store(gpu.store, to, 10 + std::uint64_t(frame), stream);
        sum += cuStreamSynchronize(stream);
    }
    say("%d, %d", sum, int(to[0]));
}

// @param arguments  as leave_capture()'s; none: one after the other
int left_captures(const Arguments& arguments) {
    MUST(cuInit(0));
    const Arguments all{"none", "context", "detach", "reset", "thread", "stream"};
    for (const std::string& where : arguments.empty() ? all : arguments) leave_capture(where);
    return 0;
}

const Scenario s1("left_captures", left_captures);

}  // namespace
}  // namespace twin
