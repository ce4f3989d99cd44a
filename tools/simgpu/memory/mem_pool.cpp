// SPDX-License-Identifier: Apache-2.0
//
// Which freed block is given out again, and when the rest goes back.
#include "tools/simgpu/memory/mem_pool.h"

#include <algorithm>

namespace urgengo::simgpu {
namespace {

constexpr std::size_t kGranularity = 512;

}  // namespace

bool MemPool::may_reuse(const Block& block, const Context* context,
                        const std::shared_ptr<StreamQueue>& queue) const {
    if (block.context != context) return false;
    return block.freed.queue == queue || (settings_.allow_opportunistic && block.freed.passed());
}

std::optional<std::uintptr_t> MemPool::allocate(std::size_t bytes, Context* context,
                                                const std::shared_ptr<StreamQueue>& queue) {
    if (bytes > device_limit_bytes_) return std::nullopt;
    const std::size_t size = (bytes + kGranularity - 1) / kGranularity * kGranularity;
    std::lock_guard lock(mutex_);
    // The smallest that is large enough, but not twice too large: blocks are never split.
    auto best = free_.end();
    for (auto it = free_.begin(); it != free_.end(); ++it) {
        if (it->bytes < size || it->bytes > 2 * size || !may_reuse(*it, context, queue)) continue;
        if (best == free_.end() || it->bytes < best->bytes) best = it;
    }
    std::optional<std::uintptr_t> base;
    std::size_t used = size;
    if (best != free_.end()) {
        base = best->base;
        used = best->bytes;
        memory_.revive(*base, bytes);
        free_.erase(best);
    } else {
        if (most_bytes_ != 0 && usage_.reserved_bytes + size > most_bytes_) {
            trim_locked(most_bytes_ > size ? most_bytes_ - size : 0);
            if (usage_.reserved_bytes + size > most_bytes_) return std::nullopt;
        }
        base =
            memory_.allocate_for(shared_from_this(), size, context, device_, device_limit_bytes_);
        if (!base) return base;
        memory_.revive(*base, bytes);
        usage_.reserved_bytes += size;
        usage_.reserved_high_bytes = std::max(usage_.reserved_high_bytes, usage_.reserved_bytes);
    }
    usage_.used_bytes += used;
    usage_.used_high_bytes = std::max(usage_.used_high_bytes, usage_.used_bytes);
    return base;
}

void MemPool::take_back(const Allocation& allocation, Fence freed) {
    std::lock_guard lock(mutex_);
    free_.push_back({allocation.base, allocation.capacity, allocation.context, std::move(freed)});
}

void MemPool::count_freed(std::size_t bytes) {
    std::lock_guard lock(mutex_);
    usage_.used_bytes -= std::min<std::uint64_t>(bytes, usage_.used_bytes);
}

void MemPool::trim_to(std::uint64_t keep_bytes) {
    std::lock_guard lock(mutex_);
    trim_locked(keep_bytes);
}

void MemPool::trim_locked(std::uint64_t keep_bytes) {
    for (auto it = free_.begin(); it != free_.end() && usage_.reserved_bytes > keep_bytes;) {
        if (!it->freed.passed()) {
            ++it;
            continue;
        }
        memory_.remove(it->base);
        usage_.reserved_bytes -= it->bytes;
        it = free_.erase(it);
    }
}

void MemPool::lose(const Allocation& allocation) {
    std::lock_guard lock(mutex_);
    free_.remove_if([&](const Block& block) { return block.base == allocation.base; });
    usage_.reserved_bytes -= allocation.capacity;
    if (!allocation.retired) usage_.used_bytes -= allocation.capacity;
}

MemPool::Settings MemPool::settings() const {
    std::lock_guard lock(mutex_);
    return settings_;
}

void MemPool::set(const Settings& settings) {
    std::lock_guard lock(mutex_);
    settings_ = settings;
}

MemPool::Usage MemPool::usage() const {
    std::lock_guard lock(mutex_);
    return usage_;
}

void MemPool::reset_reserved_high() {
    std::lock_guard lock(mutex_);
    usage_.reserved_high_bytes = usage_.reserved_bytes;
}

void MemPool::reset_used_high() {
    std::lock_guard lock(mutex_);
    usage_.used_high_bytes = usage_.used_bytes;
}

}  // namespace urgengo::simgpu
