// SPDX-License-Identifier: Apache-2.0
//
// A GPU as a scheduler feels it, in virtual time.
//
// 1 Connections. A stream's commands go through one of so many queues. A queue's first command
//   waits for what is before it in its stream, and whatever is behind it in the queue waits with
//   it.
// 2 Dispatch. Kernels that may run stand in order of priority, then of becoming ready. The first
//   gets what room there is, block by block; what has been dispatched runs to its end.
// 3 Room. A multiprocessor holds so many threads; all of them together are one room. A block that
//   takes all of a multiprocessor (its threads, or its shared memory) needs an empty one,
//   and keeps others off it; other blocks go where the fewest are, so each is on another one
//   as long as there are any.
// 4 Sharing. A block alone on its multiprocessor takes KernelWork::block_ns; all blocks that are
//   resident get on equally fast, and the fullest multiprocessor, with a share of them rounded up,
//   says how fast. So a kernel alone leaves the tails of its waves empty, and several fill them. No
//   free parameter: it is what kernels do that issue as fast as they can at any occupancy
//   (host/sched/README.md, "Sharing"). A block that has its multiprocessor to itself is not
//   slowed down.
// 5 Gaps. From a kernel's end to the start of the next one in its stream: more while others run.
//   And none starts sooner after its launch than the GPU can hear of it.
// 6 Marks. A mark begins at once when what is before it in its stream has ended (programmatic
//   serialisation), takes its own time whatever else runs, and what is behind it waits for it. An
//   event needs nothing; a mark kernel needs a slot for its one warp, which it gets before all
//   others (on an H200 0.13 ms where waves of 0.2 ms take every slot).
// 7 Joins. A stream waits for all that another one has been given until then, as for an event that
//   is recorded there at that moment. What is behind it follows as in one stream: after the gap. A
//   stream that waits keeps its queue (1).
// 8 Gates. A stream waits until a word has a number, or a later one, and holds its queue meanwhile:
//   nothing of any stream passes there. (Measured: with the default 8 connections the 7th blocked
//   stream stalls unrelated ones.) What is behind it follows as behind a kernel.
#pragma once

#include <cstdint>
#include <deque>
#include <set>
#include <vector>

#include "tools/sim/event_queue.h"
#include "tools/sim/fluid_clock.h"

namespace urgengo::sim {

/// The defaults are an H200's, with what was measured there (host/sched/README.md).
struct GpuShape {
    int num_sms = 132;
    int threads_per_sm = 2048;
    nanoseconds gap{1'500};
    nanoseconds gap_shared{2'500};
    int num_connections = 8;
    /// From a launch's return to its kernel's start on an idle stream: what waiting for each 10 us
    /// kernel costs (+94 %: docs/measurements.md, `sync` alone) beyond the launch, the record, the
    /// gap and the host's seeing it.
    nanoseconds start{2'200};
};

struct KernelWork {
    std::uint32_t blocks = 1;
    std::uint32_t block_threads = 256;  ///< GpuShape::threads_per_sm: all of a multiprocessor
    double block_ns = 1;                ///< of a block alone on a multiprocessor
    int priority = 0;                   ///< smaller is dispatched first
    std::int64_t tag = 0;               ///< the launcher's own, told at the end
    bool is_mark = false;               ///< takes `mark`, and is no kernel
    nanoseconds mark{0};                ///< 0: an event
    /// The last so many blocks take less: of a kernel whose blocks, one for each multiprocessor,
    /// have tiles to do that do not divide evenly among them.
    std::uint32_t num_short = 0;
    double short_ns = 0;
    int joins = -1;  ///< a stream that is waited for, and is no kernel; -1: none
    /// A gate, and no kernel: waits until this word has `number`; -1: none. Where it has it
    /// already, the gate takes `mark` of its stream.
    int word = -1;
    std::uint32_t number = 0;
};

struct EndedKernel {
    int stream;
    std::int64_t tag;
};

class GpuModel {
  public:
    explicit GpuModel(const GpuShape& shape);

    /// @returns its number
    int add_stream();
    /// Appends to the stream at the time of the last advance().
    void launch(int stream, const KernelWork& work);
    /// What comes next on the stream waits for all that is on the other one by now.
    void join(int stream, int other);
    /// The word has this number from now on, and lets gates through that wait for it or an earlier
    /// one. @param late  until a stream that waits goes on
    void open(int word, std::uint32_t number, nanoseconds late);
    int num_streams() const { return static_cast<int>(streams_.size()); }
    /// @returns how many of the stream's kernels have ended, and have been launched
    std::uint64_t ended(int stream) const { return at(stream).num_ended; }
    std::uint64_t launched(int stream) const { return at(stream).num_launched; }

    /// @returns when something happens next by itself; kNever: nothing
    nanoseconds next() const;
    /// Lets time pass: no further than next().
    /// @returns the kernels that have ended, in order
    const std::vector<EndedKernel>& advance(nanoseconds now);

    /// @returns the time that a kernel takes alone, without a gap
    static double time_alone_ns(const GpuShape& shape, std::uint32_t blocks,
                                std::uint32_t block_threads, double block_ns);

  private:
    struct Command {
        int stream;
        KernelWork work;
        nanoseconds launched;
        std::uint64_t awaited = 0;  ///< of a join: the other stream's launches until then
    };
    struct Stream {
        int connection = 0;
        bool is_busy = false;  ///< its kernel is ready, runs, or will be ready after the gap
        bool has_run = false;
        nanoseconds last_end{0};
        std::uint64_t num_launched = 0, num_ended = 0;
        KernelWork work{};  ///< under way
        std::uint64_t order = 0;
        std::uint32_t undispatched = 0, running = 0;
        std::uint64_t awaited = 0;  ///< of the join under way
    };
    struct Ready {
        int priority;
        std::uint64_t order;
        int stream;
        auto operator<=>(const Ready&) const = default;
    };
    /// Blocks of one kernel that began, and so end, together.
    struct Group {
        int stream;
        std::uint32_t blocks;
    };

    const Stream& at(int stream) const { return streams_[static_cast<std::size_t>(stream)]; }
    Stream& at(int stream) { return streams_[static_cast<std::size_t>(stream)]; }
    void append(const Command& command);
    void release(int connection);
    void begin_gate(int stream);
    bool is_open(const KernelWork& gate) const;
    bool begin_join(int stream);
    void end_joins(int other);
    void make_ready(int stream);
    void begin_marks();
    void end_command(int stream);
    void dispatch();
    void end_group(int group);
    void share();
    bool is_whole(const KernelWork& work) const {
        return work.block_threads >= static_cast<std::uint32_t>(shape_.threads_per_sm);
    }
    std::uint64_t shared_sms() const {
        return static_cast<std::uint64_t>(shape_.num_sms) - whole_blocks_;
    }
    std::uint64_t room_for(const KernelWork& work) const;

    const GpuShape shape_;
    nanoseconds now_{0};
    std::vector<Stream> streams_;
    std::vector<std::deque<Command>> connections_;
    std::vector<bool> is_held_;  ///< by connection: by a gate
    std::vector<std::uint32_t> words_;
    EventQueue gaps_, marks_;
    std::vector<int> waiting_marks_;  ///< streams whose mark has no slot yet
    std::vector<int> joining_;        ///< streams that wait for another one
    std::vector<int> gated_;          ///< streams that stand before a closed gate
    std::set<Ready> ready_;
    std::uint64_t num_ready_ = 0;
    FluidClock clock_;  ///< of blocks that share,
    FluidClock whole_;  ///< and of those that have a multiprocessor each
    std::vector<Group> groups_;
    std::vector<int> free_groups_;
    std::uint64_t used_threads_ = 0;     ///< by blocks that share
    std::uint64_t resident_blocks_ = 0;  ///< of those,
    std::uint64_t spread_ = 0;           ///< on so many multiprocessors
    std::uint64_t whole_blocks_ = 0;     ///< resident, of the others
    std::vector<EndedKernel> ended_;
};

}  // namespace urgengo::sim
