// SPDX-License-Identifier: Apache-2.0
//
// Chains that always want more than the GPU has, for test_control.cpp, which switches UrgenGo off
// and on meanwhile: kernels that fill the GPU, graphs (whose priority is their stream's), and one
// kernel a frame whose result tells of every launch that was lost, made twice or out of order.
#include <urgengo/urgengo.h>

#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/kernel_log.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

constexpr int kChains = 4, kKernels = 6;

CUgraphExec graph_of(CUfunction function) {
    CUgraph graph = nullptr;
    CUgraphNode node = nullptr;
    CUgraphExec executable = nullptr;
    CUDA_KERNEL_NODE_PARAMS kernel = {};
    kernel.func = function;
    kernel.gridDimX = kernel.gridDimY = kernel.gridDimZ = 1;
    kernel.blockDimX = kernel.blockDimY = kernel.blockDimZ = 1;
    MUST(cuGraphCreate(&graph, 0));
    MUST(cuGraphAddKernelNode(&node, graph, nullptr, 0, &kernel));
    MUST(cuGraphInstantiate(&executable, graph, 0));
    return executable;
}

struct Steered {
    const Gpu& gpu;
    const ug_hints& hints;
    const std::atomic<bool>& go;
    CUfunction mix;
    std::string name;
    bool hints_frames;
    bool is_right = true;
    int priority = 99;

    void run() {
        name_this_thread(name);
        MUST(cuCtxSetCurrent(gpu.context));
        const CUstream stream = make_stream();
        std::uint64_t* const word = make_mapped(1);
        const CUgraphExec graph = graph_of(gpu.wide);
        std::uint64_t expected = 0;
        for (std::uint64_t frame = 0; go; ++frame) {
            if (hints_frames)
                hints.task_begin(hints.arrival(name.c_str(), 0, UG_CLOCK_MONOTONIC), "work");
            for (int i = 0; i < kKernels; ++i) MUST(launch_wide(gpu.wide, stream));
            MUST(cuGraphLaunch(graph, stream));
            std::uint64_t value = frame + 1;
            CUdeviceptr to = on_gpu(word);
            void* parameters[] = {&to, &value};
            MUST(cuLaunchKernel(mix, 1, 1, 1, 1, 1, 1, 0, stream, parameters, nullptr));
            MUST(cuStreamSynchronize(stream));
            expected = 31 * expected + value;
            is_right = is_right && *word == expected;
            if (hints_frames) hints.task_end();
        }
        // Past UrgenGo, which answers for what it has lent.
        MUST(of_driver<decltype(cuStreamGetPriority)>("cuStreamGetPriority")(stream, &priority));
    }
};

// Until its standard input ends.
int steered(const Arguments&) {
    ug_hints hints;
    ug_hints_load(&hints);
    const Gpu gpu;
    const CUfunction mix = gpu.function(kMixName);
    std::atomic<bool> go{true};
    std::vector<Steered> chains;
    chains.reserve(kChains);
    for (int i = 0; i < kChains; ++i)
        chains.push_back(
            {gpu, hints, go, mix, "steered_" + std::to_string(i), /* hints_frames = */ i % 2 == 0});
    std::vector<std::thread> threads;
    for (Steered& chain : chains) threads.emplace_back([&chain] { chain.run(); });
    for (char byte; read(STDIN_FILENO, &byte, 1) != 0;) {
    }
    go = false;
    for (std::thread& thread : threads) thread.join();
    for (const Steered& chain : chains)
        say("%s: %s, priority %d", chain.name.c_str(), chain.is_right ? "right" : "wrong",
            chain.priority);
    return 0;
}

// All that the program does is wait for one launch, which is held for as long as the kernel before
// it runs: ten minutes.
int hangs(const Arguments&) {
    constexpr char kImageOfIt[] =
        R"({"kernels": [{"name": "endless", "block_ns": 600000000000, "blocks_per_sm": 1}]})";
    ug_hints hints;
    ug_hints_load(&hints);
    const Gpu gpu;
    CUmodule module = nullptr;
    CUfunction endless = nullptr;
    MUST(cuModuleLoadData(&module, kImageOfIt));
    MUST(cuModuleGetFunction(&endless, module, "endless"));
    const CUstream first = make_stream(), second = make_stream();
    hints.task_begin(hints.arrival("tight", 0, UG_CLOCK_MONOTONIC), "work");
    MUST(launch_wide(endless, first));
    MUST(launch_wide(endless, first));
    std::thread held([&] {
        MUST(cuCtxSetCurrent(gpu.context));
        hints.task_begin(hints.arrival("loose", 0, UG_CLOCK_MONOTONIC), "work");
        MUST(launch_wide(gpu.wide, second));
        say("launched");
        // The kernels are never waited for.
        std::fflush(stdout);
        _exit(0);
    });
    held.join();
    return 1;
}

const Scenario s1("steered", steered, Runs::kSimulated), s2("hangs", hangs, Runs::kSimulated);

}  // namespace
}  // namespace twin
