// SPDX-License-Identifier: Apache-2.0
//
// Contexts: the current one is the program's own affair; several of them; one that is destroyed
// and made again, in the same place.
#include <string>
#include <thread>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

CUcontext current() {
    CUcontext context = nullptr;
    SHOW(cuCtxGetCurrent(&context));
    return context;
}

/// Loads a module into the current context and does some work there.
void work_here(std::uint64_t value) {
    CUmodule module = nullptr;
    CUfunction store = nullptr, wide = nullptr;
    const CUcontext before = current();
    SHOW(cuModuleLoadData(&module, kImage));
    SHOW(cuModuleGetFunction(&store, module, kStoreName));
    SHOW(cuModuleGetFunction(&wide, module, "wide"));
    std::uint64_t* to = make_mapped(2);
    const CUstream stream = make_stream();
    for (int i = 0; i < 3; ++i) SHOW(launch_wide(wide, stream));
    SHOW(launch_store(store, to, value, stream));
    say("current as before: %d", current() == before);
    SHOW(cuStreamSynchronize(stream));
    say("%d, current as before: %d", int(to[0]), current() == before);
}

int current_context(const Arguments&) {
    const Gpu gpu;
    work_here(1);
    say("current is the program's: %d", current() == gpu.context);
    std::thread([&] {
        say("new thread has one: %d", current() != nullptr);
        SHOW(launch_tiny(gpu.tiny, nullptr));
        SHOW(cuCtxSetCurrent(gpu.context));
        work_here(2);
        SHOW(cuCtxSetCurrent(nullptr));
        say("none: %d", current() == nullptr);
    }).join();
    return 0;
}

int two_contexts(const Arguments&) {
    const Gpu gpu;
    work_here(1);
    const CUcontext other = make_context();
    work_here(2);
    SHOW(cuCtxSetCurrent(gpu.context));
    work_here(3);
    // To and fro with work left undone in each.
    CUfunction other_tiny = nullptr;
    CUmodule other_module = nullptr;
    SHOW(cuCtxPushCurrent(other));
    SHOW(cuModuleLoadData(&other_module, kImage));
    SHOW(cuModuleGetFunction(&other_tiny, other_module, "tiny"));
    for (int i = 0; i < 4; ++i) {
        SHOW(launch_tiny(other_tiny, nullptr));
        SHOW(cuCtxPopCurrent(nullptr));
        SHOW(launch_tiny(gpu.tiny, nullptr));
        SHOW(launch_tiny(other_tiny, nullptr));  // the wrong context's
        SHOW(cuCtxPushCurrent(other));
    }
    SHOW(cuCtxSynchronize());
    SHOW(cuCtxPopCurrent(nullptr));
    SHOW(cuCtxSynchronize());
    SHOW(cuCtxDestroy(other));
    SHOW(launch_tiny(gpu.tiny, nullptr));
    SHOW(cuCtxSynchronize());
    return 0;
}

int recreated_contexts(const Arguments&) {
    SHOW(cuInit(0));
    for (int i = 0; i < 4; ++i) {
        const CUcontext context = make_context();
        work_here(10 + std::uint64_t(i));
        CUfunction tiny = nullptr;
        CUmodule module = nullptr;
        MUST(cuModuleLoadData(&module, kImage));
        MUST(cuModuleGetFunction(&tiny, module, "tiny"));
        SHOW(launch_tiny(tiny, nullptr));  // not waited for
        SHOW(cuCtxDestroy(context));
        if (simulated()) SHOW(launch_tiny(tiny, nullptr));  // else undefined
        SHOW(cuCtxSynchronize());
    }
    // The primary context keeps its handle through release and retain.
    for (int i = 0; i < 3; ++i) {
        const Gpu gpu;
        work_here(20 + std::uint64_t(i));
        SHOW(launch_wide(gpu.wide, nullptr));
    }
    return 0;
}

// Launches on a default stream, with one call that may change whose stream that is among them.
// @param arguments  that call, and the CUDA version of it
int context_call(const Arguments& arguments) {
    const Gpu gpu;
    const std::string call = arguments.at(0);
    void* const function = entry_point(call.c_str(), std::stoi(arguments.at(1)), 0);
    MUST(cuCtxPushCurrent(gpu.context));
    name_this_thread("caller");
    for (int i = 0; i < 4; ++i) MUST(launch_tiny(gpu.tiny, nullptr));
    if (call == "cuCtxPopCurrent") {
        CUcontext popped = nullptr;
        MUST(reinterpret_cast<CUresult (*)(CUcontext*)>(function)(&popped));
    } else if (call != "cuCtxGetCurrent") {
        MUST(reinterpret_cast<CUresult (*)(CUcontext)>(function)(gpu.context));
    }
    for (int i = 0; i < 4; ++i) MUST(launch_tiny(gpu.tiny, nullptr));
    MUST(cuCtxSynchronize());
    return 0;
}

const Scenario s1("current_context", current_context), s2("two_contexts", two_contexts),
    s3("recreated_contexts", recreated_contexts), s4("context_call", context_call);

}  // namespace
}  // namespace twin
