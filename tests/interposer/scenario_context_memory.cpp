// SPDX-License-Identifier: Apache-2.0
//
// Contexts that come and go, one after the other: says how much more of the host's memory is in use
// after many of them.
#include <malloc.h>
#include <unistd.h>

#include <fstream>
#include <string>

#include "tests/interposer/gpu.h"
#include "tests/interposer/kernel_log.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

/// Private writable memory, whoever mapped it, without what malloc has left to give, and without
/// the simulated GPU's log. Malloc has one arena: of others it does not say what stays mapped.
std::int64_t in_use_bytes() {
    of_driver<decltype(simgpu_kernel_log_clear)>("simgpu_kernel_log_clear")();
    constexpr int kDataField = 6;  // of statm; pages, the main thread's stack included
    std::int64_t pages = 0;
    std::ifstream statm("/proc/self/statm");
    for (int field = 1; field <= kDataField; ++field) statm >> pages;
    if (!statm) give_up("statm", 1);
    return pages * sysconf(_SC_PAGESIZE) - static_cast<std::int64_t>(mallinfo2().fordblks);
}

/// A frame of four launches on three streams. All that is made here goes with the context.
void run_frame() {
    CUmodule module = nullptr;
    CUfunction tiny = nullptr;
    CUevent forked = nullptr, joined = nullptr;
    MUST(cuModuleLoadData(&module, kImage));
    MUST(cuModuleGetFunction(&tiny, module, "tiny"));
    MUST(cuEventCreate(&forked, CU_EVENT_DISABLE_TIMING));
    MUST(cuEventCreate(&joined, CU_EVENT_DISABLE_TIMING));
    const CUstream stream = make_stream(), side = make_stream();
    MUST(launch_tiny(tiny, stream));
    MUST(cuEventRecord(forked, stream));
    MUST(cuStreamWaitEvent(side, forked, 0));
    MUST(launch_tiny(tiny, side));
    MUST(cuEventRecord(joined, side));
    MUST(cuStreamWaitEvent(stream, joined, 0));
    MUST(launch_tiny(tiny, stream));
    MUST(launch_tiny(tiny, nullptr));
    MUST(cuCtxSynchronize());
}

void frame_in_created_context() {
    const CUcontext context = make_context();
    run_frame();
    MUST(cuCtxDestroy(context));
}

/// @param end  of the context, which keeps its handle
void frame_in_primary_context(CUresult (*end)(CUdevice)) {
    CUcontext context = nullptr;
    MUST(cuDevicePrimaryCtxRetain(&context, 0));
    MUST(cuCtxPushCurrent(context));
    run_frame();
    MUST(cuCtxPopCurrent(nullptr));
    MUST(end(0));
}

/// @param arguments  how contexts end (destroy, release, reset); how many come before memory is
///                   first looked at, and how many from then on
int context_memory(const Arguments& arguments) {
    mallopt(M_ARENA_MAX, 1);
    MUST(cuInit(0));
    name_this_thread("caller");
    const auto run_frames = [&](const std::string& count) {
        for (int i = 0; i < std::stoi(count); ++i) {
            if (arguments.at(0) == "destroy")
                frame_in_created_context();
            else if (arguments.at(0) == "release")
                frame_in_primary_context(cuDevicePrimaryCtxRelease);
            else
                frame_in_primary_context(cuDevicePrimaryCtxReset);
        }
    };
    run_frames(arguments.at(1));
    const std::int64_t before = in_use_bytes();
    run_frames(arguments.at(2));
    say("%lld", static_cast<long long>(in_use_bytes() - before));
    return 0;
}

const Scenario s("context_memory", context_memory, Runs::kSimulated);

}  // namespace
}  // namespace twin
