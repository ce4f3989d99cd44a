// SPDX-License-Identifier: Apache-2.0
//
// Stream-ordered allocation and memory pools. A pointer is valid when the call returns; its memory
// is that of the pool, which knows whose work it must not overtake (mem_pool.h).
#include <cstring>

#include "tools/simgpu/api/driver_state.h"
#include "tools/simgpu/graph/capture.h"
#include "tools/simgpu/graph/graph.h"

using namespace urgengo::simgpu;

namespace {

std::atomic<CUmemoryPool>& current_pool(CUdevice device) {
    return driver().current_pools[static_cast<std::size_t>(device)];
}

CUmemoryPool default_pool(CUdevice device) {
    return driver().default_pools[static_cast<std::size_t>(device)];
}

/// @param[in] pool_handle  null for the current one of the stream's device
CUresult allocate(CUdeviceptr* pointer, std::size_t bytes, CUmemoryPool pool_handle,
                  CUstream stream_handle) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(stream_handle, stream)) return error;
    if (pool_handle == nullptr) pool_handle = current_pool(stream->context->device);
    const auto pool = driver().pools.find(pool_handle);
    if (pointer == nullptr || bytes == 0 || !pool) return CUDA_ERROR_INVALID_VALUE;
    if (is_capturing(*stream)) {
        GraphNode node;
        if (CUresult error = make_alloc_node(*stream->context->owner(), bytes, node)) return error;
        *pointer = node.memory->base;
        capture_node(*stream, std::move(node));
        return CUDA_SUCCESS;
    }
    const auto base = pool->allocate(bytes, stream->context->owner(), stream->queue);
    if (!base) return CUDA_ERROR_OUT_OF_MEMORY;
    *pointer = *base;
    return CUDA_SUCCESS;
}

CUresult find_pool(CUmemoryPool handle, std::shared_ptr<MemPool>& pool) {
    if (CUresult error = require_init()) return error;
    pool = driver().pools.find(handle);
    return pool ? CUDA_SUCCESS : CUDA_ERROR_INVALID_VALUE;
}

bool is_a_device(const CUmemLocation& location) {
    return location.type == CU_MEM_LOCATION_TYPE_DEVICE &&
           require_device(location.id) == CUDA_SUCCESS;
}

template <typename T>
CUresult put(void* to, T value) {
    std::memcpy(to, &value, sizeof value);
    return CUDA_SUCCESS;
}

template <typename T>
T load(const void* from) {
    T value;
    std::memcpy(&value, from, sizeof value);
    return value;
}

CUresult get_attribute(const MemPool& pool, CUmemPool_attribute which, void* value) {
    const MemPool::Settings settings = pool.settings();
    const MemPool::Usage usage = pool.usage();
    switch (which) {
        case CU_MEMPOOL_ATTR_REUSE_FOLLOW_EVENT_DEPENDENCIES:
            return put(value, int{settings.follow_event_dependencies});
        case CU_MEMPOOL_ATTR_REUSE_ALLOW_OPPORTUNISTIC:
            return put(value, int{settings.allow_opportunistic});
        case CU_MEMPOOL_ATTR_REUSE_ALLOW_INTERNAL_DEPENDENCIES:
            return put(value, int{settings.allow_internal_dependencies});
        case CU_MEMPOOL_ATTR_RELEASE_THRESHOLD:
            return put(value, cuuint64_t{settings.release_threshold_bytes});
        case CU_MEMPOOL_ATTR_RESERVED_MEM_CURRENT:
            return put(value, cuuint64_t{usage.reserved_bytes});
        case CU_MEMPOOL_ATTR_RESERVED_MEM_HIGH:
            return put(value, cuuint64_t{usage.reserved_high_bytes});
        case CU_MEMPOOL_ATTR_USED_MEM_CURRENT:
            return put(value, cuuint64_t{usage.used_bytes});
        case CU_MEMPOOL_ATTR_USED_MEM_HIGH:
            return put(value, cuuint64_t{usage.used_high_bytes});
        default:
            return CUDA_ERROR_INVALID_VALUE;
    }
}

CUresult set_attribute(MemPool& pool, CUmemPool_attribute which, const void* value) {
    MemPool::Settings settings = pool.settings();
    switch (which) {
        case CU_MEMPOOL_ATTR_REUSE_FOLLOW_EVENT_DEPENDENCIES:
            settings.follow_event_dependencies = load<int>(value) != 0;
            break;
        case CU_MEMPOOL_ATTR_REUSE_ALLOW_OPPORTUNISTIC:
            settings.allow_opportunistic = load<int>(value) != 0;
            break;
        case CU_MEMPOOL_ATTR_REUSE_ALLOW_INTERNAL_DEPENDENCIES:
            settings.allow_internal_dependencies = load<int>(value) != 0;
            break;
        case CU_MEMPOOL_ATTR_RELEASE_THRESHOLD:
            settings.release_threshold_bytes = load<cuuint64_t>(value);
            break;
        case CU_MEMPOOL_ATTR_RESERVED_MEM_HIGH:  // the high-water marks can only be reset
            if (load<cuuint64_t>(value) != 0) return CUDA_ERROR_INVALID_VALUE;
            pool.reset_reserved_high();
            return CUDA_SUCCESS;
        case CU_MEMPOOL_ATTR_USED_MEM_HIGH:
            if (load<cuuint64_t>(value) != 0) return CUDA_ERROR_INVALID_VALUE;
            pool.reset_used_high();
            return CUDA_SUCCESS;
        default:
            return CUDA_ERROR_INVALID_VALUE;
    }
    pool.set(settings);
    return CUDA_SUCCESS;
}

}  // namespace

SIMGPU_API CUresult cuMemAllocAsync(CUdeviceptr* pointer, std::size_t bytes, CUstream stream) {
    return allocate(pointer, bytes, nullptr, stream);
}

SIMGPU_API CUresult cuMemAllocFromPoolAsync(CUdeviceptr* pointer, std::size_t bytes,
                                            CUmemoryPool pool, CUstream stream) {
    if (pool == nullptr) return CUDA_ERROR_INVALID_VALUE;
    return allocate(pointer, bytes, pool, stream);
}

SIMGPU_API CUresult cuMemFreeAsync(CUdeviceptr pointer, CUstream handle) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(handle, stream)) return error;
    MemoryMap& memory = driver().memory;
    const auto found = memory.find(pointer);
    if (!found || found->base != pointer || !found->may_be_freed()) return CUDA_ERROR_INVALID_VALUE;
    if (is_capturing(*stream)) {
        GraphNode node;  // of memory that a graph allocated: there is no other in a capture
        if (CUresult error = make_free_node(pointer, node)) return error;
        capture_node(*stream, std::move(node));
        return CUDA_SUCCESS;
    }
    if (found->graph_uses) {
        return found->graph_uses->exchange(false) ? CUDA_SUCCESS : CUDA_ERROR_INVALID_VALUE;
    }
    // Unknown to the program from here on; the memory itself goes when the stream gets there.
    if (!found->pool) {
        auto removed = memory.remove(pointer);
        if (!removed) return CUDA_ERROR_INVALID_VALUE;
        submit(*stream, TimedWork{Time{0}, [storage = std::move(removed->storage)](Time) {}});
        return CUDA_SUCCESS;
    }
    if (!memory.retire(pointer)) return CUDA_ERROR_INVALID_VALUE;
    Fence freed = submit(*stream, TimedWork{Time{0}, [pool = found->pool, bytes = found->capacity](
                                                         Time) { pool->count_freed(bytes); }});
    found->pool->take_back(*found, std::move(freed));
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMemPoolCreate(CUmemoryPool* handle, const CUmemPoolProps* props) {
    if (CUresult error = require_init()) return error;
    if (handle == nullptr || props == nullptr) return CUDA_ERROR_INVALID_VALUE;
    const bool possible =
        props->allocType == CU_MEM_ALLOCATION_TYPE_PINNED && is_a_device(props->location);
    if (!possible) return CUDA_ERROR_INVALID_VALUE;
    // There is no other process to share it with.
    if (props->handleTypes != CU_MEM_HANDLE_TYPE_NONE) return CUDA_ERROR_NOT_SUPPORTED;
    Driver& state = driver();
    *handle = state.pools.add(std::make_shared<MemPool>(state.memory, props->location.id,
                                                        state.part.memory_bytes, props->maxSize));
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMemPoolDestroy(CUmemoryPool handle) {
    std::shared_ptr<MemPool> pool;
    if (CUresult error = find_pool(handle, pool)) return error;
    Driver& state = driver();
    const CUmemoryPool fallback = default_pool(pool->device());
    if (handle == fallback) return CUDA_ERROR_INVALID_VALUE;
    state.pools.remove(handle);
    // What is allocated from it stays; the device falls back to its default pool.
    current_pool(pool->device()).compare_exchange_strong(handle, fallback);
    pool->set({.release_threshold_bytes = 0});
    pool->trim();
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMemPoolTrimTo(CUmemoryPool handle, std::size_t keep_bytes) {
    std::shared_ptr<MemPool> pool;
    if (CUresult error = find_pool(handle, pool)) return error;
    pool->trim_to(keep_bytes);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMemPoolGetAttribute(CUmemoryPool handle, CUmemPool_attribute which,
                                          void* value) {
    std::shared_ptr<MemPool> pool;
    if (CUresult error = find_pool(handle, pool)) return error;
    return value == nullptr ? CUDA_ERROR_INVALID_VALUE : get_attribute(*pool, which, value);
}

SIMGPU_API CUresult cuMemPoolSetAttribute(CUmemoryPool handle, CUmemPool_attribute which,
                                          void* value) {
    std::shared_ptr<MemPool> pool;
    if (CUresult error = find_pool(handle, pool)) return error;
    return value == nullptr ? CUDA_ERROR_INVALID_VALUE : set_attribute(*pool, which, value);
}

SIMGPU_API CUresult cuMemPoolGetAccess(CUmemAccess_flags* flags, CUmemoryPool handle,
                                       CUmemLocation* location) {
    std::shared_ptr<MemPool> pool;
    if (CUresult error = find_pool(handle, pool)) return error;
    if (flags == nullptr || location == nullptr || !is_a_device(*location)) {
        return CUDA_ERROR_INVALID_VALUE;
    }
    *flags = location->id == pool->device() ? CU_MEM_ACCESS_FLAGS_PROT_READWRITE
                                            : CU_MEM_ACCESS_FLAGS_PROT_NONE;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMemPoolSetAccess(CUmemoryPool handle, const CUmemAccessDesc* map,
                                       std::size_t count) {
    std::shared_ptr<MemPool> pool;
    if (CUresult error = find_pool(handle, pool)) return error;
    // The device always has access to its own pool, and no other can have it (no peer access).
    for (std::size_t i = 0; i < count; ++i) {
        const bool possible = map != nullptr && is_a_device(map[i].location) &&
                              map[i].location.id == pool->device() &&
                              map[i].flags == CU_MEM_ACCESS_FLAGS_PROT_READWRITE;
        if (!possible) return CUDA_ERROR_INVALID_VALUE;
    }
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDeviceGetDefaultMemPool(CUmemoryPool* pool, CUdevice device) {
    if (CUresult error = require_device(device)) return error;
    if (pool == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *pool = default_pool(device);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDeviceGetMemPool(CUmemoryPool* pool, CUdevice device) {
    if (CUresult error = require_device(device)) return error;
    if (pool == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *pool = current_pool(device);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDeviceSetMemPool(CUdevice device, CUmemoryPool handle) {
    if (CUresult error = require_device(device)) return error;
    std::shared_ptr<MemPool> pool;
    if (CUresult error = find_pool(handle, pool)) return error;
    if (pool->device() != device) return CUDA_ERROR_INVALID_VALUE;
    current_pool(device) = handle;
    return CUDA_SUCCESS;
}
