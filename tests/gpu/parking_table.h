// SPDX-License-Identifier: Apache-2.0
//
// The table itself (parking_calls.h): one row a call.
#pragma once

#include "tests/gpu/parking_calls.h"

namespace parking {

inline const std::vector<Row>& rows() {
    static const std::vector<Row> all =
    { {"cuMemFree", true,
       [](World&) -> Call { return [m = make_memory()] { return cuMemFree(m); }; }},
      {"cuMemFree, managed", true,
       [](World&) -> Call {
           CUdeviceptr m = 0;
           if (cuMemAllocManaged(&m, kBytes, CU_MEM_ATTACH_GLOBAL) != CUDA_SUCCESS) return {};
           return [m] { return cuMemFree(m); };
       }},
      {"cuMemFreeHost", true,
       [](World&) -> Call {
           void* m = nullptr;
           MUST(cuMemAllocHost(&m, kBytes));
           return [m] { return cuMemFreeHost(m); };
       }},
      {"cuMemHostUnregister", true,
       [](World&) -> Call {
           MUST(cuMemHostRegister(page_of_host(), kBytes, 0));
           return [] { return cuMemHostUnregister(page_of_host()); };
       }},
      {"cuMemUnmap", true,
       [](World&) -> Call {
           const Mapping its = make_mapping(true);
           MUST(set_access(its));
           return [its] { return cuMemUnmap(its.address, its.bytes); };
       }},
      {"cuArrayDestroy", true,
       [](World&) -> Call { return [a = make_array()] { return cuArrayDestroy(a); }; }},
      {"cuMipmappedArrayDestroy", true,
       [](World&) -> Call {
           CUDA_ARRAY3D_DESCRIPTOR shape{};
           shape.Width = shape.Height = 64, shape.NumChannels = 1;
           shape.Format = CU_AD_FORMAT_FLOAT;
           CUmipmappedArray array = nullptr;
           MUST(cuMipmappedArrayCreate(&array, &shape, 3));
           return [array] { return cuMipmappedArrayDestroy(array); };
       }},
      {"cuCtxSetLimit, stack", true,
       [](World&) -> Call { return other_limit(CU_LIMIT_STACK_SIZE, 4096); }},
      {"cuCtxSetLimit, printf", true,
       [](World&) -> Call { return other_limit(CU_LIMIT_PRINTF_FIFO_SIZE, 2 << 20); }},
      {"cuModuleUnload", true,
       [](World&) -> Call {
           CUfunction nop = nullptr;
           const CUmodule module = make_module();
           MUST(cuModuleGetFunction(&nop, module, "parking_nop"));
           return [module] { return cuModuleUnload(module); };
       }},
      {"cuLibraryUnload", true,
       [](World&) -> Call { return [l = make_library()] { return cuLibraryUnload(l); }; }},
      {"cuCtxSynchronize", true, [](World&) -> Call { return [] { return cuCtxSynchronize(); }; }},
#if CUDA_VERSION >= 13000
      {"cuCtxSynchronize_v2, not current", true,
       [](World& world) -> Call {
           return [&world] {
               CUcontext primary = nullptr, before = nullptr;
               MUST(cuDevicePrimaryCtxRetain(&primary, world.device));
               MUST(cuCtxGetCurrent(&before));
               MUST(cuCtxSetCurrent(primary));
               const CUresult result = cuCtxSynchronize_v2(world.context);
               MUST(cuCtxSetCurrent(before));
               return result;
           };
       }},
#endif
      {"cuCtxDestroy, another", true,
       [](World& world) -> Call {
           const CUcontext another = make_context(world.device);
           MUST(cuCtxSetCurrent(world.context));
           return [another] { return cuCtxDestroy(another); };
       }},
      {"cuCtxDetach, another", true,
       [](World& world) -> Call {
           const CUcontext another = make_context(world.device);
           MUST(cuCtxSetCurrent(world.context));
           return [&world, another] {
               MUST(cuCtxSetCurrent(another));
               const CUresult result = detach(another);
               MUST(cuCtxSetCurrent(world.context));
               return result;
           };
       }},
      {"cuDevicePrimaryCtxReset, another", true,
       [](World& world) -> Call {
           CUcontext primary = nullptr;
           MUST(cuDevicePrimaryCtxRetain(&primary, world.device));
           return [&world] { return cuDevicePrimaryCtxReset(world.device); };
       }},
      {"cuDevicePrimaryCtxRelease, another", true,
       [](World& world) -> Call {  // The last one: earlier rows have retained it, too.
           unsigned flags = 0;
           int is_active = 1;
           while (cuDevicePrimaryCtxGetState(world.device, &flags, &is_active) == CUDA_SUCCESS &&
                  is_active)
               MUST(cuDevicePrimaryCtxRelease(world.device));
           CUcontext primary = nullptr;
           MUST(cuDevicePrimaryCtxRetain(&primary, world.device));
           return [&world] { return cuDevicePrimaryCtxRelease(world.device); };
       }},
      {"cuGreenCtxDestroy", true,
       [](World& world) -> Call {
           const CUgreenCtx green = make_green(world.device);
           if (!green) return {};
           return [green] { return cuGreenCtxDestroy(green); };
       }},
      {"first launch of a CUkernel", true,
       [](World& world) -> Call {
           return [kernel = new_kernel(), stream = world.stream] {
               return launch_nop(reinterpret_cast<CUfunction>(kernel), stream);
           };
       }},
      {"first launch of a CUfunction", true,
       [](World& world) -> Call {
           return [nop = loaded_nop(), stream = world.stream] { return launch_nop(nop, stream); };
       }},
      {"cuCtxDestroy, of the work's", true,
       [](World& world) -> Call { return [&world] { return cuCtxDestroy(world.context); }; },
       Place::kInItsContext},
      {"cuDevicePrimaryCtxReset, of the work's", true,
       [](World& world) -> Call {
           return [&world] { return cuDevicePrimaryCtxReset(world.device); };
       },
       Place::kInPrimary},
      {"cuModuleLoadData", true,
       [](World&) -> Call {
           return [] {
               CUmodule module = nullptr;
               return cuModuleLoadData(&module, kPtx);
           };
       }},
      {"cuModuleLoadDataEx", true,
       [](World&) -> Call {
           return [] {
               CUmodule module = nullptr;
               return cuModuleLoadDataEx(&module, kPtx, 0, nullptr, nullptr);
           };
       }},
      {"cuModuleLoad", true,
       [](World&) -> Call {
           return [path = image_file()] {
               CUmodule module = nullptr;
               return cuModuleLoad(&module, path);
           };
       }},
      {"cuModuleLoadFatBinary", true,
       [](World&) -> Call {
           if (fat_binary().empty()) return {};
           return [] {
               CUmodule module = nullptr;
               return cuModuleLoadFatBinary(&module, fat_binary().data());
           };
       }},
      {"cuLibraryLoadData", false,
       [](World&) -> Call {
           return [] {
               CUlibrary library = nullptr;
               return cuLibraryLoadData(&library, kPtx, nullptr, nullptr, 0, nullptr, nullptr, 0);
           };
       }},
      {"cuModuleGetFunction", false,
       [](World&) -> Call {
           return [module = make_module()] {
               CUfunction nop = nullptr;
               return cuModuleGetFunction(&nop, module, "parking_nop");
           };
       }},
      {"cuKernelGetFunction", true,
       [](World&) -> Call {
           return [kernel = new_kernel()] {
               CUfunction nop = nullptr;
               return cuKernelGetFunction(&nop, kernel);
           };
       }},
#if CUDA_VERSION >= 12040
      {"cuFuncLoad", false,
       [](World&) -> Call {
           if (!cuFuncLoad) return {};
           return [nop = loaded_nop()] { return cuFuncLoad(nop); };
       }},
#endif
      {"cuFuncGetAttribute", false,
       [](World&) -> Call {
           return [nop = loaded_nop()] {
               int value = 0;
               return cuFuncGetAttribute(&value, CU_FUNC_ATTRIBUTE_NUM_REGS, nop);
           };
       }},
      {"cuFuncSetAttribute", false,
       [](World&) -> Call {
           return [nop = loaded_nop()] {
               return cuFuncSetAttribute(nop, CU_FUNC_ATTRIBUTE_MAX_DYNAMIC_SHARED_SIZE_BYTES,
                                         32 << 10);
           };
       }},
      {"cuGraphInstantiate", false,
       [](World&) -> Call {
           return [graph = make_graph()] {
               CUgraphExec executable = nullptr;
               return cuGraphInstantiate(&executable, graph, 0);
           };
       }},
      {"cuGraphUpload", false,
       [](World& world) -> Call {
           return [graph = make_executable(), stream = world.stream] {
               return cuGraphUpload(graph, stream);
           };
       }},
      {"cuGraphLaunch", false,
       [](World& world) -> Call {
           return [graph = make_executable(), stream = world.stream] {
               return cuGraphLaunch(graph, stream);
           };
       }},
      {"cuGraphExecDestroy", false,
       [](World&) -> Call { return [g = make_executable()] { return cuGraphExecDestroy(g); }; }},
      {"cuDeviceGraphMemTrim", false,
       [](World& world) -> Call {
           if (!cuDeviceGraphMemTrim) return {};
           return [&world] { return cuDeviceGraphMemTrim(world.device); };
       }},
      {"cuMemAlloc", false,
       [](World&) -> Call {
           return [] {
               CUdeviceptr m = 0;
               return cuMemAlloc(&m, kBytes);
           };
       }},
      {"cuMemAllocHost", false,
       [](World&) -> Call {
           return [] {
               void* m = nullptr;
               return cuMemAllocHost(&m, kBytes);
           };
       }},
      {"cuMemAllocManaged", false,
       [](World&) -> Call {
           return [] {
               CUdeviceptr m = 0;
               return cuMemAllocManaged(&m, kBytes, CU_MEM_ATTACH_GLOBAL);
           };
       }},
      {"cuMemHostRegister", false,
       [](World&) -> Call {
           return [] { return cuMemHostRegister(std::aligned_alloc(4096, kBytes), kBytes, 0); };
       }},
      {"cuMemRelease", false,
       [](World&) -> Call {
           return [its = make_mapping(false)] { return cuMemRelease(its.memory); };
       }},
      {"cuMemMap", false,
       [](World&) -> Call {
           return [its = make_mapping(false)] {
               return cuMemMap(its.address, its.bytes, 0, its.memory, 0);
           };
       }},
      {"cuMemSetAccess", false,
       [](World&) -> Call { return [its = make_mapping(true)] { return set_access(its); }; }},
      {"cuMemAllocAsync", false,
       [](World& world) -> Call {
           return [stream = world.stream] {
               CUdeviceptr m = 0;
               return cuMemAllocAsync(&m, kBytes, stream);
           };
       }},
      {"cuMemFreeAsync", false,
       [](World& world) -> Call {
           return [m = from_pool(make_pool(), world.stream), stream = world.stream] {
               return cuMemFreeAsync(m, stream);
           };
       }},
      {"cuMemPoolTrimTo", false,
       [](World& world) -> Call {
           const CUmemoryPool pool = make_pool();
           MUST(cuMemFreeAsync(from_pool(pool, world.stream), world.stream));
           return [pool] { return cuMemPoolTrimTo(pool, 0); };
       }},
      {"cuMemPoolDestroy", false,
       [](World& world) -> Call {
           const CUmemoryPool pool = make_pool();
           MUST(cuMemFreeAsync(from_pool(pool, world.stream), world.stream));
           return [pool] { return cuMemPoolDestroy(pool); };
       }},
      {"cuStreamCreate", false,
       [](World&) -> Call {
           return [] {
               CUstream s = nullptr;
               return cuStreamCreate(&s, CU_STREAM_NON_BLOCKING);
           };
       }},
      {"cuStreamDestroy", false,
       [](World&) -> Call { return [s = make_stream()] { return cuStreamDestroy(s); }; }},
      {"cuEventDestroy", false,
       [](World& world) -> Call {
           CUevent event = nullptr;
           MUST(cuEventCreate(&event, CU_EVENT_DEFAULT));
           MUST(cuEventRecord(event, world.stream));
           return [event] { return cuEventDestroy(event); };
       }},
      {"cuTexObjectDestroy", false,
       [](World&) -> Call {
           const CUtexObject texture = make_texture();
           if (!texture) return {};
           return [texture] { return cuTexObjectDestroy(texture); };
       }},
      {"cuCtxCreate", false,
       [](World& world) -> Call {
           return [&world] {
               CUcontext before = nullptr;
               MUST(cuCtxGetCurrent(&before));
               make_context(world.device);
               return cuCtxSetCurrent(before);
           };
       }},
      {"cuMemcpyHtoD", false,
       [](World&) -> Call {
           return [m = make_memory()] { return cuMemcpyHtoD(m, page_of_host(), kBytes); };
       }},
      {"cuMemcpyDtoH", false,
       [](World&) -> Call {
           return [m = make_memory()] { return cuMemcpyDtoH(page_of_host(), m, kBytes); };
       }},
      {"cuMemcpyDtoD", false,
       [](World&) -> Call {
           return [m = make_memory()] { return cuMemcpyDtoD(m, m + kBytes / 2, kBytes / 2); };
       }},
      {"cuMemcpyAtoH", false,
       [](World&) -> Call {
           return [a = make_array()] { return cuMemcpyAtoH(page_of_host(), a, 0, 1024); };
       }},
      {"cuMemsetD8", false,
       [](World&) -> Call { return [m = make_memory()] { return cuMemsetD8(m, 1, kBytes); }; }},
      {"cuStreamSynchronize, another", false,
       [](World& world) -> Call { return [&world] { return cuStreamSynchronize(world.stream); }; }},
      {"cuMemGetInfo", false,
       [](World&) -> Call {
           return [] {
               std::size_t free = 0, all = 0;
               return cuMemGetInfo(&free, &all);
           };
       }},
      // Last: from then on no dispatcher is resident in the process.
      {"cuLaunchCooperativeKernel", true, [](World& world) -> Call {
           return [nop = loaded_nop(), stream = world.stream] {
               const CUresult result =
                   cuLaunchCooperativeKernel(nop, 1, 1, 1, 32, 1, 1, 0, stream, nullptr);
               return result == CUDA_SUCCESS ? cuStreamSynchronize(stream) : result;
           };
       }} };
    return all;
}

}  // namespace parking
