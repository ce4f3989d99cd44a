// SPDX-License-Identifier: Apache-2.0
//
// Memory that programs put at addresses of their own: reserved addresses are the host's, without
// access; a piece of memory is a file in memory, so that it is the same wherever it is mapped. To
// unmap waits for the device's work, which may use it.
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <vector>

#include "tools/simgpu/api/driver_state.h"
#include "tools/simgpu/graph/capture.h"

using namespace urgengo::simgpu;

namespace {

constexpr std::size_t kGranularity = 2 << 20;

/// Lives until it is released and mapped nowhere.
struct Physical {
    Physical(int its_device, std::size_t its_bytes)
        : device(its_device), bytes(its_bytes), file(memfd_create("simgpu", MFD_CLOEXEC)) {
        if (file >= 0 && ftruncate(file, static_cast<off_t>(bytes)) != 0) {
            close(file);
            file = -1;
        }
    }
    ~Physical() {
        if (file >= 0) close(file);
        driver().memory.give_device_bytes(device, bytes);
    }
    Physical(const Physical&) = delete;
    Physical& operator=(const Physical&) = delete;

    int device;
    std::size_t bytes;
    int file;
};

struct Mapping {
    std::size_t bytes;
    std::shared_ptr<Physical> memory;
};

/// What was mapped and reserved, each by where it begins. Never deleted: see Driver.
struct Addresses {
    std::mutex mutex;
    std::map<CUdeviceptr, std::size_t> reserved;
    std::map<CUdeviceptr, Mapping> mapped;
    HandleTable<CUmemGenericAllocationHandle, Physical> memory;
};

Addresses& addresses() {
    static auto* const all = new Addresses;
    return *all;
}

/// Maps over what is there, which keeps the addresses ours.
bool map_over(CUdeviceptr address, std::size_t bytes, int flags, int file) {
    void* const where = reinterpret_cast<void*>(address);
    return mmap(where, bytes, PROT_NONE, flags | MAP_FIXED, file, 0) == where;
}

bool is_whole(std::size_t bytes) {
    return bytes != 0 && bytes % kGranularity == 0;
}

CUresult check(const CUmemAllocationProp* properties) {
    if (properties == nullptr || properties->type != CU_MEM_ALLOCATION_TYPE_PINNED ||
        properties->location.type != CU_MEM_LOCATION_TYPE_DEVICE)
        return CUDA_ERROR_INVALID_VALUE;
    return require_device(properties->location.id);
}

/// @returns the first of the mappings that make up just this range; end() if none do
std::map<CUdeviceptr, Mapping>::iterator first_within(Addresses& all, CUdeviceptr begin,
                                                      std::size_t bytes) {
    const auto first = all.mapped.find(begin);
    CUdeviceptr reached = begin;
    for (auto it = first; it != all.mapped.end() && reached < begin + bytes; ++it) {
        if (it->first != reached) return all.mapped.end();
        reached += it->second.bytes;
    }
    return reached == begin + bytes ? first : all.mapped.end();
}

/// @returns whether the range is reserved, and nothing is mapped there
bool is_free(Addresses& all, CUdeviceptr begin, std::size_t bytes) {
    auto place = all.reserved.upper_bound(begin);
    if (place == all.reserved.begin()) return false;
    --place;
    if (begin + bytes > place->first + place->second) return false;
    const auto next = all.mapped.lower_bound(begin);
    if (next != all.mapped.end() && next->first < begin + bytes) return false;
    if (next == all.mapped.begin()) return true;
    const auto& [before, mapping] = *std::prev(next);
    return before + mapping.bytes <= begin;
}

void synchronize_device(int device) {
    std::vector<Context*> its;  // synchronize() locks the table too
    driver().contexts.for_each([&](Context& context) {
        if (context.device == device && !context.destroyed) its.push_back(&context);
    });
    for (Context* context : its) synchronize(*context);
}

}  // namespace

SIMGPU_API CUresult cuMemGetAllocationGranularity(std::size_t* bytes,
                                                  const CUmemAllocationProp* properties,
                                                  CUmemAllocationGranularity_flags) {
    if (CUresult error = require_init()) return error;
    if (bytes == nullptr) return CUDA_ERROR_INVALID_VALUE;
    if (CUresult error = check(properties)) return error;
    *bytes = kGranularity;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMemAddressReserve(CUdeviceptr* address, std::size_t bytes,
                                        std::size_t alignment, CUdeviceptr /*wish*/,
                                        unsigned long long flags) {
    if (CUresult error = require_init()) return error;
    alignment = std::max(alignment, kGranularity);
    const bool is_power = (alignment & (alignment - 1)) == 0;
    if (address == nullptr || !is_whole(bytes) || !is_power || flags != 0 ||
        bytes > SIZE_MAX - alignment)
        return CUDA_ERROR_INVALID_VALUE;
    constexpr int kFlags = MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE;
    void* const found = mmap(nullptr, bytes + alignment, PROT_NONE, kFlags, -1, 0);
    if (found == MAP_FAILED) return CUDA_ERROR_OUT_OF_MEMORY;
    const auto begin = reinterpret_cast<std::uintptr_t>(found);
    const std::uintptr_t aligned = (begin + alignment - 1) / alignment * alignment;
    if (aligned != begin) munmap(found, aligned - begin);
    munmap(reinterpret_cast<void*>(aligned + bytes), begin + alignment - aligned);
    const std::lock_guard lock(addresses().mutex);
    addresses().reserved[aligned] = bytes;
    *address = aligned;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMemAddressFree(CUdeviceptr address, std::size_t bytes) {
    if (CUresult error = require_init()) return error;
    Addresses& all = addresses();
    const std::lock_guard lock(all.mutex);
    const auto found = all.reserved.find(address);
    if (found == all.reserved.end() || found->second != bytes || !is_free(all, address, bytes))
        return CUDA_ERROR_INVALID_VALUE;
    munmap(reinterpret_cast<void*>(address), bytes);
    all.reserved.erase(found);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMemCreate(CUmemGenericAllocationHandle* handle, std::size_t bytes,
                                const CUmemAllocationProp* properties, unsigned long long flags) {
    if (CUresult error = require_init()) return error;
    if (handle == nullptr || !is_whole(bytes) || flags != 0) return CUDA_ERROR_INVALID_VALUE;
    if (CUresult error = check(properties)) return error;
    const int device = properties->location.id;
    if (!driver().memory.take_device_bytes(device, bytes, driver().part.memory_bytes))
        return CUDA_ERROR_OUT_OF_MEMORY;
    auto memory = std::make_shared<Physical>(device, bytes);
    if (memory->file < 0) return CUDA_ERROR_OUT_OF_MEMORY;
    *handle = addresses().memory.add(std::move(memory));
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMemRelease(CUmemGenericAllocationHandle handle) {
    if (CUresult error = require_init()) return error;
    return addresses().memory.remove(handle) ? CUDA_SUCCESS : CUDA_ERROR_INVALID_VALUE;
}

SIMGPU_API CUresult cuMemMap(CUdeviceptr address, std::size_t bytes, std::size_t offset,
                             CUmemGenericAllocationHandle handle, unsigned long long flags) {
    if (CUresult error = require_init()) return error;
    Addresses& all = addresses();
    auto memory = all.memory.find(handle);
    if (!memory || bytes != memory->bytes || offset != 0 || flags != 0 ||
        address % kGranularity != 0)
        return CUDA_ERROR_INVALID_VALUE;
    const std::lock_guard lock(all.mutex);
    if (!is_free(all, address, bytes)) return CUDA_ERROR_INVALID_VALUE;
    if (!map_over(address, bytes, MAP_SHARED, memory->file)) return CUDA_ERROR_OUT_OF_MEMORY;
    driver().memory.add(Allocation::Kind::kMapped, address, bytes, 0, nullptr, memory->device);
    all.mapped[address] = {bytes, std::move(memory)};
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMemSetAccess(CUdeviceptr address, std::size_t bytes,
                                   const CUmemAccessDesc* access, std::size_t count) {
    if (CUresult error = require_init()) return error;
    if (access == nullptr || count == 0) return CUDA_ERROR_INVALID_VALUE;
    Addresses& all = addresses();
    const std::lock_guard lock(all.mutex);
    const auto first = first_within(all, address, bytes);
    if (first == all.mapped.end()) return CUDA_ERROR_INVALID_VALUE;
    for (std::size_t i = 0; i < count; ++i) {
        // Of other devices there are no peers.
        if (access[i].location.type != CU_MEM_LOCATION_TYPE_DEVICE ||
            access[i].location.id != first->second.memory->device)
            return CUDA_ERROR_INVALID_DEVICE;
        const int rights = access[i].flags == CU_MEM_ACCESS_FLAGS_PROT_NONE ? PROT_NONE
                           : access[i].flags == CU_MEM_ACCESS_FLAGS_PROT_READ
                               ? PROT_READ
                               : PROT_READ | PROT_WRITE;
        mprotect(reinterpret_cast<void*>(address), bytes, rights);
    }
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMemUnmap(CUdeviceptr address, std::size_t bytes) {
    if (CUresult error = require_init()) return error;
    Addresses& all = addresses();
    int device = 0;
    {
        const std::lock_guard lock(all.mutex);
        const auto first = first_within(all, address, bytes);
        if (first == all.mapped.end()) return CUDA_ERROR_INVALID_VALUE;
        device = first->second.memory->device;
    }
    if (CUresult error = require_safe_call()) return error;
    synchronize_device(device);
    const std::lock_guard lock(all.mutex);
    auto it = first_within(all, address, bytes);
    if (it == all.mapped.end()) return CUDA_ERROR_INVALID_VALUE;
    map_over(address, bytes, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1);
    while (it != all.mapped.end() && it->first < address + bytes) {
        driver().memory.remove(it->first);
        it = all.mapped.erase(it);
    }
    return CUDA_SUCCESS;
}
