// SPDX-License-Identifier: Apache-2.0
//
// The entry points of stream capture; capture.h says how it works.
#include "tools/simgpu/engine/zero_cost.h"
#include "tools/simgpu/graph/capture.h"
#include "tools/simgpu/graph/graph.h"

using namespace urgengo::simgpu;

// Newer than our cuda.h. (entry_names.h gives its symbol to what is declared before it is defined.)
SIMGPU_API CUresult cuStreamBeginRecaptureToGraph(CUstream, CUstreamCaptureMode, CUgraph,
                                                  void (*mismatch)(), void* user_data);

namespace {

CUresult begin(CUstream handle, CUstreamCaptureMode mode) {
    if (zero_cost()) return CUDA_ERROR_NOT_SUPPORTED;  // launches there look at no stream
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    return begin_capture(stream, mode);
}

/// What is not written is what has no meaning while the stream does not capture.
CUresult get_info(CUstream handle, CUstreamCaptureStatus* status, cuuint64_t* id, CUgraph* graph,
                  const CUgraphNode** dependencies, std::size_t* num_dependencies) {
    if (zero_cost() && status != nullptr) {
        *status = CU_STREAM_CAPTURE_STATUS_NONE;
        return CUDA_SUCCESS;
    }
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    if (status == nullptr) return CUDA_ERROR_INVALID_VALUE;
    CaptureInfo info;
    if (CUresult error = capture_info(*stream, info)) return error;
    *status = info.status;
    if (info.status == CU_STREAM_CAPTURE_STATUS_NONE) return CUDA_SUCCESS;
    if (id != nullptr) *id = info.id;
    if (info.status != CU_STREAM_CAPTURE_STATUS_ACTIVE) return CUDA_SUCCESS;
    if (graph != nullptr) *graph = info.graph;
    if (dependencies != nullptr) *dependencies = info.dependencies->data();
    if (num_dependencies != nullptr) *num_dependencies = info.dependencies->size();
    return CUDA_SUCCESS;
}

}  // namespace

SIMGPU_API CUresult cuStreamBeginCapture(CUstream handle) {
    return begin(handle, CU_STREAM_CAPTURE_MODE_GLOBAL);
}

SIMGPU_API CUresult cuStreamBeginCapture_v2(CUstream handle, CUstreamCaptureMode mode) {
    return begin(handle, mode);
}

SIMGPU_API CUresult cuStreamBeginCaptureToGraph(CUstream handle, CUgraph graph,
                                                const CUgraphNode* dependencies,
                                                const CUgraphEdgeData* edges, std::size_t count,
                                                CUstreamCaptureMode mode) {
    if (zero_cost()) return CUDA_ERROR_NOT_SUPPORTED;
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    if (!driver().graphs.find(graph) || (count > 0 && dependencies == nullptr)) {
        return CUDA_ERROR_INVALID_VALUE;
    }
    for (std::size_t i = 0; i < count; ++i) {
        const auto node = driver().graph_nodes.find(dependencies[i]);
        if (!node || node->graph != graph) return CUDA_ERROR_INVALID_VALUE;
        const bool plain = edges == nullptr || edges[i].type == CU_GRAPH_DEPENDENCY_TYPE_DEFAULT;
        if (!plain) return CUDA_ERROR_NOT_SUPPORTED;
    }
    return begin_capture(stream, mode, graph, {dependencies, dependencies + count});
}

// The graph's nodes are made anew, where the driver keeps them, and what is captured is not
// compared with them: so `mismatch` is never called.
SIMGPU_API CUresult cuStreamBeginRecaptureToGraph(CUstream handle, CUstreamCaptureMode mode,
                                                  CUgraph graph, void (*mismatch)(),
                                                  void* user_data) {
    if (zero_cost()) return CUDA_ERROR_NOT_SUPPORTED;
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    const auto its = driver().graphs.find(graph);
    if (!its) return CUDA_ERROR_INVALID_VALUE;
    if (CUresult error = begin_capture(stream, mode, graph)) return error;
    const auto nodes = its->nodes;
    for (const auto& node : nodes) cuGraphDestroyNode(reinterpret_cast<CUgraphNode>(node.get()));
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuStreamEndCapture(CUstream handle, CUgraph* graph) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    return graph == nullptr ? CUDA_ERROR_INVALID_VALUE : end_capture(*stream, graph);
}

SIMGPU_API CUresult cuStreamIsCapturing(CUstream handle, CUstreamCaptureStatus* status) {
    return get_info(handle, status, nullptr, nullptr, nullptr, nullptr);
}

SIMGPU_API CUresult cuStreamGetCaptureInfo(CUstream handle, CUstreamCaptureStatus* status,
                                           cuuint64_t* id) {
    return get_info(handle, status, id, nullptr, nullptr, nullptr);
}

SIMGPU_API CUresult cuStreamGetCaptureInfo_v2(CUstream handle, CUstreamCaptureStatus* status,
                                              cuuint64_t* id, CUgraph* graph,
                                              const CUgraphNode** dependencies,
                                              std::size_t* num_dependencies) {
    return get_info(handle, status, id, graph, dependencies, num_dependencies);
}

SIMGPU_API CUresult cuStreamGetCaptureInfo_v3(CUstream handle, CUstreamCaptureStatus* status,
                                              cuuint64_t* id, CUgraph* graph,
                                              const CUgraphNode** dependencies,
                                              const CUgraphEdgeData** edges,
                                              std::size_t* num_dependencies) {
    if (edges != nullptr) *edges = nullptr;  // no edge carries data
    return get_info(handle, status, id, graph, dependencies, num_dependencies);
}

SIMGPU_API CUresult cuThreadExchangeStreamCaptureMode(CUstreamCaptureMode* mode) {
    if (mode == nullptr || *mode < CU_STREAM_CAPTURE_MODE_GLOBAL ||
        *mode > CU_STREAM_CAPTURE_MODE_RELAXED) {
        return CUDA_ERROR_INVALID_VALUE;
    }
    exchange_capture_mode(*mode);
    return CUDA_SUCCESS;
}
