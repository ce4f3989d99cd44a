// SPDX-License-Identifier: Apache-2.0
//
// Two hinted chains that want the whole GPU at the same time. Prints what the GPU did, for
// test_scheduling.cpp: this one is meant to differ under UrgenGo.
#include <urgengo/urgengo.h>

#include <atomic>
#include <thread>

#include "tests/interposer/gpu.h"
#include "tests/interposer/kernel_log.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

constexpr int kKernels = 5;

/// The kernels of one instance: <chain>_0, <chain>_1, ..., each of which fills the GPU for 50 ms.
std::string kernel_image() {
    std::string image = R"({"kernels": [{"name": "none"})";
    for (const char* chain : {"tight", "loose"})
        for (int i = 0; i < kKernels; ++i)
            image += std::string(R"(, {"name": ")") + chain + "_" + std::to_string(i) +
                     R"(", "block_ns": 50000000, "blocks_per_sm": 1})";
    return image + "]}";
}

struct Chain {
    const char* name;
    CUstream stream;
    std::atomic<bool> launched{false};
};

void run_instance(const ug_hints& hints, CUmodule module, Chain& chain) {
    hints.task_begin(hints.arrival(chain.name, 0, UG_CLOCK_MONOTONIC), "work");
    for (int i = 0; i < kKernels; ++i) {
        CUfunction f = nullptr;
        const std::string name = std::string(chain.name) + "_" + std::to_string(i);
        MUST(cuModuleGetFunction(&f, module, name.c_str()));
        MUST(launch_wide(f, chain.stream));
        chain.launched = true;
    }
    MUST(cuStreamSynchronize(chain.stream));
    hints.task_end();
}

int scheduling(const Arguments&) {
    ug_hints hints;
    ug_hints_load(&hints);
    const Gpu gpu;
    CUmodule module = nullptr;
    MUST(cuModuleLoadData(&module, kernel_image().c_str()));
    Chain tight{"tight", make_stream()}, loose{"loose", make_stream()};
    const auto run = [&](Chain& chain) {
        MUST(cuCtxSetCurrent(gpu.context));
        run_instance(hints, module, chain);
    };
    // The tight chain has the GPU for 250 ms; the loose one comes in the middle of that.
    std::thread tight_thread(run, std::ref(tight));
    while (!tight.launched) std::this_thread::yield();
    std::thread loose_thread(run, std::ref(loose));
    tight_thread.join();
    loose_thread.join();
    for (const Chain* chain : {&tight, &loose})
        for (const simgpu_kernel_record& kernel : kernel_log(chain->name))
            say("%s %d", kernel.name, kernel.priority);
    return 0;
}

// One instance, looked at by another thread all the while.
int position(const Arguments&) {
    ug_hints hints;
    ug_hints_load(&hints);
    const Gpu gpu;
    CUmodule module = nullptr;
    MUST(cuModuleLoadData(&module, kernel_image().c_str()));
    Chain tight{"tight", make_stream()};
    const auto ask = [&](const char* chain, const char* task, ug_position_t& at) {
        at = {};
        at.size = sizeof(at);
        return hints.position(chain, task, &at);
    };
    ug_position_t at;
    say("before %d", ask("tight", "work", at));
    std::atomic<bool> done{false};
    std::thread looker([&] {
        std::uint32_t last = 0, num_seen = 0;
        bool goes_back = false, fits = true;
        while (!done) {
            if (ask("tight", "work", at)) {
                goes_back = goes_back || at.launch < last;
                num_seen += at.launch > last;
                last = at.launch;
                fits = fits && at.instance == 1 && at.launch <= kKernels &&
                       at.remaining_ns >= at.unexecuted_ns && at.unexecuted_ns >= 0;
            }
            std::this_thread::sleep_for(std::chrono::milliseconds(2));
        }
        say("goes back %d, fits %d, moves %d", goes_back, fits, num_seen >= 3);
    });
    run_instance(hints, module, tight);
    done = true;
    looker.join();
    say("after %d", ask("tight", "work", at));
    say("busy %u, launch %u, instance %u, overdue %u, remaining %d, unexecuted %d, uncertain %d",
        at.busy, at.launch, at.instance, at.overdue, int(at.remaining_ns), int(at.unexecuted_ns),
        int(at.uncertain_ns));
    say("unknown %d %d %d %d", ask("tight", "none", at), ask("none", "work", at),
        ask(nullptr, "work", at), ask("tight", nullptr, at));
    at.size = 8;
    say("small %d, null %d", hints.position("tight", "work", &at),
        hints.position("tight", "work", nullptr));
    return 0;
}

// Many small launches in one context after the other, none of them waited for in between.
int unsynchronised_contexts(const Arguments&) {
    const Gpu gpu;
    const auto create = reinterpret_cast<CUresult (*)(CUcontext*, unsigned, CUdevice)>(
        entry_point("cuCtxCreate", 3020, 0));
    CUcontext other = nullptr;
    CUmodule module = nullptr;
    CUfunction tiny = nullptr;
    MUST(launch_tiny(gpu.tiny, nullptr));
    MUST(create(&other, 0, 0));
    MUST(cuModuleLoadData(&module, kImage));
    MUST(cuModuleGetFunction(&tiny, module, "tiny"));
    for (int i = 0; i < 200; ++i) MUST(launch_tiny(tiny, nullptr));
    MUST(cuCtxSynchronize());
    say("done");
    return 0;
}

// Every way to launch a kernel, and the priority that their stream is left with.
int priorities_of_launches(const Arguments&) {
    const Gpu gpu;
    const CUstream stream = make_stream();
    std::string image = R"({"kernels": [{"name": "none"})";
    for (const char* name : {"plain", "extended", "cooperative", "old", "graph"})
        image += std::string(R"(, {"name": "by_)") + name + R"(", "block_ns": 1000})";
    CUmodule module = nullptr;
    MUST(cuModuleLoadData(&module, (image + "]}").c_str()));
    const auto function = [&](const char* name) {
        CUfunction f = nullptr;
        MUST(cuModuleGetFunction(&f, module, name));
        return f;
    };
    MUST(cuLaunchKernel(function("by_plain"), 1, 1, 1, 32, 1, 1, 0, stream, nullptr, nullptr));

    CUlaunchConfig one = {};
    one.gridDimX = one.gridDimY = one.gridDimZ = 1;
    one.blockDimX = one.blockDimY = one.blockDimZ = 1;
    one.hStream = stream;
    MUST(cuLaunchKernelEx(&one, function("by_extended"), nullptr, nullptr));
    MUST(cuLaunchCooperativeKernel(function("by_cooperative"), 1, 1, 1, 32, 1, 1, 0, stream,
                                   nullptr));

    const auto set_shape = reinterpret_cast<CUresult (*)(CUfunction, int, int, int)>(
        entry_point("cuFuncSetBlockShape", 2000, 0));
    const auto launch_old = reinterpret_cast<CUresult (*)(CUfunction, int, int, CUstream)>(
        entry_point("cuLaunchGridAsync", 2000, 0));
    MUST(set_shape(function("by_old"), 32, 1, 1));
    MUST(launch_old(function("by_old"), 1, 1, stream));

    CUgraph graph = nullptr;
    CUgraphNode node = nullptr;
    CUgraphExec executable = nullptr;
    CUDA_KERNEL_NODE_PARAMS kernel = {};
    kernel.func = function("by_graph");
    kernel.gridDimX = kernel.gridDimY = kernel.gridDimZ = 1;
    kernel.blockDimX = kernel.blockDimY = kernel.blockDimZ = 1;
    MUST(cuGraphCreate(&graph, 0));
    MUST(cuGraphAddKernelNode(&node, graph, nullptr, 0, &kernel));
    MUST(cuGraphInstantiate(&executable, graph, 0));
    MUST(cuGraphLaunch(executable, stream));

    // As PyTorch makes its graphs.
    constexpr auto kOwn = CUDA_GRAPH_INSTANTIATE_FLAG_USE_NODE_PRIORITY;
    kernel.func = function("by_nodes");
    MUST(cuGraphKernelNodeSetParams(node, &kernel));
    MUST(cuGraphInstantiateWithFlags(&executable, graph, kOwn));
    MUST(cuGraphLaunch(executable, stream));
    CUDA_GRAPH_INSTANTIATE_PARAMS parameters = {};
    parameters.flags = kOwn;
    MUST(cuGraphInstantiateWithParams(&executable, graph, &parameters));
    MUST(cuGraphLaunch(executable, stream));
    say("flags %d", int(parameters.flags));

    int priority = 99;
    MUST(of_driver<decltype(cuStreamGetPriority)>("cuStreamGetPriority")(stream, &priority));
    MUST(cuStreamSynchronize(stream));
    for (const simgpu_kernel_record& ran : kernel_log("by_")) say("%s %d", ran.name, ran.priority);
    say("stream %d", priority);
    return 0;
}

// The wait for a context as programs of CUDA 13 make it.
int waits_for_contexts(const Arguments&) {
    const Gpu gpu;
    const auto synchronize =
        reinterpret_cast<CUresult (*)(CUcontext)>(entry_point("cuCtxSynchronize", 13000, 0));
    for (int i = 0; i < 3; ++i) {
        MUST(launch_tiny(gpu.tiny, nullptr));
        MUST(synchronize(gpu.context));
    }
    say("done");
    return 0;
}

// A function's handle becomes another function's, of another name.
int reused_handles(const Arguments&) {
    const Gpu gpu;
    constexpr int kTries = 1000, kWanted = 5;
    int num_reused = 0;
    for (int i = 0; i < kTries && num_reused < kWanted; ++i) {
        CUmodule module = nullptr;
        CUfunction known = nullptr, other = nullptr;
        MUST(cuModuleLoadData(&module, kImage));
        MUST(cuModuleGetFunction(&known, module, "known"));
        MUST(launch_tiny(known, nullptr));
        MUST(cuCtxSynchronize());
        MUST(cuModuleUnload(module));
        MUST(cuModuleLoadData(&module, kImage));
        MUST(cuModuleGetFunction(&other, module, "other"));
        if (other == known) {
            MUST(launch_tiny(other, nullptr));
            ++num_reused;
        }
        MUST(cuCtxSynchronize());
        MUST(cuModuleUnload(module));
    }
    if (num_reused < kWanted) give_up("handles reused", num_reused);
    say("done");
    return 0;
}

// A stream is destroyed in the middle of the capture that it began: the capture is over.
int abandoned_capture(const Arguments&) {
    const Gpu gpu;
    const CUstream origin = make_stream(), other = make_stream();
    MUST(launch_tiny(gpu.tiny, other));
    MUST(cuStreamBeginCapture(origin, CU_STREAM_CAPTURE_MODE_RELAXED));
    MUST(launch_tiny(gpu.tiny, origin));
    MUST(cuStreamDestroy(origin));
    for (int i = 0; i < 3; ++i) MUST(launch_tiny(gpu.tiny, other));
    MUST(cuStreamSynchronize(other));
    say("done");
    return 0;
}

// Launches of kernels that were never launched before, while others are under way.
int first_launches(const Arguments&) {
    const Gpu gpu;
    const CUstream stream = make_stream();
    MUST(launch_wide(gpu.wide, stream));
    for (int i = 0; i < 3; ++i) MUST(launch_tiny(gpu.tiny, stream));
    for (int i = 0; i < 3; ++i) MUST(launch_tiny(gpu.function("other"), stream));
    MUST(cuStreamSynchronize(stream));
    say("done");
    return 0;
}

const Scenario s1("scheduling", scheduling, Runs::kSimulated),
    s0("position", position, Runs::kSimulated),
    s2("unsynchronised_contexts", unsynchronised_contexts),
    s3("waits_for_contexts", waits_for_contexts),
    s4("reused_handles", reused_handles, Runs::kSimulated),
    s5("abandoned_capture", abandoned_capture, Runs::kSimulated),
    s6("first_launches", first_launches, Runs::kSimulated),
    s7("priorities_of_launches", priorities_of_launches, Runs::kSimulated);

}  // namespace
}  // namespace twin
