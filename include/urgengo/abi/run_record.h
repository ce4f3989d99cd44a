// SPDX-License-Identifier: Apache-2.0
//
// What happened in a program under UrgenGo: frames, GPU segments, waits, holds and behind whom,
// priorities, and when the GPU was seen to be where. One 64-byte record an event, written by the
// threads that it happened to (host/observe/run_recorder.h), read by `urgengo trace`.
//
// The same file in two places:
//
//   urgengo-<pid namespace>-<process>-<start>.records   in /dev/shm, beside the status page
//       (abi/status_page.h): the flight recorder. A thread overwrites its oldest records.
//   a file that `urgengo run --trace` names, or `urgengo ctl dump` has copied: a trace (.ugtrace).
//       While the program runs, a thread that has filled a ring gets another one, until the file
//       is full: then the newest are lost, and counted.
//
// The file is a RunHeader, then sections by its offsets: RunChain[], RunTask[], conditions, and
// rings. A ring is a RunRing and `ring_records` records behind it. One thread at a time writes a
// ring; record number n of it is at [n % ring_records], and `written` counts them, after they are
// there. So the file is complete whatever ends the program, but for the record that was being
// written then.
//
// A reader of a file that is being written reads `written` again after the records: those that may
// have been overwritten meanwhile are `written + kRunMargin - ring_records` and older.
//
// Versions only add: kinds, fields in what is reserved, sections. A reader steps by the sizes that
// the header tells, and passes over kinds that it does not know.
//
// Times are nanoseconds on CLOCK_MONOTONIC.
#pragma once

#include <cstdint>

#include "urgengo/abi/shared_page.h"
#include "urgengo/abi/status_page.h"

namespace urgengo::abi {

inline constexpr std::uint64_t kRunMagic = 0x524e'5552'4f47'4755;  // "UGGORUNR"
inline constexpr std::uint32_t kRunVersion = 1;
/// Records beyond `written` that a thread may be at: it stores them before it says so.
inline constexpr std::uint64_t kRunMargin = 8;

/// Which records a full ring loses.
enum class RunKeeps : std::uint32_t { kNewest = 0, kOldest = 1 };

struct RunHeader {
    std::uint64_t magic;  ///< written last: all else that never changes is there
    std::uint32_t version;
    std::uint32_t header_bytes;  ///< sizeof(RunHeader)
    std::uint32_t record_bytes;  ///< sizeof(RunRecord)
    std::uint32_t ring_records;  ///< of each ring
    RunKeeps keeps;
    // Whose records they are, as in StatusHeader:
    std::uint32_t process;
    std::uint64_t start_ticks, pid_namespace;
    char boot_id[40];
    char program[kNameBytes];
    std::int64_t begin_ns;           ///< when the recording began
    std::int64_t begin_realtime_ns;  ///< CLOCK_REALTIME then
    StatusSection chains, tasks;
    StatusSection rings;  ///< an element is a RunRing and its records; count: room for so many
    // By who has copied the file; 0: it is no copy.
    std::int64_t copied_ns, copied_realtime_ns;
    StatusSection conditions;  ///< a JSON object: config, machine, ...; an element is a byte

    // What changes:
    std::uint32_t rings_used;    ///< from the first one on
    std::uint32_t threads_lost;  ///< that found no ring
    std::uint64_t lost;          ///< records that found no room
    char gpu[56];  ///< its name and the driver's CUDA version, once known; to 320 bytes
};

struct RunChain {
    char name[kNameBytes];
    std::int64_t period_ns, deadline_ns;
    std::uint32_t first_task, num_tasks;
    char reserved[8];
};

struct RunTask {
    char name[kNameBytes];
    std::uint32_t chain, stage;
    char reserved[24];
};

struct RunRing {
    std::uint32_t owner;   ///< id of the thread that writes it; 0: none, any more
    std::uint32_t thread;  ///< the last one that did
    std::uint64_t written;
    std::uint64_t first;  ///< of a copy: the first record that is whole
    char thread_name[16];
    char reserved[24];
};

enum class RunKind : std::uint8_t {
    kNone = 0,
    kFrameBegin,    ///< a frame has come to its chain; `number`
    kFrameEnd,      ///< it came to its end; `frame` tells how
    kFrameDropped,  ///< a frame of the chain counts as missed, and never came to its end
    kTaskBegin,     ///< a task begins to work on a frame
    kTaskEnd,
    kSegmentBegin,  ///< the task's first launch after a wait; `segment`
    kSegmentEnd,    ///< its work is over; or, without kRunIdle, left where it was
    kWaitBegin,     ///< its thread waits for the GPU
    kWaitEnd,
    kHoldBegin,  ///< a launch waits: `why`, and behind whom. With another reason it is another hold
    kHoldEnd,
    kPriority,   ///< its launches go at another priority from here on; `priority`
    kMark,       ///< the GPU has got so far: the first look that saw it; `mark`
    kMode,       ///< what UrgenGo does from here on; `mode`
    kTrip,       ///< it has switched itself off
    kCpuUse,     ///< CPU time of the process so far; `cpu`. Once a second at most
    kChainMode,  ///< what a chain may be at most from here on, as `urgengo ctl` says; `mode`
    kReload,     ///< another config was taken
    kGuard,      ///< what the guard gives a chain from here on; `way`
    kClock,  ///< what the GPU's clock was at a time of the host's; `clock`. Once a second at most
    kPark,   ///< calls that wait for all GPU work were under way, so no gate was closed; `park`. Of
             ///< those that found tasks behind gates, or kept launches in their threads
    kRound,  ///< gates were opened by rounds; `round`. Those that open none are not recorded
};

inline constexpr std::uint16_t kRunLegacyStream = 1;  ///< the default stream; others come after it

/// Record flags.
inline constexpr std::uint8_t kRunExited = 1;  ///< kFrameEnd: its program was told to end it early
inline constexpr std::uint8_t kRunHinted = 2;  ///< kTaskBegin: by a hint
inline constexpr std::uint8_t kRunObserved = 4;  ///< kTaskBegin: it is not scheduled
inline constexpr std::uint8_t kRunIdle = 8;      ///< kSegmentEnd: all that was launched is over
inline constexpr std::uint8_t kRunPaced = 16;    ///< kHold*: for its own work ahead of the GPU
inline constexpr std::uint8_t kRunGate = 32;     ///< kHold*: behind a gate; its thread goes on
inline constexpr std::uint8_t kRunCopy = 64;     ///< kHold*: of a copy
inline constexpr std::uint8_t kRunByGpu = 128;  ///< kRound: rounds of the GPU's, as a look saw them

/// Ends carry their begin, so that they tell the whole even where the begin was overwritten.
struct RunRecord {
    RunKind kind;
    std::uint8_t flags;
    Why why;  ///< kHold*
    std::uint8_t reserved;
    std::int16_t chain;    ///< index; -1: of none
    std::int16_t task;     ///< index over all tasks; -1: of none
    std::uint32_t thread;  ///< id (gettid)
    std::uint32_t number;  ///< kFrameBegin: of the chain's frames, from 1. Of a task: counts its
                           ///< instances
    std::int64_t time_ns;  ///< when it happened
    /// *End, kPark: when it had begun. kMark: when the GPU executed it, on the GPU's clock turned
    /// into the host's; 0: not known. kRound: when the round began; of the GPU's, the look before:
    /// they were at some time after that.
    std::int64_t begin_ns;
    /// Of the frame that it is about: tells a chain's frames apart. 0: see `number`.
    std::int64_t arrival_ns;
    std::int16_t behind_chain, behind_task;  ///< kHold*, kFrameEnd: that it was behind; -1: none
    MissCause cause;                         ///< kFrameEnd; kNone: it was in time
    union {
        std::uint16_t cause_detail;  ///< kFrameEnd: as MissCause says of it; 0: not told
        /// kSegment*, kMark: where the task's last launch before it went; numbered as they are
        /// first seen here, and a handle that is used again keeps its number. 0: not known.
        std::uint16_t stream;
    };
    union {
        struct {
            std::int64_t latency_ns;
            std::int64_t amount_ns;  ///< that the cause took of it
        } frame;                     ///< kFrameEnd
        struct {
            std::uint32_t position;  ///< launches of the instance so far
            std::uint32_t reserved;
            std::int64_t estimate_ns;  ///< kSegmentEnd: GPU time of what was launched, by the plan
        } segment;                     ///< kSegment*
        struct {
            std::uint32_t position;  ///< launches of the instance that have executed
            std::uint32_t sequence;  ///< of the mark
            std::int64_t laxity_ns;  ///< then
        } mark;                      ///< kMark
        struct {
            std::int32_t now, before;  ///< as the driver takes them: the smallest goes first
        } priority;                    ///< kPriority
        StatusMode mode;               ///< kMode, kChainMode
        std::uint32_t way;             ///< kGuard: as ChainStatus::guard
        struct {
            std::int64_t used_ns, reserved;
        } cpu;  ///< kCpuUse
        struct {
            std::uint64_t gpu_ns;  ///< low 48 bits of %globaltimer, which is not the host's clock
            std::int64_t host_ns;  ///< then, as well as it is known
        } clock;                   ///< kClock
        struct {
            std::int64_t opening_ns;  ///< that opening all gates took, of its whole time
            std::uint32_t gated;      ///< tasks that had closed gates
            std::uint32_t refused;    ///< launches that waited in their threads, not behind gates
        } park;                       ///< kPark
        struct {
            /// Gates. By the GPU: how often it opened some of a task's.
            std::uint32_t opened;
            std::uint32_t rounds;  ///< 1; of the GPU's all since the last such record
            std::int64_t took_ns;  ///< all of them; 0 where the GPU does not tell
        } round;                   ///< kRound
        std::int64_t words[2];
    };
};

static_assert(sizeof(RunHeader) == 320 && sizeof(RunChain) == 96 && sizeof(RunTask) == 96);
static_assert(sizeof(RunRing) == 64 && sizeof(RunRecord) == 64);

}  // namespace urgengo::abi
