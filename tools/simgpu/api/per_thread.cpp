// SPDX-License-Identifier: Apache-2.0
//
// The entry points of the per-thread default stream's flavour: _ptsz takes a stream, where NULL
// then means the calling thread's own; _ptds takes none and uses that.
#include "tools/simgpu/api/driver_state.h"
#include "tools/simgpu/memory/copy.h"

using namespace urgengo::simgpu;

// Streams and events.

SIMGPU_API CUresult cuStreamSynchronize_ptsz(CUstream stream) {
    return cuStreamSynchronize(per_thread_if_null(stream));
}

SIMGPU_API CUresult cuStreamQuery_ptsz(CUstream stream) {
    return cuStreamQuery(per_thread_if_null(stream));
}

SIMGPU_API CUresult cuStreamWaitEvent_ptsz(CUstream stream, CUevent event, unsigned flags) {
    return cuStreamWaitEvent(per_thread_if_null(stream), event, flags);
}

SIMGPU_API CUresult cuStreamGetPriority_ptsz(CUstream stream, int* priority) {
    return cuStreamGetPriority(per_thread_if_null(stream), priority);
}

SIMGPU_API CUresult cuStreamGetFlags_ptsz(CUstream stream, unsigned* flags) {
    return cuStreamGetFlags(per_thread_if_null(stream), flags);
}

SIMGPU_API CUresult cuStreamGetId_ptsz(CUstream stream, unsigned long long* id) {
    return cuStreamGetId(per_thread_if_null(stream), id);
}

SIMGPU_API CUresult cuStreamGetCtx_ptsz(CUstream stream, CUcontext* context) {
    return cuStreamGetCtx(per_thread_if_null(stream), context);
}

SIMGPU_API CUresult cuStreamBeginCaptureToGraph_ptsz(CUstream stream, CUgraph graph,
                                                     const CUgraphNode* dependencies,
                                                     const CUgraphEdgeData* edges,
                                                     std::size_t count, CUstreamCaptureMode mode) {
    return cuStreamBeginCaptureToGraph(per_thread_if_null(stream), graph, dependencies, edges,
                                       count, mode);
}

// Not in every cuda.h that this must build with.
SIMGPU_API CUresult cuStreamGetCtx_v2(CUstream stream, CUcontext* context, CUgreenCtx* green);
SIMGPU_API CUresult cuStreamGetDevice(CUstream stream, CUdevice* device);

SIMGPU_API CUresult cuStreamGetCtx_v2_ptsz(CUstream stream, CUcontext* context, CUgreenCtx* green) {
    return cuStreamGetCtx_v2(per_thread_if_null(stream), context, green);
}

SIMGPU_API CUresult cuStreamGetDevice_ptsz(CUstream stream, CUdevice* device) {
    return cuStreamGetDevice(per_thread_if_null(stream), device);
}

SIMGPU_API CUresult cuStreamAddCallback_ptsz(CUstream stream, CUstreamCallback callback,
                                             void* user_data, unsigned flags) {
    return cuStreamAddCallback(per_thread_if_null(stream), callback, user_data, flags);
}

SIMGPU_API CUresult cuLaunchHostFunc_ptsz(CUstream stream, CUhostFn function, void* user_data) {
    return cuLaunchHostFunc(per_thread_if_null(stream), function, user_data);
}

SIMGPU_API CUresult cuStreamSetAttribute_ptsz(CUstream stream, CUstreamAttrID id,
                                              const CUstreamAttrValue* value) {
    return cuStreamSetAttribute(per_thread_if_null(stream), id, value);
}

SIMGPU_API CUresult cuStreamGetAttribute_ptsz(CUstream stream, CUstreamAttrID id,
                                              CUstreamAttrValue* value) {
    return cuStreamGetAttribute(per_thread_if_null(stream), id, value);
}

SIMGPU_API CUresult cuStreamCopyAttributes_ptsz(CUstream to, CUstream from) {
    return cuStreamCopyAttributes(per_thread_if_null(to), per_thread_if_null(from));
}

SIMGPU_API CUresult cuEventRecord_ptsz(CUevent event, CUstream stream) {
    return cuEventRecord(event, per_thread_if_null(stream));
}

SIMGPU_API CUresult cuEventRecordWithFlags_ptsz(CUevent event, CUstream stream, unsigned flags) {
    return cuEventRecordWithFlags(event, per_thread_if_null(stream), flags);
}

// Capture.

SIMGPU_API CUresult cuStreamBeginCapture_ptsz(CUstream stream) {
    return cuStreamBeginCapture(per_thread_if_null(stream));
}

SIMGPU_API CUresult cuStreamBeginCapture_v2_ptsz(CUstream stream, CUstreamCaptureMode mode) {
    return cuStreamBeginCapture_v2(per_thread_if_null(stream), mode);
}

SIMGPU_API CUresult cuStreamEndCapture_ptsz(CUstream stream, CUgraph* graph) {
    return cuStreamEndCapture(per_thread_if_null(stream), graph);
}

SIMGPU_API CUresult cuStreamIsCapturing_ptsz(CUstream stream, CUstreamCaptureStatus* status) {
    return cuStreamIsCapturing(per_thread_if_null(stream), status);
}

SIMGPU_API CUresult cuStreamGetCaptureInfo_ptsz(CUstream stream, CUstreamCaptureStatus* status,
                                                cuuint64_t* id) {
    return cuStreamGetCaptureInfo(per_thread_if_null(stream), status, id);
}

SIMGPU_API CUresult cuStreamGetCaptureInfo_v2_ptsz(CUstream stream, CUstreamCaptureStatus* status,
                                                   cuuint64_t* id, CUgraph* graph,
                                                   const CUgraphNode** dependencies,
                                                   std::size_t* num_dependencies) {
    return cuStreamGetCaptureInfo_v2(per_thread_if_null(stream), status, id, graph, dependencies,
                                     num_dependencies);
}

SIMGPU_API CUresult cuStreamGetCaptureInfo_v3_ptsz(CUstream stream, CUstreamCaptureStatus* status,
                                                   cuuint64_t* id, CUgraph* graph,
                                                   const CUgraphNode** dependencies,
                                                   const CUgraphEdgeData** edges,
                                                   std::size_t* num_dependencies) {
    return cuStreamGetCaptureInfo_v3(per_thread_if_null(stream), status, id, graph, dependencies,
                                     edges, num_dependencies);
}

// Launches.

SIMGPU_API CUresult cuLaunchKernel_ptsz(CUfunction function, unsigned grid_x, unsigned grid_y,
                                        unsigned grid_z, unsigned block_x, unsigned block_y,
                                        unsigned block_z, unsigned shared_bytes, CUstream stream,
                                        void** params, void** extra) {
    return cuLaunchKernel(function, grid_x, grid_y, grid_z, block_x, block_y, block_z, shared_bytes,
                          per_thread_if_null(stream), params, extra);
}

SIMGPU_API CUresult cuLaunchKernelEx_ptsz(const CUlaunchConfig* config, CUfunction function,
                                          void** params, void** extra) {
    if (config == nullptr) return cuLaunchKernelEx(config, function, params, extra);
    CUlaunchConfig own = *config;
    own.hStream = per_thread_if_null(own.hStream);
    return cuLaunchKernelEx(&own, function, params, extra);
}

SIMGPU_API CUresult cuLaunchCooperativeKernel_ptsz(CUfunction function, unsigned grid_x,
                                                   unsigned grid_y, unsigned grid_z,
                                                   unsigned block_x, unsigned block_y,
                                                   unsigned block_z, unsigned shared_bytes,
                                                   CUstream stream, void** params) {
    return cuLaunchCooperativeKernel(function, grid_x, grid_y, grid_z, block_x, block_y, block_z,
                                     shared_bytes, per_thread_if_null(stream), params);
}

SIMGPU_API CUresult cuGraphInstantiateWithParams_ptsz(CUgraphExec* exec, CUgraph graph,
                                                      CUDA_GRAPH_INSTANTIATE_PARAMS* params) {
    return cuGraphInstantiateWithParams(exec, graph, params);  // uploads nothing, on no stream
}

SIMGPU_API CUresult cuGraphUpload_ptsz(CUgraphExec exec, CUstream stream) {
    return cuGraphUpload(exec, per_thread_if_null(stream));
}

SIMGPU_API CUresult cuGraphLaunch_ptsz(CUgraphExec exec, CUstream stream) {
    return cuGraphLaunch(exec, per_thread_if_null(stream));
}

// Memory.

SIMGPU_API CUresult cuMemAllocAsync_ptsz(CUdeviceptr* pointer, std::size_t bytes, CUstream stream) {
    return cuMemAllocAsync(pointer, bytes, per_thread_if_null(stream));
}

SIMGPU_API CUresult cuMemAllocFromPoolAsync_ptsz(CUdeviceptr* pointer, std::size_t bytes,
                                                 CUmemoryPool pool, CUstream stream) {
    return cuMemAllocFromPoolAsync(pointer, bytes, pool, per_thread_if_null(stream));
}

SIMGPU_API CUresult cuMemFreeAsync_ptsz(CUdeviceptr pointer, CUstream stream) {
    return cuMemFreeAsync(pointer, per_thread_if_null(stream));
}

SIMGPU_API CUresult cuMemcpy_ptds(CUdeviceptr to, CUdeviceptr from, std::size_t bytes) {
    return copy({to, from, bytes, CopyKind::kFromPointers, CU_STREAM_PER_THREAD, true});
}

SIMGPU_API CUresult cuMemcpyAsync_ptsz(CUdeviceptr to, CUdeviceptr from, std::size_t bytes,
                                       CUstream stream) {
    return cuMemcpyAsync(to, from, bytes, per_thread_if_null(stream));
}

SIMGPU_API CUresult cuMemcpyHtoD_v2_ptds(CUdeviceptr to, const void* from, std::size_t bytes) {
    return copy({to, reinterpret_cast<std::uintptr_t>(from), bytes, CopyKind::kHostToDevice,
                 CU_STREAM_PER_THREAD, true});
}

SIMGPU_API CUresult cuMemcpyHtoDAsync_v2_ptsz(CUdeviceptr to, const void* from, std::size_t bytes,
                                              CUstream stream) {
    return cuMemcpyHtoDAsync_v2(to, from, bytes, per_thread_if_null(stream));
}

SIMGPU_API CUresult cuMemcpyDtoH_v2_ptds(void* to, CUdeviceptr from, std::size_t bytes) {
    return copy({reinterpret_cast<std::uintptr_t>(to), from, bytes, CopyKind::kDeviceToHost,
                 CU_STREAM_PER_THREAD, true});
}

SIMGPU_API CUresult cuMemcpyDtoHAsync_v2_ptsz(void* to, CUdeviceptr from, std::size_t bytes,
                                              CUstream stream) {
    return cuMemcpyDtoHAsync_v2(to, from, bytes, per_thread_if_null(stream));
}

SIMGPU_API CUresult cuMemcpyDtoD_v2_ptds(CUdeviceptr to, CUdeviceptr from, std::size_t bytes) {
    return copy({to, from, bytes, CopyKind::kDeviceToDevice, CU_STREAM_PER_THREAD, true});
}

SIMGPU_API CUresult cuMemcpyDtoDAsync_v2_ptsz(CUdeviceptr to, CUdeviceptr from, std::size_t bytes,
                                              CUstream stream) {
    return cuMemcpyDtoDAsync_v2(to, from, bytes, per_thread_if_null(stream));
}

SIMGPU_API CUresult cuMemsetD8_v2_ptds(CUdeviceptr to, unsigned char value, std::size_t count) {
    return memset(to, value, 1, count, CU_STREAM_PER_THREAD);
}

SIMGPU_API CUresult cuMemsetD16_v2_ptds(CUdeviceptr to, unsigned short value, std::size_t count) {
    return memset(to, value, 2, count, CU_STREAM_PER_THREAD);
}

SIMGPU_API CUresult cuMemsetD32_v2_ptds(CUdeviceptr to, unsigned value, std::size_t count) {
    return memset(to, value, 4, count, CU_STREAM_PER_THREAD);
}

SIMGPU_API CUresult cuMemsetD8Async_ptsz(CUdeviceptr to, unsigned char value, std::size_t count,
                                         CUstream stream) {
    return memset(to, value, 1, count, per_thread_if_null(stream));
}

SIMGPU_API CUresult cuMemsetD16Async_ptsz(CUdeviceptr to, unsigned short value, std::size_t count,
                                          CUstream stream) {
    return memset(to, value, 2, count, per_thread_if_null(stream));
}

SIMGPU_API CUresult cuMemsetD32Async_ptsz(CUdeviceptr to, unsigned value, std::size_t count,
                                          CUstream stream) {
    return memset(to, value, 4, count, per_thread_if_null(stream));
}

// Stream memory operations: before (plain) and since (_v2) CUDA 12.

SIMGPU_API CUresult cuStreamWriteValue32_ptsz(CUstream stream, CUdeviceptr address,
                                              cuuint32_t value, unsigned flags) {
    return cuStreamWriteValue32(per_thread_if_null(stream), address, value, flags);
}

SIMGPU_API CUresult cuStreamWriteValue32_v2_ptsz(CUstream stream, CUdeviceptr address,
                                                 cuuint32_t value, unsigned flags) {
    return cuStreamWriteValue32_v2(per_thread_if_null(stream), address, value, flags);
}

SIMGPU_API CUresult cuStreamWriteValue64_ptsz(CUstream stream, CUdeviceptr address,
                                              cuuint64_t value, unsigned flags) {
    return cuStreamWriteValue64(per_thread_if_null(stream), address, value, flags);
}

SIMGPU_API CUresult cuStreamWriteValue64_v2_ptsz(CUstream stream, CUdeviceptr address,
                                                 cuuint64_t value, unsigned flags) {
    return cuStreamWriteValue64_v2(per_thread_if_null(stream), address, value, flags);
}

SIMGPU_API CUresult cuStreamWaitValue32_ptsz(CUstream stream, CUdeviceptr address, cuuint32_t value,
                                             unsigned flags) {
    return cuStreamWaitValue32(per_thread_if_null(stream), address, value, flags);
}

SIMGPU_API CUresult cuStreamWaitValue32_v2_ptsz(CUstream stream, CUdeviceptr address,
                                                cuuint32_t value, unsigned flags) {
    return cuStreamWaitValue32_v2(per_thread_if_null(stream), address, value, flags);
}

SIMGPU_API CUresult cuStreamWaitValue64_ptsz(CUstream stream, CUdeviceptr address, cuuint64_t value,
                                             unsigned flags) {
    return cuStreamWaitValue64(per_thread_if_null(stream), address, value, flags);
}

SIMGPU_API CUresult cuStreamWaitValue64_v2_ptsz(CUstream stream, CUdeviceptr address,
                                                cuuint64_t value, unsigned flags) {
    return cuStreamWaitValue64_v2(per_thread_if_null(stream), address, value, flags);
}

SIMGPU_API CUresult cuStreamBatchMemOp_ptsz(CUstream stream, unsigned count,
                                            CUstreamBatchMemOpParams* ops, unsigned flags) {
    return cuStreamBatchMemOp(per_thread_if_null(stream), count, ops, flags);
}

SIMGPU_API CUresult cuStreamBatchMemOp_v2_ptsz(CUstream stream, unsigned count,
                                               CUstreamBatchMemOpParams* ops, unsigned flags) {
    return cuStreamBatchMemOp_v2(per_thread_if_null(stream), count, ops, flags);
}
