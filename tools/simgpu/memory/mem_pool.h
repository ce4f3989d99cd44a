// SPDX-License-Identifier: Apache-2.0
//
// A pool of device memory for stream-ordered allocation.
//
// What is freed on a stream may be given out again at once on the same stream, which runs in order,
// and elsewhere once the stream has got as far as the free. What no stream uses goes back to the
// device at a synchronisation, down to the release threshold. The pool keeps addresses; the memory
// itself stays in the MemoryMap. Thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <optional>

#include "tools/simgpu/engine/stream_queue.h"
#include "tools/simgpu/memory/memory_map.h"

namespace urgengo::simgpu {

class MemPool : public std::enable_shared_from_this<MemPool> {
  public:
    struct Settings {
        bool follow_event_dependencies = true;
        bool allow_opportunistic = true;
        bool allow_internal_dependencies = true;
        std::uint64_t release_threshold_bytes = 0;
    };
    struct Usage {
        std::uint64_t reserved_bytes = 0;
        std::uint64_t reserved_high_bytes = 0;
        std::uint64_t used_bytes = 0;
        std::uint64_t used_high_bytes = 0;
    };

    MemPool(MemoryMap& memory, int device, std::size_t device_limit_bytes, std::size_t most_bytes)
        : memory_(memory),
          device_(device),
          device_limit_bytes_(device_limit_bytes),
          most_bytes_(most_bytes) {}

    int device() const { return device_; }

    /// @param[in] queue  the stream on which the memory is used first
    /// @returns nothing if the device, or the pool by its largest size, has not that much
    std::optional<std::uintptr_t> allocate(std::size_t bytes, Context* context,
                                           const std::shared_ptr<StreamQueue>& queue);

    /// Takes back what was retired in the map.
    /// @param[in] freed  passes when the stream has got as far as the free
    void take_back(const Allocation& allocation, Fence freed);

    /// The stream has got as far as the free of so much.
    void count_freed(std::size_t bytes);

    /// Gives unused memory back to the device until no more than so much is reserved.
    void trim_to(std::uint64_t keep_bytes);

    /// Trims to the release threshold.
    void trim() { trim_to(settings().release_threshold_bytes); }

    /// An allocation of the pool went with its context.
    void lose(const Allocation& allocation);

    Settings settings() const;
    void set(const Settings& settings);
    Usage usage() const;
    void reset_reserved_high();
    void reset_used_high();

  private:
    struct Block {
        std::uintptr_t base;
        std::size_t bytes;
        Context* context;
        Fence freed;
    };

    bool may_reuse(const Block& block, const Context* context,
                   const std::shared_ptr<StreamQueue>& queue) const;
    void trim_locked(std::uint64_t keep_bytes);

    MemoryMap& memory_;
    const int device_;
    const std::size_t device_limit_bytes_;
    const std::size_t most_bytes_;  ///< 0: no limit of its own
    mutable std::mutex mutex_;
    Settings settings_;
    Usage usage_;
    std::list<Block> free_;
};

}  // namespace urgengo::simgpu
