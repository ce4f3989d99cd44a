// SPDX-License-Identifier: Apache-2.0
//
// Allocation, host memory, and what is known about a pointer.
#include <cstring>

#include "tools/simgpu/api/driver_state.h"
#include "tools/simgpu/graph/capture.h"

using namespace urgengo::simgpu;

namespace {

CUresult allocate(Allocation::Kind kind, std::size_t bytes, unsigned flags, void** address) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    if (address == nullptr || bytes == 0) return CUDA_ERROR_INVALID_VALUE;
    if (CUresult error = require_safe_call()) return error;
    const auto base = driver().memory.allocate(kind, bytes, flags, context->owner(),
                                               context->device, driver().part.memory_bytes);
    if (!base) return CUDA_ERROR_OUT_OF_MEMORY;
    *address = reinterpret_cast<void*>(*base);
    return CUDA_SUCCESS;
}

CUresult allocate_device(Allocation::Kind kind, std::size_t bytes, unsigned flags,
                         CUdeviceptr* pointer) {
    if (pointer == nullptr) return CUDA_ERROR_INVALID_VALUE;
    void* address = nullptr;
    if (CUresult error = allocate(kind, bytes, flags, &address)) return error;
    *pointer = reinterpret_cast<CUdeviceptr>(address);
    return CUDA_SUCCESS;
}

/// Frees what starts at `base`, once the work of its context, which may use it, is done.
CUresult free_allocation(std::uintptr_t base, bool (*expected)(const Allocation&),
                         CUresult unknown) {
    if (CUresult error = require_init()) return error;
    const auto allocation = driver().memory.find(base);
    if (!allocation || allocation->base != base || !expected(*allocation)) return unknown;
    if (CUresult error = require_safe_call()) return error;
    if (CUresult error = allocation->context->broken) return error;
    synchronize(*allocation->context);
    if (allocation->graph_uses) {
        return allocation->graph_uses->exchange(false) ? CUDA_SUCCESS : unknown;
    }
    if (allocation->pool) {
        if (!driver().memory.retire(base)) return unknown;
        allocation->pool->count_freed(allocation->capacity);
        allocation->pool->take_back(*allocation, {});
        trim_pools();
        return CUDA_SUCCESS;
    }
    return driver().memory.remove(base) ? CUDA_SUCCESS : unknown;
}

bool on_device(const Allocation& allocation) {
    return allocation.may_be_freed();
}
bool on_host(const Allocation& allocation) {
    return allocation.kind == Allocation::Kind::kHost;
}
bool registered(const Allocation& allocation) {
    return allocation.kind == Allocation::Kind::kRegistered;
}

template <typename T>
CUresult store(void* data, T value) {
    std::memcpy(data, &value, sizeof value);
    return CUDA_SUCCESS;
}

CUresult pointer_attribute(void* data, CUpointer_attribute which, const Allocation& its,
                           CUdeviceptr pointer) {
    switch (which) {
        case CU_POINTER_ATTRIBUTE_CONTEXT:
            return store(data, its.context);
        case CU_POINTER_ATTRIBUTE_MEMORY_TYPE:
            return store(data, its.on_device() ? CU_MEMORYTYPE_DEVICE : CU_MEMORYTYPE_HOST);
        case CU_POINTER_ATTRIBUTE_DEVICE_POINTER:
            return store(data, pointer);
        case CU_POINTER_ATTRIBUTE_HOST_POINTER:
            if (its.kind == Allocation::Kind::kDevice || its.kind == Allocation::Kind::kMapped) {
                store(data, CUdeviceptr{0});
                return CUDA_ERROR_INVALID_VALUE;
            }
            return store(data, pointer);
        case CU_POINTER_ATTRIBUTE_BUFFER_ID:
            return store(data, std::uint64_t{its.id});
        case CU_POINTER_ATTRIBUTE_IS_MANAGED:
            return store(data, unsigned{its.kind == Allocation::Kind::kManaged});
        case CU_POINTER_ATTRIBUTE_DEVICE_ORDINAL:
            return store(data, int{its.device});
        case CU_POINTER_ATTRIBUTE_RANGE_START_ADDR:
            return store(data, CUdeviceptr{its.base});
        case CU_POINTER_ATTRIBUTE_RANGE_SIZE:
            return store(data, its.bytes);
        case CU_POINTER_ATTRIBUTE_MAPPED:
            return store(data, unsigned{1});
        default:
            return CUDA_ERROR_NOT_SUPPORTED;
    }
}

}  // namespace

SIMGPU_API CUresult cuMemAlloc_v2(CUdeviceptr* pointer, std::size_t bytes) {
    return allocate_device(Allocation::Kind::kDevice, bytes, 0, pointer);
}

SIMGPU_API CUresult cuMemAllocManaged(CUdeviceptr* pointer, std::size_t bytes, unsigned flags) {
    if (flags != CU_MEM_ATTACH_GLOBAL && flags != CU_MEM_ATTACH_HOST) {
        return CUDA_ERROR_INVALID_VALUE;
    }
    return allocate_device(Allocation::Kind::kManaged, bytes, flags, pointer);
}

SIMGPU_API CUresult cuMemFree_v2(CUdeviceptr pointer) {
    if (pointer == 0) return require_init();
    return free_allocation(pointer, on_device, CUDA_ERROR_INVALID_VALUE);
}

SIMGPU_API CUresult cuMemAllocHost_v2(void** address, std::size_t bytes) {
    return allocate(Allocation::Kind::kHost, bytes, 0, address);
}

SIMGPU_API CUresult cuMemHostAlloc(void** address, std::size_t bytes, unsigned flags) {
    constexpr unsigned kKnown =
        CU_MEMHOSTALLOC_PORTABLE | CU_MEMHOSTALLOC_DEVICEMAP | CU_MEMHOSTALLOC_WRITECOMBINED;
    if (address == nullptr || (flags & ~kKnown) != 0) return CUDA_ERROR_INVALID_VALUE;
    if (bytes == 0) {  // unlike device memory: nothing, successfully
        *address = nullptr;
        return require_init();
    }
    return allocate(Allocation::Kind::kHost, bytes, flags, address);
}

SIMGPU_API CUresult cuMemFreeHost(void* address) {
    if (address == nullptr) return require_init();
    return free_allocation(reinterpret_cast<std::uintptr_t>(address), on_host,
                           CUDA_ERROR_INVALID_VALUE);
}

SIMGPU_API CUresult cuMemHostRegister_v2(void* address, std::size_t bytes, unsigned flags) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    if (address == nullptr || bytes == 0) return CUDA_ERROR_INVALID_VALUE;
    if (CUresult error = require_safe_call()) return error;
    const bool added = driver().memory.add(Allocation::Kind::kRegistered,
                                           reinterpret_cast<std::uintptr_t>(address), bytes, flags,
                                           context->owner(), context->device);
    return added ? CUDA_SUCCESS : CUDA_ERROR_HOST_MEMORY_ALREADY_REGISTERED;
}

SIMGPU_API CUresult cuMemHostRegister(void* address, std::size_t bytes, unsigned flags) {
    return cuMemHostRegister_v2(address, bytes, flags);
}

SIMGPU_API CUresult cuMemHostUnregister(void* address) {
    const auto base = reinterpret_cast<std::uintptr_t>(address);
    const auto within = driver().memory.find(base);
    return free_allocation(
        base, registered,
        within ? CUDA_ERROR_INVALID_VALUE : CUDA_ERROR_HOST_MEMORY_NOT_REGISTERED);
}

SIMGPU_API CUresult cuMemHostGetDevicePointer_v2(CUdeviceptr* pointer, void* address,
                                                 unsigned flags) {
    if (CUresult error = require_init()) return error;
    const auto base = reinterpret_cast<std::uintptr_t>(address);
    const auto allocation = driver().memory.find(base);
    const bool mapped = allocation && allocation->kind != Allocation::Kind::kDevice &&
                        allocation->kind != Allocation::Kind::kMapped;
    if (pointer == nullptr || flags != 0 || !mapped) return CUDA_ERROR_INVALID_VALUE;
    *pointer = base;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMemHostGetFlags(unsigned* flags, void* address) {
    if (CUresult error = require_init()) return error;
    const auto allocation = driver().memory.find(reinterpret_cast<std::uintptr_t>(address));
    if (flags == nullptr || !allocation || allocation->on_device()) {
        return CUDA_ERROR_INVALID_VALUE;
    }
    *flags = allocation->flags | CU_MEMHOSTALLOC_DEVICEMAP;  // all of it is
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMemGetInfo_v2(std::size_t* free_bytes, std::size_t* total_bytes) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    const std::size_t total = driver().part.memory_bytes;
    if (free_bytes != nullptr) *free_bytes = total - driver().memory.device_bytes(context->device);
    if (total_bytes != nullptr) *total_bytes = total;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMemGetAddressRange_v2(CUdeviceptr* base, std::size_t* bytes,
                                            CUdeviceptr pointer) {
    if (CUresult error = require_init()) return error;
    const auto allocation = driver().memory.find(pointer);
    if (!allocation) return CUDA_ERROR_NOT_FOUND;
    if (base != nullptr) *base = allocation->base;
    if (bytes != nullptr) *bytes = allocation->bytes;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuPointerGetAttribute(void* data, CUpointer_attribute which,
                                          CUdeviceptr pointer) {
    if (CUresult error = require_init()) return error;
    const auto allocation = driver().memory.find(pointer);
    if (data == nullptr || !allocation) return CUDA_ERROR_INVALID_VALUE;
    return pointer_attribute(data, which, *allocation, pointer);
}

SIMGPU_API CUresult cuPointerGetAttributes(unsigned num_attributes, CUpointer_attribute* which,
                                           void** data, CUdeviceptr pointer) {
    if (CUresult error = require_init()) return error;
    if (which == nullptr || data == nullptr) return CUDA_ERROR_INVALID_VALUE;
    // For memory that the driver does not know this answers "nothing", or not at all, and succeeds,
    // unlike the function for one attribute.
    const auto allocation = driver().memory.find(pointer);
    for (unsigned i = 0; i < num_attributes; ++i) {
        if (allocation) {
            pointer_attribute(data[i], which[i], *allocation, pointer);
            continue;
        }
        switch (which[i]) {
            case CU_POINTER_ATTRIBUTE_DEVICE_ORDINAL:
                store(data[i], int{-2});  // how the driver says "no device"
                break;
            case CU_POINTER_ATTRIBUTE_MEMORY_TYPE:
            case CU_POINTER_ATTRIBUTE_IS_MANAGED:
            case CU_POINTER_ATTRIBUTE_MAPPED:
                store(data[i], unsigned{0});
                break;
            case CU_POINTER_ATTRIBUTE_HOST_POINTER:
                store(data[i], pointer);
                break;
            case CU_POINTER_ATTRIBUTE_CONTEXT:
            case CU_POINTER_ATTRIBUTE_DEVICE_POINTER:
            case CU_POINTER_ATTRIBUTE_BUFFER_ID:
                store(data[i], std::uint64_t{0});
                break;
            default:
                break;
        }
    }
    return CUDA_SUCCESS;
}
