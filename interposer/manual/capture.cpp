// SPDX-License-Identifier: Apache-2.0
//
// Stream capture: nothing of ours may get into the program's graph. The runtime knows where
// captures began that are under way, and keeps out of streams that capture.
#include "interposer/boundary.h"
#include "interposer/own_time.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;
using urgengo::exec::StreamFlavor;

namespace {

template <typename Begin>
CUresult begin_capture(CUstream stream, StreamFlavor flavor, Begin&& begin) {
    if (!acts()) return begin();
    const OwnTime own_time(CallClass::kOther);
    const Inside inside;
    protect([&] {
        the_runtime().streams().capture_begins(stream, flavor);
        // It ends with the thread, which then is to be heard of.
        if (urgengo::exec::is_per_thread(stream, flavor)) this_thread();
    });
    const CUresult result = OwnTime::in_driver(begin);
    if (result != CUDA_SUCCESS)
        protect([&] { the_runtime().streams().capture_ended(stream, flavor); });
    return result;
}

template <typename End>
CUresult end_capture(CUstream stream, StreamFlavor flavor, End&& end) {
    if (!acts()) return end();
    const OwnTime own_time(CallClass::kOther);
    const Inside inside;
    const CUresult result = OwnTime::in_driver(end);
    if (result == CUDA_SUCCESS || result == CUDA_ERROR_STREAM_CAPTURE_INVALIDATED ||
        result == CUDA_ERROR_STREAM_CAPTURE_UNJOINED)
        protect([&] { the_runtime().streams().capture_ended(stream, flavor); });
    return result;
}

}  // namespace

// cuda.h lets the first name stand for the second version.
#undef cuStreamBeginCapture

extern "C" {

CUresult CUDAAPI cuStreamBeginCapture(CUstream stream) {
    return begin_capture(stream, StreamFlavor::kLegacy,
                         [&] { return real().cuStreamBeginCapture_v1(stream); });
}

CUresult CUDAAPI cuStreamBeginCapture_ptsz(CUstream stream) {
    return begin_capture(stream, StreamFlavor::kPerThread,
                         [&] { return real().cuStreamBeginCapture_v1_ptsz(stream); });
}

CUresult CUDAAPI cuStreamBeginCapture_v2(CUstream stream, CUstreamCaptureMode mode) {
    return begin_capture(stream, StreamFlavor::kLegacy,
                         [&] { return real().cuStreamBeginCapture_v2(stream, mode); });
}

CUresult CUDAAPI cuStreamBeginCapture_v2_ptsz(CUstream stream, CUstreamCaptureMode mode) {
    return begin_capture(stream, StreamFlavor::kPerThread,
                         [&] { return real().cuStreamBeginCapture_v2_ptsz(stream, mode); });
}

CUresult CUDAAPI cuStreamBeginCaptureToGraph(CUstream stream, CUgraph graph,
                                             const CUgraphNode* dependencies,
                                             const CUgraphEdgeData* edges, size_t num_dependencies,
                                             CUstreamCaptureMode mode) {
    return begin_capture(stream, StreamFlavor::kLegacy, [&] {
        return real().cuStreamBeginCaptureToGraph(stream, graph, dependencies, edges,
                                                  num_dependencies, mode);
    });
}

CUresult CUDAAPI cuStreamBeginCaptureToGraph_ptsz(CUstream stream, CUgraph graph,
                                                  const CUgraphNode* dependencies,
                                                  const CUgraphEdgeData* edges,
                                                  size_t num_dependencies,
                                                  CUstreamCaptureMode mode) {
    return begin_capture(stream, StreamFlavor::kPerThread, [&] {
        return real().cuStreamBeginCaptureToGraph_ptsz(stream, graph, dependencies, edges,
                                                       num_dependencies, mode);
    });
}

CUresult CUDAAPI cuStreamEndCapture(CUstream stream, CUgraph* graph) {
    return end_capture(stream, StreamFlavor::kLegacy,
                       [&] { return real().cuStreamEndCapture(stream, graph); });
}

CUresult CUDAAPI cuStreamEndCapture_ptsz(CUstream stream, CUgraph* graph) {
    return end_capture(stream, StreamFlavor::kPerThread,
                       [&] { return real().cuStreamEndCapture_ptsz(stream, graph); });
}

}  // extern "C"
