// SPDX-License-Identifier: Apache-2.0
//
// Stream capture, which the simulated GPU does not support: nothing ever captures.
#include <utility>

#include "tools/simgpu/driver_state.h"
#include "tools/simgpu/zero_cost.h"

using namespace urgengo::simgpu;

namespace {

CUresult refuse_capture(CUstream handle) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    return CUDA_ERROR_NOT_SUPPORTED;
}

CUresult capture_status(CUstream handle, CUstreamCaptureStatus* status) {
    if (zero_cost() && status != nullptr) {
        *status = CU_STREAM_CAPTURE_STATUS_NONE;
        return CUDA_SUCCESS;
    }
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    if (status == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *status = CU_STREAM_CAPTURE_STATUS_NONE;
    return CUDA_SUCCESS;
}

}  // namespace

SIMGPU_API CUresult cuStreamBeginCapture(CUstream handle) {
    return refuse_capture(handle);
}

SIMGPU_API CUresult cuStreamBeginCapture_v2(CUstream handle, CUstreamCaptureMode mode) {
    return refuse_capture(handle);
}

SIMGPU_API CUresult cuStreamEndCapture(CUstream handle, CUgraph* graph) {
    return refuse_capture(handle);
}

SIMGPU_API CUresult cuStreamIsCapturing(CUstream handle, CUstreamCaptureStatus* status) {
    return capture_status(handle, status);
}

// The other outputs have a meaning, and are written, only while the stream captures.
SIMGPU_API CUresult cuStreamGetCaptureInfo(CUstream handle, CUstreamCaptureStatus* status,
                                           cuuint64_t* id) {
    return capture_status(handle, status);
}

SIMGPU_API CUresult cuStreamGetCaptureInfo_v2(CUstream handle, CUstreamCaptureStatus* status,
                                              cuuint64_t* id, CUgraph* graph,
                                              const CUgraphNode** dependencies,
                                              std::size_t* num_dependencies) {
    return capture_status(handle, status);
}

SIMGPU_API CUresult cuStreamGetCaptureInfo_v3(CUstream handle, CUstreamCaptureStatus* status,
                                              cuuint64_t* id, CUgraph* graph,
                                              const CUgraphNode** dependencies,
                                              const CUgraphEdgeData** edges,
                                              std::size_t* num_dependencies) {
    return capture_status(handle, status);
}

SIMGPU_API CUresult cuThreadExchangeStreamCaptureMode(CUstreamCaptureMode* mode) {
    if (mode == nullptr || *mode < CU_STREAM_CAPTURE_MODE_GLOBAL ||
        *mode > CU_STREAM_CAPTURE_MODE_RELAXED) {
        return CUDA_ERROR_INVALID_VALUE;
    }
    thread_local CUstreamCaptureMode own = CU_STREAM_CAPTURE_MODE_GLOBAL;
    std::swap(own, *mode);
    return CUDA_SUCCESS;
}
