// SPDX-License-Identifier: Apache-2.0
//
// The driver functions that UrgenGo itself calls or forwards by hand, as typed pointers to the real
// driver. Injected: the interposer fills it from the real libcuda, tests from the simulated GPU.
// Nothing in the project calls a bare cuX.
#pragma once

#include <cuda.h>

#include <type_traits>

// X(field, exported name, type). Fields of functions with several ABIs say which.
// clang-format off
#define URGENGO_DRIVER_API(X) \
    X(cuArrayDestroy, "cuArrayDestroy", decltype(&::cuArrayDestroy)) \
    X(cuCtxCreate_v1, "cuCtxCreate", std::add_pointer_t<CUresult(CUcontext*, unsigned, CUdevice)>) \
    X(cuCtxCreate_v2, "cuCtxCreate_v2", std::add_pointer_t<CUresult(CUcontext*, unsigned, CUdevice)>) \
    X(cuCtxCreate_v3, "cuCtxCreate_v3", std::add_pointer_t<CUresult(CUcontext*, CUexecAffinityParam*, int, unsigned, CUdevice)>) \
    X(cuCtxCreate_v4, "cuCtxCreate_v4", std::add_pointer_t<CUresult(CUcontext*, CUctxCreateParams*, unsigned, CUdevice)>) \
    X(cuCtxDetach, "cuCtxDetach", std::add_pointer_t<CUresult(CUcontext)>) \
    X(cuCtxDestroy_v1, "cuCtxDestroy", std::add_pointer_t<CUresult(CUcontext)>) \
    X(cuCtxDestroy_v2, "cuCtxDestroy_v2", std::add_pointer_t<CUresult(CUcontext)>) \
    X(cuCtxGetCurrent, "cuCtxGetCurrent", decltype(&::cuCtxGetCurrent)) \
    X(cuCtxGetDevice, "cuCtxGetDevice", std::add_pointer_t<CUresult(CUdevice*)>) \
    X(cuCtxGetId, "cuCtxGetId", decltype(&::cuCtxGetId)) \
    X(cuCtxGetStreamPriorityRange, "cuCtxGetStreamPriorityRange", decltype(&::cuCtxGetStreamPriorityRange)) \
    X(cuCtxPopCurrent_v1, "cuCtxPopCurrent", std::add_pointer_t<CUresult(CUcontext*)>) \
    X(cuCtxPopCurrent_v2, "cuCtxPopCurrent_v2", std::add_pointer_t<CUresult(CUcontext*)>) \
    X(cuCtxPushCurrent_v1, "cuCtxPushCurrent", std::add_pointer_t<CUresult(CUcontext)>) \
    X(cuCtxPushCurrent_v2, "cuCtxPushCurrent_v2", std::add_pointer_t<CUresult(CUcontext)>) \
    X(cuCtxSetCurrent, "cuCtxSetCurrent", decltype(&::cuCtxSetCurrent)) \
    X(cuCtxSetLimit, "cuCtxSetLimit", decltype(&::cuCtxSetLimit)) \
    X(cuCtxSynchronize, "cuCtxSynchronize", std::add_pointer_t<CUresult()>) \
    X(cuCtxSynchronize_v2, "cuCtxSynchronize_v2", std::add_pointer_t<CUresult(CUcontext)>) \
    X(cuDeviceGetAttribute, "cuDeviceGetAttribute", decltype(&::cuDeviceGetAttribute)) \
    X(cuDeviceGetName, "cuDeviceGetName", decltype(&::cuDeviceGetName)) \
    X(cuDevicePrimaryCtxRelease_v1, "cuDevicePrimaryCtxRelease", std::add_pointer_t<CUresult(CUdevice)>) \
    X(cuDevicePrimaryCtxRelease_v2, "cuDevicePrimaryCtxRelease_v2", std::add_pointer_t<CUresult(CUdevice)>) \
    X(cuDevicePrimaryCtxReset_v1, "cuDevicePrimaryCtxReset", std::add_pointer_t<CUresult(CUdevice)>) \
    X(cuDevicePrimaryCtxReset_v2, "cuDevicePrimaryCtxReset_v2", std::add_pointer_t<CUresult(CUdevice)>) \
    X(cuDriverGetVersion, "cuDriverGetVersion", decltype(&::cuDriverGetVersion)) \
    X(cuEventCreate, "cuEventCreate", decltype(&::cuEventCreate)) \
    X(cuEventDestroy_v1, "cuEventDestroy", std::add_pointer_t<CUresult(CUevent)>) \
    X(cuEventDestroy_v2, "cuEventDestroy_v2", std::add_pointer_t<CUresult(CUevent)>) \
    X(cuEventQuery, "cuEventQuery", decltype(&::cuEventQuery)) \
    X(cuEventRecord, "cuEventRecord", decltype(&::cuEventRecord)) \
    X(cuEventRecord_ptsz, "cuEventRecord_ptsz", decltype(&::cuEventRecord)) \
    X(cuEventRecordWithFlags, "cuEventRecordWithFlags", decltype(&::cuEventRecordWithFlags)) \
    X(cuEventRecordWithFlags_ptsz, "cuEventRecordWithFlags_ptsz", decltype(&::cuEventRecordWithFlags)) \
    X(cuEventSynchronize, "cuEventSynchronize", decltype(&::cuEventSynchronize)) \
    X(cuFuncGetAttribute, "cuFuncGetAttribute", decltype(&::cuFuncGetAttribute)) \
    X(cuFuncGetName, "cuFuncGetName", decltype(&::cuFuncGetName)) \
    X(cuGetProcAddress_v1, "cuGetProcAddress", std::add_pointer_t<CUresult(const char*, void**, int, cuuint64_t)>) \
    X(cuGetProcAddress_v2, "cuGetProcAddress_v2", std::add_pointer_t<CUresult(const char*, void**, int, cuuint64_t, CUdriverProcAddressQueryResult*)>) \
    X(cuGraphChildGraphNodeGetGraph, "cuGraphChildGraphNodeGetGraph", decltype(&::cuGraphChildGraphNodeGetGraph)) \
    X(cuGraphExecDestroy, "cuGraphExecDestroy", decltype(&::cuGraphExecDestroy)) \
    X(cuGraphGetNodes, "cuGraphGetNodes", decltype(&::cuGraphGetNodes)) \
    X(cuGraphInstantiate_v1, "cuGraphInstantiate", std::add_pointer_t<CUresult(CUgraphExec*, CUgraph, CUgraphNode*, char*, size_t)>) \
    X(cuGraphInstantiate_v2, "cuGraphInstantiate_v2", std::add_pointer_t<CUresult(CUgraphExec*, CUgraph, CUgraphNode*, char*, size_t)>) \
    X(cuGraphInstantiateWithFlags, "cuGraphInstantiateWithFlags", std::add_pointer_t<CUresult(CUgraphExec*, CUgraph, unsigned long long)>) \
    X(cuGraphInstantiateWithParams, "cuGraphInstantiateWithParams", decltype(&::cuGraphInstantiateWithParams)) \
    X(cuGraphInstantiateWithParams_ptsz, "cuGraphInstantiateWithParams_ptsz", decltype(&::cuGraphInstantiateWithParams)) \
    X(cuGraphKernelNodeGetAttribute, "cuGraphKernelNodeGetAttribute", decltype(&::cuGraphKernelNodeGetAttribute)) \
    X(cuGraphKernelNodeGetParams_v2, "cuGraphKernelNodeGetParams_v2", decltype(&::cuGraphKernelNodeGetParams_v2)) \
    X(cuGraphLaunch, "cuGraphLaunch", decltype(&::cuGraphLaunch)) \
    X(cuGraphLaunch_ptsz, "cuGraphLaunch_ptsz", decltype(&::cuGraphLaunch)) \
    X(cuGraphNodeGetType, "cuGraphNodeGetType", decltype(&::cuGraphNodeGetType)) \
    X(cuGreenCtxDestroy, "cuGreenCtxDestroy", decltype(&::cuGreenCtxDestroy)) \
    X(cuInit, "cuInit", decltype(&::cuInit)) \
    X(cuKernelGetFunction, "cuKernelGetFunction", decltype(&::cuKernelGetFunction)) \
    X(cuKernelGetName, "cuKernelGetName", decltype(&::cuKernelGetName)) \
    X(cuLaunch, "cuLaunch", std::add_pointer_t<CUresult(CUfunction)>) \
    X(cuLaunchCooperativeKernel, "cuLaunchCooperativeKernel", decltype(&::cuLaunchCooperativeKernel)) \
    X(cuLaunchCooperativeKernel_ptsz, "cuLaunchCooperativeKernel_ptsz", decltype(&::cuLaunchCooperativeKernel)) \
    X(cuLaunchGrid, "cuLaunchGrid", std::add_pointer_t<CUresult(CUfunction, int, int)>) \
    X(cuLaunchGridAsync, "cuLaunchGridAsync", std::add_pointer_t<CUresult(CUfunction, int, int, CUstream)>) \
    X(cuLaunchKernel, "cuLaunchKernel", decltype(&::cuLaunchKernel)) \
    X(cuLaunchKernel_ptsz, "cuLaunchKernel_ptsz", decltype(&::cuLaunchKernel)) \
    X(cuLaunchKernelEx, "cuLaunchKernelEx", decltype(&::cuLaunchKernelEx)) \
    X(cuLaunchKernelEx_ptsz, "cuLaunchKernelEx_ptsz", decltype(&::cuLaunchKernelEx)) \
    X(cuLibraryUnload, "cuLibraryUnload", decltype(&::cuLibraryUnload)) \
    X(cuMemcpy, "cuMemcpy", decltype(&::cuMemcpy)) \
    X(cuMemcpy_ptds, "cuMemcpy_ptds", decltype(&::cuMemcpy)) \
    X(cuMemcpy2D_v2, "cuMemcpy2D_v2", decltype(&::cuMemcpy2D_v2)) \
    X(cuMemcpy2D_v2_ptds, "cuMemcpy2D_v2_ptds", decltype(&::cuMemcpy2D_v2)) \
    X(cuMemcpy2DUnaligned_v2, "cuMemcpy2DUnaligned_v2", decltype(&::cuMemcpy2DUnaligned_v2)) \
    X(cuMemcpy2DUnaligned_v2_ptds, "cuMemcpy2DUnaligned_v2_ptds", decltype(&::cuMemcpy2DUnaligned_v2)) \
    X(cuMemcpy3D_v2, "cuMemcpy3D_v2", decltype(&::cuMemcpy3D_v2)) \
    X(cuMemcpy3D_v2_ptds, "cuMemcpy3D_v2_ptds", decltype(&::cuMemcpy3D_v2)) \
    X(cuMemcpyAtoH_v2, "cuMemcpyAtoH_v2", decltype(&::cuMemcpyAtoH_v2)) \
    X(cuMemcpyAtoH_v2_ptds, "cuMemcpyAtoH_v2_ptds", decltype(&::cuMemcpyAtoH_v2)) \
    X(cuMemcpyDtoH_v2, "cuMemcpyDtoH_v2", decltype(&::cuMemcpyDtoH_v2)) \
    X(cuMemcpyDtoH_v2_ptds, "cuMemcpyDtoH_v2_ptds", decltype(&::cuMemcpyDtoH_v2)) \
    X(cuMemAlloc_v2, "cuMemAlloc_v2", decltype(&::cuMemAlloc_v2)) \
    X(cuMemsetD8Async, "cuMemsetD8Async", decltype(&::cuMemsetD8Async)) \
    X(cuMemFree_v2, "cuMemFree_v2", decltype(&::cuMemFree_v2)) \
    X(cuMemFreeHost, "cuMemFreeHost", decltype(&::cuMemFreeHost)) \
    X(cuMemGetAddressRange_v2, "cuMemGetAddressRange_v2", decltype(&::cuMemGetAddressRange_v2)) \
    X(cuMemHostGetDevicePointer_v2, "cuMemHostGetDevicePointer_v2", decltype(&::cuMemHostGetDevicePointer_v2)) \
    X(cuMemHostRegister_v2, "cuMemHostRegister_v2", decltype(&::cuMemHostRegister_v2)) \
    X(cuMemHostUnregister, "cuMemHostUnregister", decltype(&::cuMemHostUnregister)) \
    X(cuMemUnmap, "cuMemUnmap", decltype(&::cuMemUnmap)) \
    X(cuMemcpyAsync, "cuMemcpyAsync", decltype(&::cuMemcpyAsync)) \
    X(cuMemcpyAsync_ptsz, "cuMemcpyAsync_ptsz", decltype(&::cuMemcpyAsync)) \
    X(cuMemcpyDtoDAsync_v2, "cuMemcpyDtoDAsync_v2", decltype(&::cuMemcpyDtoDAsync_v2)) \
    X(cuMemcpyDtoDAsync_v2_ptsz, "cuMemcpyDtoDAsync_v2_ptsz", decltype(&::cuMemcpyDtoDAsync_v2)) \
    X(cuMemcpyDtoHAsync_v2, "cuMemcpyDtoHAsync_v2", decltype(&::cuMemcpyDtoHAsync_v2)) \
    X(cuMemcpyDtoHAsync_v2_ptsz, "cuMemcpyDtoHAsync_v2_ptsz", decltype(&::cuMemcpyDtoHAsync_v2)) \
    X(cuMemcpyHtoDAsync_v2, "cuMemcpyHtoDAsync_v2", decltype(&::cuMemcpyHtoDAsync_v2)) \
    X(cuMemcpyHtoDAsync_v2_ptsz, "cuMemcpyHtoDAsync_v2_ptsz", decltype(&::cuMemcpyHtoDAsync_v2)) \
    X(cuMipmappedArrayDestroy, "cuMipmappedArrayDestroy", decltype(&::cuMipmappedArrayDestroy)) \
    X(cuModuleGetFunction, "cuModuleGetFunction", decltype(&::cuModuleGetFunction)) \
    X(cuModuleLoad, "cuModuleLoad", decltype(&::cuModuleLoad)) \
    X(cuModuleLoadData, "cuModuleLoadData", decltype(&::cuModuleLoadData)) \
    X(cuModuleLoadDataEx, "cuModuleLoadDataEx", decltype(&::cuModuleLoadDataEx)) \
    X(cuModuleLoadFatBinary, "cuModuleLoadFatBinary", decltype(&::cuModuleLoadFatBinary)) \
    X(cuModuleUnload, "cuModuleUnload", decltype(&::cuModuleUnload)) \
    X(cuOccupancyMaxActiveBlocksPerMultiprocessor, "cuOccupancyMaxActiveBlocksPerMultiprocessor", decltype(&::cuOccupancyMaxActiveBlocksPerMultiprocessor)) \
    X(cuPointerGetAttribute, "cuPointerGetAttribute", decltype(&::cuPointerGetAttribute)) \
    X(cuStreamBatchMemOp_v2, "cuStreamBatchMemOp_v2", decltype(&::cuStreamBatchMemOp_v2)) \
    X(cuStreamBatchMemOp_v2_ptsz, "cuStreamBatchMemOp_v2_ptsz", decltype(&::cuStreamBatchMemOp_v2)) \
    X(cuStreamBeginCapture_v1, "cuStreamBeginCapture", std::add_pointer_t<CUresult(CUstream)>) \
    X(cuStreamBeginCapture_v1_ptsz, "cuStreamBeginCapture_ptsz", std::add_pointer_t<CUresult(CUstream)>) \
    X(cuStreamBeginCapture_v2, "cuStreamBeginCapture_v2", decltype(&::cuStreamBeginCapture_v2)) \
    X(cuStreamBeginCapture_v2_ptsz, "cuStreamBeginCapture_v2_ptsz", decltype(&::cuStreamBeginCapture_v2)) \
    X(cuStreamBeginCaptureToGraph, "cuStreamBeginCaptureToGraph", decltype(&::cuStreamBeginCaptureToGraph)) \
    X(cuStreamBeginCaptureToGraph_ptsz, "cuStreamBeginCaptureToGraph_ptsz", decltype(&::cuStreamBeginCaptureToGraph)) \
    X(cuStreamCopyAttributes, "cuStreamCopyAttributes", decltype(&::cuStreamCopyAttributes)) \
    X(cuStreamCopyAttributes_ptsz, "cuStreamCopyAttributes_ptsz", decltype(&::cuStreamCopyAttributes)) \
    X(cuStreamCreateWithPriority, "cuStreamCreateWithPriority", decltype(&::cuStreamCreateWithPriority)) \
    X(cuStreamDestroy_v1, "cuStreamDestroy", std::add_pointer_t<CUresult(CUstream)>) \
    X(cuStreamDestroy_v2, "cuStreamDestroy_v2", std::add_pointer_t<CUresult(CUstream)>) \
    X(cuStreamEndCapture, "cuStreamEndCapture", decltype(&::cuStreamEndCapture)) \
    X(cuStreamEndCapture_ptsz, "cuStreamEndCapture_ptsz", decltype(&::cuStreamEndCapture)) \
    X(cuStreamGetAttribute, "cuStreamGetAttribute", decltype(&::cuStreamGetAttribute)) \
    X(cuStreamGetAttribute_ptsz, "cuStreamGetAttribute_ptsz", decltype(&::cuStreamGetAttribute)) \
    X(cuStreamGetCtx, "cuStreamGetCtx", std::add_pointer_t<CUresult(CUstream, CUcontext*)>) \
    X(cuStreamGetFlags, "cuStreamGetFlags", decltype(&::cuStreamGetFlags)) \
    X(cuStreamGetPriority, "cuStreamGetPriority", decltype(&::cuStreamGetPriority)) \
    X(cuStreamGetPriority_ptsz, "cuStreamGetPriority_ptsz", decltype(&::cuStreamGetPriority)) \
    X(cuStreamIsCapturing, "cuStreamIsCapturing", decltype(&::cuStreamIsCapturing)) \
    X(cuStreamIsCapturing_ptsz, "cuStreamIsCapturing_ptsz", decltype(&::cuStreamIsCapturing)) \
    X(cuStreamQuery, "cuStreamQuery", decltype(&::cuStreamQuery)) \
    X(cuStreamQuery_ptsz, "cuStreamQuery_ptsz", decltype(&::cuStreamQuery)) \
    X(cuStreamSetAttribute, "cuStreamSetAttribute", decltype(&::cuStreamSetAttribute)) \
    X(cuStreamSetAttribute_ptsz, "cuStreamSetAttribute_ptsz", decltype(&::cuStreamSetAttribute)) \
    X(cuStreamSynchronize, "cuStreamSynchronize", decltype(&::cuStreamSynchronize)) \
    X(cuStreamSynchronize_ptsz, "cuStreamSynchronize_ptsz", decltype(&::cuStreamSynchronize)) \
    X(cuStreamWaitValue32_v2, "cuStreamWaitValue32_v2", decltype(&::cuStreamWaitValue32_v2)) \
    X(cuStreamWaitValue32_v2_ptsz, "cuStreamWaitValue32_v2_ptsz", decltype(&::cuStreamWaitValue32_v2)) \
    X(cuStreamWaitEvent, "cuStreamWaitEvent", decltype(&::cuStreamWaitEvent)) \
    X(cuStreamWaitEvent_ptsz, "cuStreamWaitEvent_ptsz", decltype(&::cuStreamWaitEvent)) \
    X(cuThreadExchangeStreamCaptureMode, "cuThreadExchangeStreamCaptureMode", decltype(&::cuThreadExchangeStreamCaptureMode))
// clang-format on

namespace urgengo::exec {

struct DriverApi {
#define URGENGO_DECLARE(field, name, type) type field = nullptr;
    URGENGO_DRIVER_API(URGENGO_DECLARE)
#undef URGENGO_DECLARE

    /// Fills every pointer from `lookup(const char* name) -> void*`; one that the driver lacks
    /// stays null.
    template <typename Lookup>
    void load(Lookup&& lookup) {
#define URGENGO_LOAD(field, name, type) field = reinterpret_cast<type>(lookup(name));
        URGENGO_DRIVER_API(URGENGO_LOAD)
#undef URGENGO_LOAD
    }
};

/// Which default stream a call means: the plain entry points name the legacy one with a null
/// stream, the _ptsz ones the calling thread's own.
enum class StreamFlavor : unsigned char { kLegacy, kPerThread };

/// @returns the entry point that means the default stream of this flavor
template <typename Function>
Function of_flavor(StreamFlavor flavor, Function legacy, Function per_thread) {
    return flavor == StreamFlavor::kPerThread ? per_thread : legacy;
}

/// Null, legacy or per-thread: the same handle in every context, and in every thread.
inline bool is_default_stream(CUstream stream) {
    return stream == nullptr || stream == CU_STREAM_LEGACY || stream == CU_STREAM_PER_THREAD;
}

}  // namespace urgengo::exec
