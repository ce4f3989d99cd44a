// SPDX-License-Identifier: Apache-2.0
//
// Contexts: the current one is the program's own affair; several of them; one that is destroyed
// and made again, in the same place.
#include <string>
#include <thread>
#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

// cuCtxAttach and cuCtxDetach: old, and still there.
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"

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

// Whoever detaches last destroys; so does whoever made it.
int attached_contexts(const Arguments&) {
    SHOW(cuInit(0));
    for (int i = 0; i < 4; ++i) {
        const CUcontext context = make_context();
        CUcontext attached = nullptr;
        SHOW(cuCtxAttach(&attached, 1));
        SHOW(cuCtxAttach(&attached, 0));
        say("the same: %d", attached == context);
        work_here(10 + std::uint64_t(i));
        SHOW(cuCtxDetach(context));
        say("stays: %d", current() == context);
        work_here(20 + std::uint64_t(i));
        CUfunction wide = nullptr;
        CUmodule module = nullptr;
        MUST(cuModuleLoadData(&module, kImage));
        MUST(cuModuleGetFunction(&wide, module, "wide"));
        SHOW(launch_wide(wide, nullptr));  // not waited for
        SHOW(i == 3 ? cuCtxDestroy(context) : cuCtxDetach(context));
        say("gone: %d", current() != context);
        if (simulated()) SHOW(cuCtxPushCurrent(context));  // else undefined
        SHOW(cuCtxSynchronize());
    }
    const Gpu gpu;
    work_here(30);
    CUcontext none = nullptr;
    SHOW(cuCtxPopCurrent(&none));
    SHOW(cuCtxDetach(gpu.context));
    SHOW(cuCtxPushCurrent(gpu.context));
    return 0;
}

/// Makes another context the current one.
CUresult create_context(int version, void* create) {
    CUcontext made = nullptr;
    if (version < 11040)
        return reinterpret_cast<CUresult (*)(CUcontext*, unsigned, CUdevice)>(create)(&made, 0, 0);
    if (version < 12050)
        return reinterpret_cast<CUresult (*)(CUcontext*, CUexecAffinityParam*, int, unsigned,
                                             CUdevice)>(create)(&made, nullptr, 0, 0, 0);
    // Its parameters have a type that older toolkits do not know.
    return reinterpret_cast<CUresult (*)(CUcontext*, void*, unsigned, CUdevice)>(create)(
        &made, nullptr, 0, 0);
}

// Launches on a default stream, with one call that may change whose stream that is among them. The
// kernel is one for every context.
// @param arguments  that call, and the CUDA version of it
int context_call(const Arguments& arguments) {
    const Gpu gpu;
    const std::string call = arguments.at(0);
    const int version = std::stoi(arguments.at(1));
    void* const function = entry_point(call.c_str(), version, 0);
    CUlibrary library = nullptr;
    CUkernel kernel = nullptr;
    MUST(cuLibraryLoadData(&library, kImage, nullptr, nullptr, 0, nullptr, nullptr, 0));
    MUST(cuLibraryGetKernel(&kernel, library, "tiny"));
    const auto tiny = reinterpret_cast<CUfunction>(kernel);
    MUST(cuCtxPushCurrent(gpu.context));
    name_this_thread("caller");
    for (int i = 0; i < 4; ++i) MUST(launch_tiny(tiny, nullptr));
    if (call == "cuCtxCreate") {
        MUST(create_context(version, function));
    } else if (call == "cuCtxPopCurrent") {
        CUcontext popped = nullptr;
        MUST(reinterpret_cast<CUresult (*)(CUcontext*)>(function)(&popped));
    } else if (call != "cuCtxGetCurrent") {
        MUST(reinterpret_cast<CUresult (*)(CUcontext)>(function)(gpu.context));
    }
    for (int i = 0; i < 4; ++i) MUST(launch_tiny(tiny, nullptr));
    MUST(cuCtxSynchronize());
    return 0;
}

/// Some launches in the current context, on a stream of their own.
/// @returns the sum of their results
int launch_here(std::uint64_t* to, std::uint64_t value) {
    CUmodule module = nullptr;
    CUfunction store = nullptr, tiny = nullptr;
    MUST(cuModuleLoadData(&module, kImage));
    MUST(cuModuleGetFunction(&store, module, kStoreName));
    MUST(cuModuleGetFunction(&tiny, module, "tiny"));
    const CUstream stream = make_stream();
    int sum = 0;
    for (int i = 0; i < 8; ++i) sum += launch_tiny(tiny, stream);
    sum += launch_store(store, to, value, stream);
    sum += cuStreamSynchronize(stream);
    MUST(cuStreamDestroy(stream));
    return sum;
}

// Many contexts, one after the other; the last one's work is another task's.
int many_contexts(const Arguments& arguments) {
    MUST(cuInit(0));
    const int count = std::stoi(arguments.at(0));
    name_this_thread("first");
    int sum = 0;
    std::uint64_t values = 0;
    for (int i = 0; i < count; ++i) {
        const CUcontext context = make_context();
        if (i == count - 1) name_this_thread("last");
        std::uint64_t* to = make_mapped(2);
        sum += launch_here(to, std::uint64_t(i));
        values += to[0];
        MUST(cuCtxDestroy(context));
    }
    say("%d, %d", sum, int(values));
    return 0;
}

// As many at a time.
int live_contexts(const Arguments& arguments) {
    MUST(cuInit(0));
    name_this_thread("first");
    int sum = 0;
    std::uint64_t values = 0;
    std::vector<CUcontext> all;
    for (int i = 0; i < std::stoi(arguments.at(0)); ++i) {
        all.push_back(make_context());
        std::uint64_t* to = make_mapped(2);
        sum += launch_here(to, std::uint64_t(i));
        values += to[0];
        MUST(cuCtxPopCurrent(nullptr));
    }
    for (const CUcontext context : all) MUST(cuCtxDestroy(context));
    say("%d, %d", sum, int(values));
    // And when those have gone.
    name_this_thread("last");
    make_context();
    std::uint64_t* to = make_mapped(2);
    say("%d, %d", launch_here(to, 7), int(to[0]));
    return 0;
}

// A context that ends with work under way.
// @param arguments  the call that ends it, and the CUDA version of it
int context_ends(const Arguments& arguments) {
    MUST(cuInit(0));
    const CUcontext context = make_context();
    CUmodule module = nullptr;
    CUfunction wide = nullptr;
    MUST(cuModuleLoadData(&module, kImage));
    MUST(cuModuleGetFunction(&wide, module, "wide"));
    name_this_thread("caller");
    for (int i = 0; i < 4; ++i) MUST(launch_wide(wide, nullptr));
    void* const end = entry_point(arguments.at(0).c_str(), std::stoi(arguments.at(1)), 0);
    MUST(reinterpret_cast<CUresult (*)(CUcontext)>(end)(context));
    return current() == nullptr ? 0 : 1;
}

const Scenario s1("current_context", current_context), s2("two_contexts", two_contexts),
    s3("recreated_contexts", recreated_contexts), s4("context_call", context_call),
    s5("attached_contexts", attached_contexts), s6("context_ends", context_ends),
    s7("many_contexts", many_contexts), s8("live_contexts", live_contexts);

}  // namespace
}  // namespace twin
