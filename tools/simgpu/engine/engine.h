// SPDX-License-Identifier: Apache-2.0
//
// The simulated GPU itself, in virtual time: no clock, no thread, no lock.
//
// 1 Streams. A stream's commands run one after the other. Its first command starts once all of its
//   fences (other streams' commands: event waits, the legacy stream's rule) have passed. A kernel
//   starts no earlier than `launch_overhead` after the kernel before it on its stream.
// 2 Legacy stream. A command on it waits for everything submitted before it to the blocking streams
//   of its context; a command on a blocking stream waits for everything submitted before it to the
//   legacy stream.
// 3 Blocks, of each device by itself: kernels that may run stand in order of priority, then of
// becoming ready. Whenever SMs
//   have room, the first takes what it can use; the next is served only when no block of the first
//   is left to dispatch. What has been dispatched runs to its end.
// 4 Copies. Three engines a device, each first come, first served, whatever the stream's priority.
// 5 Waits for a value. What the engine writes is seen at its nominal time. What the host writes is
//   seen by look_at_memory(), and takes effect at open_seen_waits(); between the two the owner
//   plays in all that was submitted before it looked. So a stream never runs on before work that
//   the program submitted ahead of opening it.
// 6 Time. advance_to(t) handles every event up to t at its own nominal time, so that it does not
//   matter how late or how rarely it is called.
//
// Not thread-safe: one owner (GpuThread, or a test).
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <list>
#include <memory>
#include <optional>
#include <queue>
#include <set>
#include <vector>

#include "tools/simgpu/engine/part.h"
#include "tools/simgpu/engine/sm_array.h"
#include "tools/simgpu/engine/stream_queue.h"

namespace urgengo::simgpu {

/// One completed kernel, as the log and the tests see it.
struct KernelRecord {
    std::shared_ptr<const std::string> name;
    int device;
    std::uint64_t stream_id;
    int priority;
    std::uint64_t num_blocks;
    Time start;
    Time end;
    std::uint64_t launch = 0;  ///< KernelWork::launch
};

class Engine {
  public:
    using QueuePtr = std::shared_ptr<StreamQueue>;

    struct Hooks {
        /// Runs a host function and sees to it that finish_host_call() is called, later.
        std::function<void(QueuePtr, std::function<void()>)> host_call;
        std::function<void(const KernelRecord&)> kernel_done;
    };

    Engine(const Part& part, Hooks hooks);
    Engine(const Engine&) = delete;
    Engine& operator=(const Engine&) = delete;

    /// Appends a command at the time now(). Tickets of one stream come in order.
    void submit(const QueuePtr& queue, Command command);

    /// Ends the host call at the head of the stream, at the time now().
    void finish_host_call(StreamQueue& queue);

    /// Lets time pass. Does nothing if `time` has been reached already.
    void advance_to(Time time);

    Time now() const { return now_; }

    /// @returns when something is due next, if anything is
    std::optional<Time> next_event() const;

    /// @returns whether a stream waits for a value that the host may write
    bool has_value_waits() const;

    /// Notes which of those waits are open.
    void look_at_memory();

    /// Ends the waits that were seen open, at the time now().
    void open_seen_waits();

  private:
    struct Event {
        Time time;
        std::uint64_t order;
        std::function<void()> run;
    };
    struct Later {
        bool operator()(const Event& a, const Event& b) const {
            return a.time != b.time ? a.time > b.time : a.order > b.order;
        }
    };
    struct MoreUrgent {
        bool operator()(const KernelRun* a, const KernelRun* b) const {
            return a->work->priority != b->work->priority ? a->work->priority < b->work->priority
                                                          : a->order < b->order;
        }
    };
    /// Blocks of one kernel that start, and so end, together.
    struct BlockGroup {
        KernelRun* run;
        SmArray::Placement placement;
    };

    /// What the streams of one device share.
    struct Device {
        explicit Device(int num_sms) : sms(num_sms) {}

        SmArray sms;
        std::set<KernelRun*, MoreUrgent> undispatched;
        std::array<std::deque<StreamQueue*>, kNumCopyEngines> copies;  ///< the first is under way
    };

    Device& device_of(const StreamQueue& queue);
    void schedule(Time time, std::function<void()> run);
    void add_legacy_fences(const StreamQueue& queue, std::vector<Fence>& fences) const;
    void settle();
    bool try_start(const QueuePtr& queue);
    // Start the head of the stream; @returns whether that completed it.
    bool start(const QueuePtr& queue, KernelWork& work);
    bool start(const QueuePtr& queue, CopyWork& work);
    bool start(const QueuePtr& queue, TimedWork& work);
    bool start(const QueuePtr& queue, ValueWait& work);
    bool start(const QueuePtr& queue, HostCall& work);
    void become_ready(StreamQueue& queue);
    void dispatch_blocks(Device& device);
    void end_group(std::list<BlockGroup>::iterator group);
    void end_kernel(KernelRun& run);
    void start_copy(Device& device, CopyEngine engine);
    void end_copy(Device& device, CopyEngine engine);
    void look_at(const MemoryRange& written);
    void complete(StreamQueue& queue);

    const Time launch_overhead_;
    const Hooks hooks_;
    Time now_{0};
    std::uint64_t next_order_ = 0;
    std::priority_queue<Event, std::vector<Event>, Later> events_;
    std::vector<QueuePtr> active_;  ///< the streams with commands
    std::vector<Fence> seen_open_;  ///< the waits, by stream and ticket
    std::vector<Device> devices_;
    std::list<BlockGroup> groups_;
};

}  // namespace urgengo::simgpu
