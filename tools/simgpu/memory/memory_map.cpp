// SPDX-License-Identifier: Apache-2.0
//
// The map of known ranges.
#include "tools/simgpu/memory/memory_map.h"

#include <cstdlib>
#include <mutex>
#include <utility>

namespace urgengo::simgpu {
namespace {

constexpr std::size_t kAlignment = 512;

std::size_t size_of(const Allocation& allocation) {
    return allocation.capacity == 0 ? allocation.bytes : allocation.capacity;
}

}  // namespace

std::optional<std::uintptr_t> MemoryMap::allocate(Allocation::Kind kind, std::size_t bytes,
                                                  unsigned flags, Context* context, int device,
                                                  std::size_t device_limit_bytes) {
    Allocation allocation{kind, 0, bytes, flags, context, 0, nullptr};
    allocation.device = device;
    std::unique_lock lock(mutex_);
    if (takes_device_memory(allocation) && bytes > device_limit_bytes - device_bytes_of(allocation))
        return std::nullopt;
    if (bytes > SIZE_MAX - kAlignment) return std::nullopt;
    // calloc: large allocations are zero without being touched, as aligned ones would not be.
    void* const raw = std::calloc(1, bytes + kAlignment);
    if (raw == nullptr) return std::nullopt;
    allocation.storage = std::shared_ptr<void>(raw, std::free);
    allocation.base =
        (reinterpret_cast<std::uintptr_t>(raw) + kAlignment - 1) / kAlignment * kAlignment;
    allocation.id = next_id_++;
    if (takes_device_memory(allocation)) device_bytes_of(allocation) += bytes;
    const std::uintptr_t base = allocation.base;
    allocations_.emplace(base, std::move(allocation));
    return base;
}

std::optional<std::uintptr_t> MemoryMap::allocate_for(std::shared_ptr<MemPool> pool,
                                                      std::size_t bytes, Context* context,
                                                      int device, std::size_t device_limit_bytes) {
    const auto base =
        allocate(Allocation::Kind::kDevice, bytes, 0, context, device, device_limit_bytes);
    if (!base) return base;
    std::unique_lock lock(mutex_);
    Allocation& allocation = allocations_.at(*base);
    allocation.pool = std::move(pool);
    allocation.capacity = bytes;
    return base;
}

void MemoryMap::give_to_graph(std::uintptr_t base, std::shared_ptr<std::atomic<bool>> uses) {
    std::unique_lock lock(mutex_);
    allocations_.at(base).graph_uses = std::move(uses);
}

bool MemoryMap::retire(std::uintptr_t base) {
    std::unique_lock lock(mutex_);
    const auto it = allocations_.find(base);
    if (it == allocations_.end() || it->second.retired) return false;
    it->second.retired = true;
    return true;
}

void MemoryMap::revive(std::uintptr_t base, std::size_t bytes) {
    std::unique_lock lock(mutex_);
    Allocation& allocation = allocations_.at(base);
    allocation.retired = false;
    allocation.bytes = bytes;
    allocation.id = next_id_++;
}

bool MemoryMap::add(Allocation::Kind kind, std::uintptr_t base, std::size_t bytes, unsigned flags,
                    Context* context, int device) {
    std::unique_lock lock(mutex_);
    const auto next = allocations_.upper_bound(base);
    if (next != allocations_.end() && next->first < base + bytes) return false;
    if (next != allocations_.begin()) {
        const Allocation& before = std::prev(next)->second;
        if (before.base + before.bytes > base) return false;
    }
    Allocation allocation{kind, base, bytes, flags, context, next_id_++, nullptr};
    allocation.device = device;
    allocations_.emplace(base, std::move(allocation));
    return true;
}

bool MemoryMap::take_device_bytes(int device, std::size_t bytes, std::size_t device_limit_bytes) {
    std::unique_lock lock(mutex_);
    std::size_t& taken = device_bytes_[static_cast<std::size_t>(device)];
    if (bytes > device_limit_bytes - taken) return false;
    taken += bytes;
    return true;
}

void MemoryMap::give_device_bytes(int device, std::size_t bytes) {
    std::unique_lock lock(mutex_);
    device_bytes_[static_cast<std::size_t>(device)] -= bytes;
}

std::optional<Allocation> MemoryMap::find(std::uintptr_t address) const {
    std::shared_lock lock(mutex_);
    const auto next = allocations_.upper_bound(address);
    if (next == allocations_.begin()) return std::nullopt;
    const Allocation& allocation = std::prev(next)->second;
    if (address - allocation.base >= allocation.bytes || allocation.retired) return std::nullopt;
    return allocation;
}

std::optional<Allocation> MemoryMap::remove(std::uintptr_t base) {
    std::unique_lock lock(mutex_);
    const auto it = allocations_.find(base);
    if (it == allocations_.end()) return std::nullopt;
    Allocation allocation = std::move(it->second);
    allocations_.erase(it);
    if (takes_device_memory(allocation)) device_bytes_of(allocation) -= size_of(allocation);
    return allocation;
}

std::vector<Allocation> MemoryMap::remove_all_of(const Context* context) {
    std::vector<Allocation> removed;
    std::unique_lock lock(mutex_);
    for (auto it = allocations_.begin(); it != allocations_.end();) {
        if (it->second.context != context) {
            ++it;
            continue;
        }
        if (takes_device_memory(it->second)) device_bytes_of(it->second) -= size_of(it->second);
        removed.push_back(std::move(it->second));
        it = allocations_.erase(it);
    }
    return removed;
}

std::size_t MemoryMap::device_bytes(int device) const {
    std::shared_lock lock(mutex_);
    return device_bytes_[static_cast<std::size_t>(device)];
}

}  // namespace urgengo::simgpu
