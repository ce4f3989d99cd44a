// SPDX-License-Identifier: Apache-2.0
//
// Captures in every mode while other threads launch, over several streams. A capture sees
// everything that is done to a stream, so anything added to one shows here.
#include <atomic>
#include <thread>
#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/graphs.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

/// Threads that are tasks, and launch and wait until they are told to stop. What they call is
/// allowed during captures of others; a relaxed thread's waits too.
class Others {
  public:
    Others(const Gpu& gpu, int num_threads) {
        for (int t = 0; t < num_threads; ++t)
            threads_.emplace_back([this, &gpu, t] { run(gpu, t); });
        while (num_frames_ < 3 * num_threads) std::this_thread::yield();
    }
    /// @returns the sum of all results of their calls
    int stop() {
        stop_ = true;
        for (std::thread& thread : threads_) thread.join();
        return sum_;
    }
    void wait_for_frames(int count) const {
        for (const int until = num_frames_ + count; num_frames_ < until;) std::this_thread::yield();
    }

  private:
    void run(const Gpu& gpu, int t) {
        name_this_thread("twin_" + std::to_string(t + 1));
        MUST(cuCtxSetCurrent(gpu.context));
        CUstreamCaptureMode mode = CU_STREAM_CAPTURE_MODE_RELAXED;
        MUST(cuThreadExchangeStreamCaptureMode(&mode));
        const CUstream stream = make_stream(CU_STREAM_NON_BLOCKING, -t);
        while (!stop_) {
            for (int i = 0; i < 6; ++i) sum_ += launch_wide(gpu.wide, stream);
            sum_ += cuStreamSynchronize(stream);
            ++num_frames_;
        }
    }

    std::vector<std::thread> threads_;
    std::atomic<bool> stop_{false};
    std::atomic<int> num_frames_{0}, sum_{0};
};

void capture_in_mode(const Gpu& gpu, const Others& others, CUstreamCaptureMode mode) {
    std::uint64_t* to = make_mapped(2);
    const CUstream stream = make_stream(CU_STREAM_NON_BLOCKING, -3);
    for (int i = 0; i < 3; ++i) MUST(launch_wide(gpu.wide, stream));  // not waited for
    say_priority(stream);
    SHOW(cuStreamBeginCapture(stream, mode));
    CUstreamCaptureStatus status{};
    SHOW(cuStreamIsCapturing(stream, &status));
    say("status %d", int(status));
    say_priority(stream);
    SHOW(launch_wide(gpu.wide, stream));
    others.wait_for_frames(6);  // they launch and wait meanwhile
    SHOW(launch_store(gpu.store, to, 100 + std::uint64_t(mode), stream));
    SHOW(cuStreamIsCapturing(stream, &status));
    say("status %d", int(status));
    CUgraph graph = nullptr;
    SHOW(cuStreamEndCapture(stream, &graph));
    say_priority(stream);
    say_nodes(graph);
    const CUgraphExec exec = instantiate(graph);
    for (int i = 0; i < 3; ++i) {
        to[0] = 0;
        SHOW(cuGraphLaunch(exec, stream));
        say_priority(stream);
        SHOW(cuStreamSynchronize(stream));
        say("%d", int(to[0]));
    }
}

int capture_busy(const Arguments&) {
    const Gpu gpu;
    MUST(launch_tiny(gpu.tiny, nullptr));
    MUST(cuStreamSynchronize(nullptr));
    Others others(gpu, 3);
    for (auto mode : {CU_STREAM_CAPTURE_MODE_GLOBAL, CU_STREAM_CAPTURE_MODE_THREAD_LOCAL,
                      CU_STREAM_CAPTURE_MODE_RELAXED})
        capture_in_mode(gpu, others, mode);
    say("others: %d", others.stop());
    return 0;
}

// A thread's very first launch, and with it whatever must be set up then, falls into a global
// capture of another; so does the first launch in another context.
int capture_first_launch(const Arguments&) {
    const Gpu gpu;
    const CUstream captures = make_stream(), launches = make_stream();
    const auto create = reinterpret_cast<CUresult (*)(CUcontext*, unsigned, CUdevice)>(
        entry_point("cuCtxCreate", 3020, 0));
    CUcontext other = nullptr;
    CUmodule module = nullptr;
    CUfunction tiny = nullptr;
    MUST(create(&other, 0, 0));
    MUST(cuModuleLoadData(&module, kImage));
    MUST(cuModuleGetFunction(&tiny, module, "tiny"));
    const CUstream there = make_stream();
    MUST(cuCtxPopCurrent(nullptr));
    SHOW(cuStreamBeginCapture(captures, CU_STREAM_CAPTURE_MODE_GLOBAL));
    SHOW(launch_tiny(gpu.tiny, captures));
    std::thread([&] {
        name_this_thread("twin_2");
        MUST(cuCtxSetCurrent(gpu.context));
        for (int i = 0; i < 20; ++i) SHOW(launch_wide(gpu.wide, launches));
        MUST(cuCtxSetCurrent(other));
        for (int i = 0; i < 20; ++i) SHOW(launch_tiny(tiny, there));
    }).join();
    SHOW(launch_tiny(gpu.tiny, launches));
    CUgraph graph = nullptr;
    SHOW(cuStreamEndCapture(captures, &graph));
    say_nodes(graph);
    SHOW(cuCtxSynchronize());
    MUST(cuCtxPushCurrent(other));
    SHOW(cuCtxSynchronize());
    return 0;
}

// The legacy stream while a blocking one captures: every call there says so, and ends the capture;
// a non-blocking one does not concern it.
int capture_implicit(const Arguments&) {
    const Gpu gpu;
    for (int i = 0; i < 3; ++i) MUST(launch_wide(gpu.wide, nullptr));
    for (const unsigned flags : {CU_STREAM_NON_BLOCKING, CU_STREAM_DEFAULT}) {
        const CUstream stream = make_stream(flags);
        SHOW(cuStreamBeginCapture(stream, CU_STREAM_CAPTURE_MODE_RELAXED));
        SHOW(launch_tiny(gpu.tiny, stream));
        CUstreamCaptureStatus status{};
        // To ask the legacy stream is no harm; to use it ends the capture.
        SHOW(cuStreamIsCapturing(nullptr, &status));
        SHOW(cuStreamIsCapturing(stream, &status));
        say("status %d", int(status));
        SHOW(launch_tiny(gpu.tiny, CU_STREAM_PER_THREAD));
        SHOW(launch_tiny(gpu.tiny, nullptr));
        SHOW(launch_tiny(gpu.tiny, stream));
        CUgraph graph = nullptr;
        SHOW(cuStreamEndCapture(stream, &graph));
        say("a graph: %d", graph != nullptr);
        if (graph) say_nodes(graph);
        SHOW(launch_tiny(gpu.tiny, nullptr));
        SHOW(cuStreamSynchronize(nullptr));
    }
    // The per-thread default stream itself.
    CUgraph graph = nullptr;
    SHOW(cuStreamBeginCapture(CU_STREAM_PER_THREAD, CU_STREAM_CAPTURE_MODE_THREAD_LOCAL));
    SHOW(launch_tiny(gpu.tiny, CU_STREAM_PER_THREAD));
    SHOW(cuStreamEndCapture(CU_STREAM_PER_THREAD, &graph));
    say_nodes(graph);
    return 0;
}

// Fork and join by events; a third stream launches normally in between.
int capture_joined(const Arguments&) {
    const Gpu gpu;
    std::uint64_t* to = make_mapped(4);
    const CUstream origin = make_stream(CU_STREAM_NON_BLOCKING, -1),
                   side = make_stream(CU_STREAM_NON_BLOCKING, -4), outside = make_stream();
    CUevent fork = nullptr, join = nullptr;
    MUST(cuEventCreate(&fork, CU_EVENT_DISABLE_TIMING));
    MUST(cuEventCreate(&join, CU_EVENT_DISABLE_TIMING));
    for (CUstream stream : {origin, side, outside}) MUST(launch_wide(gpu.wide, stream));
    SHOW(cuStreamBeginCapture(origin, CU_STREAM_CAPTURE_MODE_GLOBAL));
    SHOW(launch_wide(gpu.wide, origin));
    SHOW(cuEventRecord(fork, origin));
    SHOW(cuStreamWaitEvent(side, fork, 0));
    SHOW(launch_wide(gpu.wide, side));
    SHOW(launch_wide(gpu.wide, outside));
    SHOW(launch_store(gpu.store, to, 1, side));
    SHOW(launch_store(gpu.store, to + 2, 2, origin));
    SHOW(cuEventQuery(fork));  // cannot be captured, and ends the capture
    SHOW(cuEventRecord(join, side));
    CUgraph graph = nullptr;
    SHOW(cuStreamEndCapture(origin, &graph));
    say("a graph: %d", graph != nullptr);
    // Again, properly.
    SHOW(cuStreamBeginCapture(origin, CU_STREAM_CAPTURE_MODE_GLOBAL));
    SHOW(launch_wide(gpu.wide, origin));
    SHOW(cuEventRecord(fork, origin));
    SHOW(cuStreamWaitEvent(side, fork, 0));
    SHOW(launch_store(gpu.store, to, 1, side));
    SHOW(launch_wide(gpu.wide, outside));
    SHOW(launch_store(gpu.store, to + 2, 2, origin));
    SHOW(cuEventRecord(join, side));
    SHOW(cuStreamEndCapture(origin, &graph));  // not joined yet
    SHOW(cuStreamBeginCapture(origin, CU_STREAM_CAPTURE_MODE_GLOBAL));
    SHOW(cuEventRecord(fork, origin));
    SHOW(cuStreamWaitEvent(side, fork, 0));
    SHOW(launch_store(gpu.store, to, 3, side));
    SHOW(launch_store(gpu.store, to + 2, 4, origin));
    SHOW(cuEventRecord(join, side));
    SHOW(cuStreamWaitEvent(origin, join, 0));
    SHOW(launch_tiny(gpu.tiny, origin));
    SHOW(cuStreamEndCapture(origin, &graph));
    say_nodes(graph);
    say_priority(origin);
    say_priority(side);
    SHOW(cuGraphLaunch(instantiate(graph), side));
    SHOW(cuStreamSynchronize(side));
    say("%d %d", int(to[0]), int(to[2]));
    SHOW(cuStreamSynchronize(outside));
    return 0;
}

const Scenario s1("capture_busy", capture_busy), s2("capture_first_launch", capture_first_launch),
    s3("capture_implicit", capture_implicit), s4("capture_joined", capture_joined);

}  // namespace
}  // namespace twin
