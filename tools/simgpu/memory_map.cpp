// SPDX-License-Identifier: Apache-2.0
//
// The map of known ranges.
#include "tools/simgpu/memory_map.h"

#include <cstdlib>
#include <mutex>
#include <utility>

namespace urgengo::simgpu {
namespace {

constexpr std::size_t kAlignment = 512;

}  // namespace

std::optional<std::uintptr_t> MemoryMap::allocate(Allocation::Kind kind, std::size_t bytes,
                                                  unsigned flags, Context* context,
                                                  std::size_t device_limit_bytes) {
    Allocation allocation{kind, 0, bytes, flags, context, 0, nullptr};
    std::unique_lock lock(mutex_);
    if (takes_device_memory(allocation) && bytes > device_limit_bytes - device_bytes_)
        return std::nullopt;
    if (bytes > SIZE_MAX - kAlignment) return std::nullopt;
    // calloc: large allocations are zero without being touched, as aligned ones would not be.
    void* const raw = std::calloc(1, bytes + kAlignment);
    if (raw == nullptr) return std::nullopt;
    allocation.storage = std::shared_ptr<void>(raw, std::free);
    allocation.base =
        (reinterpret_cast<std::uintptr_t>(raw) + kAlignment - 1) / kAlignment * kAlignment;
    allocation.id = next_id_++;
    if (takes_device_memory(allocation)) device_bytes_ += bytes;
    const std::uintptr_t base = allocation.base;
    allocations_.emplace(base, std::move(allocation));
    return base;
}

bool MemoryMap::register_host(std::uintptr_t base, std::size_t bytes, unsigned flags,
                              Context* context) {
    std::unique_lock lock(mutex_);
    const auto next = allocations_.upper_bound(base);
    if (next != allocations_.end() && next->first < base + bytes) return false;
    if (next != allocations_.begin()) {
        const Allocation& before = std::prev(next)->second;
        if (before.base + before.bytes > base) return false;
    }
    allocations_.emplace(base, Allocation{Allocation::Kind::kRegistered, base, bytes, flags,
                                          context, next_id_++, nullptr});
    return true;
}

std::optional<Allocation> MemoryMap::find(std::uintptr_t address) const {
    std::shared_lock lock(mutex_);
    const auto next = allocations_.upper_bound(address);
    if (next == allocations_.begin()) return std::nullopt;
    const Allocation& allocation = std::prev(next)->second;
    if (address - allocation.base >= allocation.bytes) return std::nullopt;
    return allocation;
}

std::optional<Allocation> MemoryMap::remove(std::uintptr_t base) {
    std::unique_lock lock(mutex_);
    const auto it = allocations_.find(base);
    if (it == allocations_.end()) return std::nullopt;
    Allocation allocation = std::move(it->second);
    allocations_.erase(it);
    if (takes_device_memory(allocation)) device_bytes_ -= allocation.bytes;
    return allocation;
}

void MemoryMap::remove_all_of(const Context* context) {
    std::unique_lock lock(mutex_);
    for (auto it = allocations_.begin(); it != allocations_.end();) {
        if (it->second.context != context) {
            ++it;
            continue;
        }
        if (takes_device_memory(it->second)) device_bytes_ -= it->second.bytes;
        it = allocations_.erase(it);
    }
}

std::size_t MemoryMap::device_bytes() const {
    std::shared_lock lock(mutex_);
    return device_bytes_;
}

}  // namespace urgengo::simgpu
