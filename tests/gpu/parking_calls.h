// SPDX-License-Identifier: Apache-2.0
//
// Calls of the driver API that may wait for work of others on the GPU, each on what was made for
// it, and whether the interposer takes the resident dispatcher off the GPU and opens all gates
// before it (interposer/manual). parking.cu measures which of them wait.
#pragma once

#include <cuda.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

// Not every driver has them: their rows are left out then.
#pragma weak cuDeviceGraphMemTrim
#pragma weak cuFuncLoad
#pragma weak cuTexObjectCreate
#pragma weak cuTexObjectDestroy

namespace parking {

inline void must(CUresult result, const char* call) {
    if (result == CUDA_SUCCESS) return;
    const char* name = nullptr;
    cuGetErrorName(result, &name);
    std::fprintf(stderr, "parking: %s: %s\n", call, name ? name : "unknown error");
    std::exit(2);
}
#define MUST(call) ::parking::must((call), #call)

/// Each block of the spinning kernel ends when `word` is not 0, or after so long; then it counts.
struct SpinWords {
    std::uint32_t word, began, ended;
};

// `nop` is loaded again and again: under lazy loading its code comes at its first use.
inline constexpr char kPtx[] = R"(
.version 7.5
.target sm_75
.address_size 64
.visible .entry parking_spin(.param .u64 words, .param .u64 limit_ns)
{
    .reg .u64 %words, %limit, %begin, %now;
    .reg .u32 %v, %thread;
    .reg .pred %p;
    ld.param.u64 %words, [words];
    ld.param.u64 %limit, [limit_ns];
    mov.u64 %begin, %globaltimer;
    mov.u32 %thread, %tid.x;
    setp.ne.u32 %p, %thread, 0;
    @%p bra DONE;
    mov.u32 %v, 1;
    st.volatile.global.u32 [%words+4], %v;
AGAIN:
    ld.volatile.global.u32 %v, [%words];
    setp.ne.u32 %p, %v, 0;
    @%p bra COUNT;
    mov.u64 %now, %globaltimer;
    sub.u64 %now, %now, %begin;
    setp.lt.u64 %p, %now, %limit;
    @%p bra AGAIN;
COUNT:
    atom.global.add.u32 %v, [%words+8], 1;
DONE:
    ret;
}
.visible .entry parking_nop()
{
    ret;
}
)";

struct World {
    CUdevice device = 0;
    unsigned num_sms = 1;
    CUcontext context = nullptr;  ///< created; the primary one is another
    CUstream stream = nullptr;    ///< of the calls that need one; no work of others is on it
};

using Call = std::function<CUresult()>;

/// Where the kernel or the gate is that the call might wait for.
enum class Place { kHere, kInItsContext, kInPrimary };

struct Row {
    const char* name;
    bool parks;
    /// @returns the call; empty: not possible here
    Call (*prepare)(World&);
    Place place = Place::kHere;
};

inline CUstream make_stream() {
    CUstream stream = nullptr;
    MUST(cuStreamCreate(&stream, CU_STREAM_NON_BLOCKING));
    return stream;
}

inline CUcontext make_context(CUdevice device) {
    CUcontext context = nullptr;
#if CUDA_VERSION >= 13000
    MUST(cuCtxCreate(&context, nullptr, 0, device));
#else
    MUST(cuCtxCreate(&context, 0, device));
#endif
    return context;
}

// Deprecated, and still in the headers of CUDA 13.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"
#ifdef __CUDACC__
#pragma nv_diagnostic push
#pragma nv_diag_suppress 1444
#pragma nv_diag_suppress 1215
#endif
/// Ends the calling thread's current context, which was attached once: when it was made.
inline CUresult detach(CUcontext context) {
    return cuCtxDetach(context);
}
#ifdef __CUDACC__
#pragma nv_diagnostic pop
#endif
#pragma GCC diagnostic pop

inline constexpr std::size_t kBytes = 1 << 20;

inline CUdeviceptr make_memory() {
    CUdeviceptr memory = 0;
    MUST(cuMemAlloc(&memory, kBytes));
    return memory;
}
inline void* page_of_host() {
    static void* const page = std::aligned_alloc(4096, kBytes);
    return page;
}
inline CUmodule make_module() {
    CUmodule module = nullptr;
    MUST(cuModuleLoadData(&module, kPtx));
    return module;
}
/// @returns the path of a file with the image
inline const char* image_file() {
    static const std::string path = [] {
        std::string name = "/tmp/parking_XXXXXX";
        const int file = mkstemp(name.data());
        const ssize_t length = sizeof(kPtx) - 1;
        if (file < 0 || write(file, kPtx, sizeof(kPtx) - 1) != length) std::exit(2);
        close(file);
        std::atexit([] { unlink(image_file()); });
        return name;
    }();
    return path.c_str();
}
/// @returns the image as a fat binary, which PARKING_FATBIN names; empty: there is none
inline const std::string& fat_binary() {
    static const std::string bytes = [] {
        const char* const path = std::getenv("PARKING_FATBIN");
        std::ifstream file(path ? path : "", std::ios::binary);
        return std::string(std::istreambuf_iterator<char>(file), {});
    }();
    return bytes;
}
inline CUlibrary make_library() {
    CUlibrary library = nullptr;
    MUST(cuLibraryLoadData(&library, kPtx, nullptr, nullptr, 0, nullptr, nullptr, 0));
    return library;
}
inline CUkernel new_kernel() {
    CUkernel kernel = nullptr;
    MUST(cuLibraryGetKernel(&kernel, make_library(), "parking_nop"));
    return kernel;
}
inline CUfunction loaded_nop() {
    CUfunction function = nullptr;
    MUST(cuModuleGetFunction(&function, make_module(), "parking_nop"));
    return function;
}
inline CUresult launch_nop(CUfunction function, CUstream stream) {
    return cuLaunchKernel(function, 1, 1, 1, 32, 1, 1, 0, stream, nullptr, nullptr);
}

inline CUarray make_array() {
    CUDA_ARRAY_DESCRIPTOR shape{};
    shape.Width = 1024, shape.NumChannels = 1, shape.Format = CU_AD_FORMAT_FLOAT;
    CUarray array = nullptr;
    MUST(cuArrayCreate(&array, &shape));
    return array;
}

inline CUtexObject make_texture() {
    CUDA_RESOURCE_DESC resource{};
    resource.resType = CU_RESOURCE_TYPE_ARRAY;
    resource.res.array.hArray = make_array();
    CUDA_TEXTURE_DESC texture{};
    CUtexObject object = 0;
    if (!cuTexObjectCreate) return 0;
    return cuTexObjectCreate(&object, &resource, &texture, nullptr) == CUDA_SUCCESS ? object : 0;
}

inline CUgraph make_graph() {
    CUgraph graph = nullptr;
    CUgraphNode node = nullptr;
    MUST(cuGraphCreate(&graph, 0));
    CUDA_KERNEL_NODE_PARAMS kernel{};
    kernel.func = loaded_nop();
    kernel.gridDimX = kernel.gridDimY = kernel.gridDimZ = 1;
    kernel.blockDimX = kernel.blockDimY = kernel.blockDimZ = 1;
    MUST(cuGraphAddKernelNode(&node, graph, nullptr, 0, &kernel));
    return graph;
}
inline CUgraphExec make_executable() {
    CUgraphExec executable = nullptr;
    MUST(cuGraphInstantiate(&executable, make_graph(), 0));
    return executable;
}

inline CUmemoryPool make_pool() {
    CUmemPoolProps properties{};
    properties.allocType = CU_MEM_ALLOCATION_TYPE_PINNED;
    properties.location = {CU_MEM_LOCATION_TYPE_DEVICE, 0};
    CUmemoryPool pool = nullptr;
    MUST(cuMemPoolCreate(&pool, &properties));
    return pool;
}
inline CUdeviceptr from_pool(CUmemoryPool pool, CUstream stream) {
    CUdeviceptr memory = 0;
    MUST(cuMemAllocFromPoolAsync(&memory, kBytes, pool, stream));
    MUST(cuStreamSynchronize(stream));
    return memory;
}

/// Memory by address: reserved, created, mapped as far as is asked for.
struct Mapping {
    CUmemGenericAllocationHandle memory = 0;
    CUdeviceptr address = 0;
    std::size_t bytes = 0;
};
inline Mapping make_mapping(bool is_mapped) {
    CUmemAllocationProp properties{};
    properties.type = CU_MEM_ALLOCATION_TYPE_PINNED;
    properties.location = {CU_MEM_LOCATION_TYPE_DEVICE, 0};
    Mapping its;
    MUST(cuMemGetAllocationGranularity(&its.bytes, &properties, CU_MEM_ALLOC_GRANULARITY_MINIMUM));
    MUST(cuMemAddressReserve(&its.address, its.bytes, 0, 0, 0));
    MUST(cuMemCreate(&its.memory, its.bytes, &properties, 0));
    if (is_mapped) MUST(cuMemMap(its.address, its.bytes, 0, its.memory, 0));
    return its;
}
inline CUresult set_access(const Mapping& its) {
    CUmemAccessDesc access{};
    access.location = {CU_MEM_LOCATION_TYPE_DEVICE, 0};
    access.flags = CU_MEM_ACCESS_FLAGS_PROT_READWRITE;
    return cuMemSetAccess(its.address, its.bytes, &access, 1);
}

/// @returns a call that sets the limit to this, or to half of it if it is this
inline Call other_limit(CUlimit limit, std::size_t value) {
    std::size_t now = 0;
    MUST(cuCtxGetLimit(&now, limit));
    return [=] { return cuCtxSetLimit(limit, now == value ? value / 2 : value); };
}

inline CUgreenCtx make_green(CUdevice device) {
    CUdevResource resource{};
    CUdevResourceDesc description = nullptr;
    CUgreenCtx green = nullptr;
    if (cuDeviceGetDevResource(device, &resource, CU_DEV_RESOURCE_TYPE_SM) != CUDA_SUCCESS ||
        cuDevResourceGenerateDesc(&description, &resource, 1) != CUDA_SUCCESS ||
        cuGreenCtxCreate(&green, description, device, CU_GREEN_CTX_DEFAULT_STREAM) != CUDA_SUCCESS)
        return nullptr;
    return green;
}

}  // namespace parking
