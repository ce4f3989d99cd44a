// SPDX-License-Identifier: Apache-2.0
//
// A stream as the engine sees it: commands that run one after the other, and how far they have
// come.
//
// Ownership: the engine's thread alone touches `commands` and `head`; `progress` is written by it
// and read by any thread; `submitted` belongs to the thread that submits, under one lock for all
// streams (GpuThread's), so that tickets are handed out in the order in which the engine sees the
// commands.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "tools/simgpu/engine/part.h"

namespace urgengo::simgpu {

struct StreamQueue;

/// How many of a stream's commands have completed.
class Progress {
  public:
    bool reached(std::uint64_t ticket) const {
        return completed_.load(std::memory_order_seq_cst) >= ticket;
    }

    /// @threads the engine's only
    void publish(std::uint64_t ticket);

    /// @threads any but the engine's
    void wait_for(std::uint64_t ticket);

  private:
    std::atomic<std::uint64_t> completed_{0};
    std::atomic<int> num_waiters_{0};
    std::mutex mutex_;
    std::condition_variable advanced_;
};

/// "Everything on that stream up to and including its ticket-th command."
struct Fence {
    std::shared_ptr<StreamQueue> queue;
    std::uint64_t ticket = 0;

    bool passed() const;
    void wait() const;
};

struct KernelWork {
    std::shared_ptr<const std::string> name;
    std::uint64_t num_blocks = 1;
    int blocks_per_sm = 1;  ///< 1 to SmArray::kMaxBlocksPerSm
    Time block_time{1};
    int priority = 0;               ///< smaller is dispatched first
    bool overlaps_launch = false;   ///< programmatic serialisation hides the launch overhead
    std::function<void(Time)> run;  ///< at its end; may be empty
    std::function<void(Time start, Time end)> stamp{};  ///< at its end; may be empty
    std::uint64_t launch = 0;  ///< id of the call that launched it (launch_call.h)
};

/// Memory that a command writes when it ends, so that waits for a value there are looked at then.
struct MemoryRange {
    std::uintptr_t begin = 0;
    std::size_t num_bytes = 0;

    bool contains(std::uintptr_t address) const {
        return address >= begin && address - begin < num_bytes;
    }
};

enum class CopyEngine { kHostToDevice, kDeviceToHost, kOnDevice };
inline constexpr int kNumCopyEngines = 3;

/// One at a time on each copy engine, in the order in which they become ready.
struct CopyWork {
    CopyEngine engine;
    Time duration{0};
    std::function<void()> run;  ///< at its end
    MemoryRange writes{};
    bool is_memset = false;
};

/// Takes its time and no resource: event records (0), stream writes, frees.
struct TimedWork {
    Time duration{0};
    std::function<void(Time)> run;  ///< at its end; may be empty
    MemoryRange writes{};
};

/// Holds the stream until a value in memory is as wished.
struct ValueWait {
    std::uintptr_t address;
    std::function<bool()> is_open;
    /// It has been open: at its submission, or when the engine's owner last looked.
    bool seen_open = false;
};

/// A host function: runs outside the engine, which is told of its end.
struct HostCall {
    std::function<void()> run;
};

using Work = std::variant<KernelWork, CopyWork, TimedWork, ValueWait, HostCall>;

struct Command {
    Work work;
    std::vector<Fence> fences;  ///< other streams' work that comes first
    std::uint64_t ticket = 0;
};

/// A kernel at the head of its stream, from the moment when it may start.
struct KernelRun {
    StreamQueue* queue;
    const KernelWork* work;
    std::uint64_t order;  ///< of becoming ready
    std::uint64_t num_undispatched;
    std::uint64_t num_running = 0;
    std::optional<Time> start;
};

struct StreamQueue {
    enum class Kind { kBlocking, kNonBlocking, kLegacy };

    StreamQueue(std::uint64_t id_, Kind kind_, std::uint64_t group_, int device_ = 0)
        : id(id_), kind(kind_), group(group_), device(device_) {}

    const std::uint64_t id;
    const Kind kind;
    const std::uint64_t group;  ///< the context: the legacy stream synchronises within one
    const int device;

    std::uint64_t submitted = 0;  ///< under the submitters' lock
    Progress progress;

    // The engine's own.
    std::deque<Command> commands;
    bool active = false;        ///< in the engine's list
    bool head_started = false;  ///< the first command has begun, or its start is scheduled
    std::optional<KernelRun> kernel;
    std::optional<Time> last_kernel_end;
};

}  // namespace urgengo::simgpu
