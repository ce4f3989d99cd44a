// SPDX-License-Identifier: Apache-2.0
//
// Every range of memory that the driver knows: what it allocated, host memory that the program
// registered, addresses that the program mapped memory to. Device memory lives on the host, and a
// device pointer is the host address.
// Thread-safe.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <shared_mutex>
#include <vector>

#include "tools/simgpu/engine/part.h"

namespace urgengo::simgpu {

struct Context;
class MemPool;

struct Allocation {
    enum class Kind { kDevice, kManaged, kHost, kRegistered, kMapped };

    Kind kind;
    std::uintptr_t base;
    std::size_t bytes;
    unsigned flags;
    Context* context;  ///< null for mapped memory, which is every context's of the device
    std::uint64_t id;
    std::shared_ptr<void> storage;    ///< empty for registered and mapped memory
    std::shared_ptr<MemPool> pool{};  ///< where it goes back to; usually none
    std::size_t capacity = 0;         ///< of the storage, which a pool may give out again
    /// Of a graph's memory: whether the program has it. Freeing it says no, and keeps the range.
    std::shared_ptr<std::atomic<bool>> graph_uses{};
    int device = 0;        ///< of the context, or that the memory is on
    bool retired = false;  ///< freed into its pool: the program must not use it

    bool on_device() const { return may_be_freed() || kind == Kind::kMapped; }
    /// As device memory is, by cuMemFree.
    bool may_be_freed() const { return kind == Kind::kDevice || kind == Kind::kManaged; }
};

class MemoryMap {
  public:
    /// Allocates zeroed memory, aligned as the driver aligns it (512 bytes).
    /// @returns nothing if the host has not that much
    std::optional<std::uintptr_t> allocate(Allocation::Kind kind, std::size_t bytes, unsigned flags,
                                           Context* context, int device,
                                           std::size_t device_limit_bytes);

    /// Adds memory that was not allocated here.
    /// @returns false if part of the range is known already
    bool add(Allocation::Kind kind, std::uintptr_t base, std::size_t bytes, unsigned flags,
             Context* context, int device);

    /// Counts memory of the device that has no address yet, as long as it exists.
    /// @returns false if the device has not that much
    bool take_device_bytes(int device, std::size_t bytes, std::size_t device_limit_bytes);
    void give_device_bytes(int device, std::size_t bytes);

    /// @returns the allocation that `address` lies in
    std::optional<Allocation> find(std::uintptr_t address) const;

    /// As allocate(), for a pool to take back.
    std::optional<std::uintptr_t> allocate_for(std::shared_ptr<MemPool> pool, std::size_t bytes,
                                               Context* context, int device,
                                               std::size_t device_limit_bytes);

    void give_to_graph(std::uintptr_t base, std::shared_ptr<std::atomic<bool>> uses);

    /// Makes a pool's allocation unknown, without giving up its memory.
    /// @returns false if none starts at `base`, or it is retired already
    bool retire(std::uintptr_t base);

    /// Gives a retired allocation out again, with at most its capacity.
    void revive(std::uintptr_t base, std::size_t bytes);

    /// Forgets the allocation that starts at `base`. Its memory is freed with the returned object.
    std::optional<Allocation> remove(std::uintptr_t base);

    /// Counts host memory as the device's too: an integrated part has one memory.
    /// @threads before any other call
    void share_with_host() { shared_ = true; }

    /// Forgets all that belongs to the context; the memory is freed with the returned objects.
    std::vector<Allocation> remove_all_of(const Context* context);

    std::size_t device_bytes(int device) const;

  private:
    std::size_t& device_bytes_of(const Allocation& allocation) {
        return device_bytes_[static_cast<std::size_t>(allocation.device)];
    }
    bool takes_device_memory(const Allocation& allocation) const {
        return allocation.may_be_freed() || (shared_ && allocation.kind == Allocation::Kind::kHost);
    }

    bool shared_ = false;
    mutable std::shared_mutex mutex_;
    std::map<std::uintptr_t, Allocation> allocations_;
    std::array<std::size_t, Part::kMostInMachine> device_bytes_{};
    std::uint64_t next_id_ = 1;
};

}  // namespace urgengo::simgpu
