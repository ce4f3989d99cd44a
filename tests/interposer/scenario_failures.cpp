// SPDX-License-Identifier: Apache-2.0
//
// A program that goes on whatever its calls return, for runs in which the driver is told to fail
// (SIMGPU_FAIL). All its calls of what UrgenGo calls too come before its first launch, so that a
// test can name a call of UrgenGo's own by its number: one cuModuleLoadData, six
// cuModuleGetFunction, no cuMemHostRegister, cuCtxGet..., cuFuncGetName, or capture status.
#include <thread>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

struct Program {
    Gpu gpu;
    CUfunction store = gpu.function("simgpu_store");  // which no injection into marks means
    CUfunction frail = gpu.function("frail");         // the tests make its launches fail
    CUfunction very_long = gpu.function("very_long");
    CUstream stream = make_stream(CU_STREAM_NON_BLOCKING, -1);
    CUstream own = make_stream(CU_STREAM_DEFAULT, -2);
    std::uint64_t* word = make_mapped(2);
};

// The frail launch is waited for at once: a kernel that ends badly is known of at its end.
void frame(Program& p, CUstream stream, std::uint64_t value) {
    for (int i = 0; i < 3; ++i) SHOW(launch_wide(p.gpu.wide, stream));
    SHOW(launch_tiny(p.frail, stream));
    SHOW(cuStreamSynchronize(stream));
    SHOW(launch_wide(p.gpu.wide, stream));
    SHOW(launch_store(p.store, p.word, value, stream));
    SHOW(cuStreamSynchronize(stream));
    say("%d", int(p.word[0]));
}

void say_priorities(const Program& p) {
    for (CUstream stream : {p.stream, p.own, CUstream(nullptr)}) {
        int priority = 99;
        CUstreamAttrValue value{};
        SHOW(cuStreamGetPriority(stream, &priority));
        const auto get = [&] {
            return cuStreamGetAttribute(stream, CU_LAUNCH_ATTRIBUTE_PRIORITY, &value);
        };
        SHOW(get());
        say("priority %d %d", priority, value.priority);
    }
}

void graph(Program& p) {
    CUgraph graph = nullptr;
    CUgraphExec exec = nullptr;
    SHOW(cuStreamBeginCapture(p.stream, CU_STREAM_CAPTURE_MODE_GLOBAL));
    SHOW(launch_wide(p.gpu.wide, p.stream));
    SHOW(launch_store(p.store, p.word, 300, p.stream));
    SHOW(cuStreamEndCapture(p.stream, &graph));
    SHOW(cuGraphInstantiateWithFlags(&exec, graph, 0));
    for (CUstream stream : {p.stream, p.own, p.stream}) {
        p.word[0] = 0;
        SHOW(cuGraphLaunch(exec, stream));
        SHOW(launch_wide(p.gpu.wide, stream));
        SHOW(cuStreamSynchronize(stream));
        say("graph: %d", int(p.word[0]));
    }
}

int failures(const Arguments&) {
    Program p;
    for (int i = 0; i < 3; ++i) frame(p, p.stream, 100 + std::uint64_t(i));
    say_priorities(p);
    graph(p);
    say_priorities(p);
    frame(p, p.own, 200);
    frame(p, nullptr, 201);
    // Held, if launches are: the more urgent main thread has the GPU.
    for (int i = 0; i < 2; ++i) SHOW(launch_wide(p.very_long, p.own));
    std::thread([&] {
        name_this_thread("twin_1");
        SHOW(cuCtxSetCurrent(p.gpu.context));
        frame(p, p.stream, 400);
        frame(p, p.stream, 401);
    }).join();
    SHOW(cuCtxSynchronize());
    say_priorities(p);
    SHOW(cuStreamDestroy(p.own));
    SHOW(cuStreamDestroy(p.stream));
    SHOW(cuModuleUnload(p.gpu.module));
    // After a reset the device is as new, even if a kernel broke its context.
    SHOW(cuDevicePrimaryCtxReset(0));
    {
        Program again;
        frame(again, again.stream, 500);
        say_priorities(again);
    }
    return 0;
}

const Scenario s1("failures", failures, Runs::kSimulated);

}  // namespace
}  // namespace twin
