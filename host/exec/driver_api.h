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
    X(cuCtxDestroy_v1, "cuCtxDestroy", std::add_pointer_t<CUresult(CUcontext)>) \
    X(cuCtxDestroy_v2, "cuCtxDestroy_v2", std::add_pointer_t<CUresult(CUcontext)>) \
    X(cuCtxGetCurrent, "cuCtxGetCurrent", decltype(&::cuCtxGetCurrent)) \
    X(cuCtxGetDevice, "cuCtxGetDevice", std::add_pointer_t<CUresult(CUdevice*)>) \
    X(cuCtxGetId, "cuCtxGetId", decltype(&::cuCtxGetId)) \
    X(cuCtxGetStreamPriorityRange, "cuCtxGetStreamPriorityRange", decltype(&::cuCtxGetStreamPriorityRange)) \
    X(cuCtxSynchronize, "cuCtxSynchronize", std::add_pointer_t<CUresult()>) \
    X(cuCtxSynchronize_v2, "cuCtxSynchronize_v2", std::add_pointer_t<CUresult(CUcontext)>) \
    X(cuDeviceGetAttribute, "cuDeviceGetAttribute", decltype(&::cuDeviceGetAttribute)) \
    X(cuDeviceGetName, "cuDeviceGetName", decltype(&::cuDeviceGetName)) \
    X(cuDevicePrimaryCtxRelease_v1, "cuDevicePrimaryCtxRelease", std::add_pointer_t<CUresult(CUdevice)>) \
    X(cuDevicePrimaryCtxRelease_v2, "cuDevicePrimaryCtxRelease_v2", std::add_pointer_t<CUresult(CUdevice)>) \
    X(cuDevicePrimaryCtxReset_v1, "cuDevicePrimaryCtxReset", std::add_pointer_t<CUresult(CUdevice)>) \
    X(cuDevicePrimaryCtxReset_v2, "cuDevicePrimaryCtxReset_v2", std::add_pointer_t<CUresult(CUdevice)>) \
    X(cuDriverGetVersion, "cuDriverGetVersion", decltype(&::cuDriverGetVersion)) \
    X(cuEventQuery, "cuEventQuery", decltype(&::cuEventQuery)) \
    X(cuEventRecord, "cuEventRecord", decltype(&::cuEventRecord)) \
    X(cuEventRecord_ptsz, "cuEventRecord_ptsz", decltype(&::cuEventRecord)) \
    X(cuEventRecordWithFlags, "cuEventRecordWithFlags", decltype(&::cuEventRecordWithFlags)) \
    X(cuEventRecordWithFlags_ptsz, "cuEventRecordWithFlags_ptsz", decltype(&::cuEventRecordWithFlags)) \
    X(cuEventSynchronize, "cuEventSynchronize", decltype(&::cuEventSynchronize)) \
    X(cuFuncGetName, "cuFuncGetName", decltype(&::cuFuncGetName)) \
    X(cuGetProcAddress_v1, "cuGetProcAddress", std::add_pointer_t<CUresult(const char*, void**, int, cuuint64_t)>) \
    X(cuGetProcAddress_v2, "cuGetProcAddress_v2", std::add_pointer_t<CUresult(const char*, void**, int, cuuint64_t, CUdriverProcAddressQueryResult*)>) \
    X(cuGraphLaunch, "cuGraphLaunch", decltype(&::cuGraphLaunch)) \
    X(cuGraphLaunch_ptsz, "cuGraphLaunch_ptsz", decltype(&::cuGraphLaunch)) \
    X(cuKernelGetName, "cuKernelGetName", decltype(&::cuKernelGetName)) \
    X(cuLaunchCooperativeKernel, "cuLaunchCooperativeKernel", decltype(&::cuLaunchCooperativeKernel)) \
    X(cuLaunchCooperativeKernel_ptsz, "cuLaunchCooperativeKernel_ptsz", decltype(&::cuLaunchCooperativeKernel)) \
    X(cuLaunchKernel, "cuLaunchKernel", decltype(&::cuLaunchKernel)) \
    X(cuLaunchKernel_ptsz, "cuLaunchKernel_ptsz", decltype(&::cuLaunchKernel)) \
    X(cuLaunchKernelEx, "cuLaunchKernelEx", decltype(&::cuLaunchKernelEx)) \
    X(cuLaunchKernelEx_ptsz, "cuLaunchKernelEx_ptsz", decltype(&::cuLaunchKernelEx)) \
    X(cuLibraryUnload, "cuLibraryUnload", decltype(&::cuLibraryUnload)) \
    X(cuMemHostGetDevicePointer_v2, "cuMemHostGetDevicePointer_v2", decltype(&::cuMemHostGetDevicePointer_v2)) \
    X(cuMemHostRegister_v2, "cuMemHostRegister_v2", decltype(&::cuMemHostRegister_v2)) \
    X(cuMemcpyDtoH_v2, "cuMemcpyDtoH_v2", decltype(&::cuMemcpyDtoH_v2)) \
    X(cuMemcpyDtoH_v2_ptds, "cuMemcpyDtoH_v2_ptds", decltype(&::cuMemcpyDtoH_v2)) \
    X(cuModuleGetFunction, "cuModuleGetFunction", decltype(&::cuModuleGetFunction)) \
    X(cuModuleLoadData, "cuModuleLoadData", decltype(&::cuModuleLoadData)) \
    X(cuModuleUnload, "cuModuleUnload", decltype(&::cuModuleUnload)) \
    X(cuOccupancyMaxActiveBlocksPerMultiprocessor, "cuOccupancyMaxActiveBlocksPerMultiprocessor", decltype(&::cuOccupancyMaxActiveBlocksPerMultiprocessor)) \
    X(cuStreamBeginCapture_v1, "cuStreamBeginCapture", std::add_pointer_t<CUresult(CUstream)>) \
    X(cuStreamBeginCapture_v1_ptsz, "cuStreamBeginCapture_ptsz", std::add_pointer_t<CUresult(CUstream)>) \
    X(cuStreamBeginCapture_v2, "cuStreamBeginCapture_v2", decltype(&::cuStreamBeginCapture_v2)) \
    X(cuStreamBeginCapture_v2_ptsz, "cuStreamBeginCapture_v2_ptsz", decltype(&::cuStreamBeginCapture_v2)) \
    X(cuStreamBeginCaptureToGraph, "cuStreamBeginCaptureToGraph", decltype(&::cuStreamBeginCaptureToGraph)) \
    X(cuStreamBeginCaptureToGraph_ptsz, "cuStreamBeginCaptureToGraph_ptsz", decltype(&::cuStreamBeginCaptureToGraph)) \
    X(cuStreamCreateWithPriority, "cuStreamCreateWithPriority", decltype(&::cuStreamCreateWithPriority)) \
    X(cuStreamDestroy_v1, "cuStreamDestroy", std::add_pointer_t<CUresult(CUstream)>) \
    X(cuStreamDestroy_v2, "cuStreamDestroy_v2", std::add_pointer_t<CUresult(CUstream)>) \
    X(cuStreamEndCapture, "cuStreamEndCapture", decltype(&::cuStreamEndCapture)) \
    X(cuStreamEndCapture_ptsz, "cuStreamEndCapture_ptsz", decltype(&::cuStreamEndCapture)) \
    X(cuStreamIsCapturing, "cuStreamIsCapturing", decltype(&::cuStreamIsCapturing)) \
    X(cuStreamIsCapturing_ptsz, "cuStreamIsCapturing_ptsz", decltype(&::cuStreamIsCapturing)) \
    X(cuStreamQuery, "cuStreamQuery", decltype(&::cuStreamQuery)) \
    X(cuStreamQuery_ptsz, "cuStreamQuery_ptsz", decltype(&::cuStreamQuery)) \
    X(cuStreamSynchronize, "cuStreamSynchronize", decltype(&::cuStreamSynchronize)) \
    X(cuStreamSynchronize_ptsz, "cuStreamSynchronize_ptsz", decltype(&::cuStreamSynchronize)) \
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

/// Null, legacy or per-thread: the same handle in every context, and in every thread.
inline bool is_default_stream(CUstream stream) {
    return stream == nullptr || stream == CU_STREAM_LEGACY || stream == CU_STREAM_PER_THREAD;
}

}  // namespace urgengo::exec
