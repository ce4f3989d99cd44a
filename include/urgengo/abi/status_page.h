// SPDX-License-Identifier: Apache-2.0
//
// What other programs may read of a process under UrgenGo, and the word by which they steer it: two
// files in /dev/shm, made when UrgenGo starts in the process and removed when it ends.
//
//   urgengo-<pid namespace>-<process>-<start>.page     StatusHeader, then sections by its offsets:
//                                                      SharedPage, ChainStatus[], TaskStatus[],
//                                                      PlannedLaunch[], KernelName[]
//   urgengo-<pid namespace>-<process>-<start>.control  ControlPage
//
// The page is the very memory that decisions are made by: nothing is copied for a reader, and the
// program does not know whether there is one. Its owner may read it, and the group that
// URGENGO_SHARE_GROUP names; only the process writes it. The control file may be written by both.
//
// A process that was killed leaves its files behind. A reader tells by `pid_namespace`,
// `process` and `start_ticks` whether they are of a process that is there, and removes those that
// are not (host/observe/page_folder.h).
//
// Versions only add: a field is never moved nor given another meaning. A reader of an older version
// steps by the sizes that the header tells, and knows a field by whether the section's element is
// that large.
//
// Times are nanoseconds on CLOCK_MONOTONIC. Numbers are relaxed atomics: one that is 0 may have
// been written a moment ago.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

#include "urgengo/abi/shared_page.h"

namespace urgengo::abi {

inline constexpr std::uint64_t kStatusMagic = 0x4547'4150'4f47'4755;   // "UGGOPAGE"
inline constexpr std::uint64_t kControlMagic = 0x4c52'5443'4f47'4755;  // "UGGOCTRL"
inline constexpr std::uint32_t kStatusVersion = 1;
inline constexpr std::uint32_t kSectionAlignment = 4096;
inline constexpr std::size_t kNameBytes = 64;
inline constexpr std::uint32_t kFrameRing = 1024;  ///< power of two
inline constexpr std::size_t kCauseCounters = 16;  ///< room for causes that are not yet known
inline constexpr std::uint32_t kControlRing = 32;  ///< power of two
inline constexpr std::uint32_t kMostPlannedLaunches = 65536, kMostKernelNames = 8192;  ///< 1 MiB
inline constexpr std::uint16_t kNoKernelName = 0xffff;
inline constexpr std::size_t kControlPathBytes = 2048, kControlTextBytes = 1020;

/// What UrgenGo does in the process. In the order of what it does: kOff, kObserve, kShadow,
/// kEnforce.
enum class StatusMode : std::uint32_t {
    kOff = 0,
    kObserve = 1,
    kEnforce = 2,
    kTripped = 3,
    kShadow = 4
};

/// Where a section begins in the file, and what it is made of.
struct StatusSection {
    std::uint64_t offset;
    std::uint32_t element_bytes;
    std::uint32_t count;
};

/// What became of a request.
enum class ControlResult : std::uint32_t {
    kNone = 0,
    kDone,
    kMeansNothing,  ///< its command is not known here
    kNoChain,       ///< there is no chain of this index
    kOffForGood,    ///< UrgenGo has switched itself off
    kRefused,       ///< StatusHeader::text says why
};

struct ControlAnswer {
    std::atomic<std::uint32_t> word;  ///< the request's; written last
    std::atomic<ControlResult> result;
};

struct StatusHeader {
    std::uint64_t magic;  ///< written last: all else that never changes is there
    std::uint32_t version;
    std::uint32_t header_bytes;  ///< sizeof(StatusHeader)
    std::uint64_t file_bytes;
    // Whose page it is:
    std::uint32_t process;        ///< in its pid namespace
    std::uint32_t user;           ///< effective
    std::uint64_t start_ticks;    ///< field 22 of /proc/<process>/stat; 0: not known
    std::uint64_t pid_namespace;  ///< inode of /proc/self/ns/pid; 0: not known
    char boot_id[40];             ///< /proc/sys/kernel/random/boot_id
    char program[kNameBytes];     ///< file name of its executable
    std::int64_t begin_ns;        ///< when UrgenGo started there
    StatusSection akb;            ///< one SharedPage
    StatusSection chains;         ///< ChainStatus, in the order of the config
    StatusSection tasks;          ///< TaskStatus, by slot
    StatusSection launches;       ///< PlannedLaunch, by TaskStatus::first_launch
    StatusSection kernel_names;   ///< KernelName, by PlannedLaunch::name
    char reserved[24];

    // What changes:
    alignas(64) std::atomic<StatusMode> mode;
    std::atomic<std::uint32_t> is_over;  ///< 1: the program has come to its exit
    /// The last word that was acted on, after the holds that it ends have ended; 0: none was.
    std::atomic<std::uint32_t> control_seen;
    std::atomic<std::uint32_t> control_refused;  ///< words that meant nothing, how many
    std::atomic<std::int64_t> control_seen_ns;   ///< when control_seen was
    std::atomic<std::uint32_t> is_controlled;    ///< 1: a thread waits for words
    /// Tasks in a hold that control_seen was to end, and that had not ended by then: their threads
    /// did not run meanwhile. Written before control_seen.
    std::atomic<std::uint32_t> holds_left;
    /// What looks of held launches have taken of the cores, going to sleep and waking up included;
    /// as of the last frame that ended.
    std::atomic<std::int64_t> looks_ns;
    /// Of request number n at [n % kControlRing]. Written before control_seen. A header that ends
    /// before it is of a program that heeds words of all chains alone.
    alignas(64) ControlAnswer answers[kControlRing];
    /// Of the last kReload: what it has changed, or why it was refused.
    std::atomic<std::uint32_t> text_word;  ///< its word; 0 while the text is written
    char text[kControlTextBytes];
};

/// A frame that came to its end.
struct FrameRecord {
    std::atomic<std::int64_t> end_ns;
    std::atomic<std::uint32_t> latency_us;  ///< saturated
    std::atomic<std::uint16_t> cause;       ///< MissCause; 0: it was in time
    std::atomic<std::int16_t> behind;       ///< chain that the cause names; -1: none
};

/// Why a frame was late (host/observe/miss_cause.h).
enum class MissCause : std::uint16_t {
    kNone = 0,       ///< it was not
    kUnknown,        ///< nothing took longer than it should, or nothing is known of it
    kOff,            ///< UrgenGo was off, or only observed
    kArrivedLate,    ///< its first task began later after its arrival than is usual
    kCpuLonger,      ///< the CPU took longer than profiled, or than is usual
    kGpuLonger,      ///< its own kernels did. Detail: how long to how long profiled, percent
    kHeld,           ///< it was held behind another chain
    kKernelInFront,  ///< a kernel of another chain, which cannot be interrupted, was on the GPU
    kShared,         ///< many kernels of another chain were on the GPU meanwhile
    kGivenUp,        ///< by the plan, as else another chain's would have been late. Detail: by
                     ///< that, in units of 10 us
    kWaited,         ///< its streams waited for another chain's work
    kDropped,        ///< it never came to its end; it is no FrameRecord
    kPriorityLate,   ///< less urgent work of another chain went at the same priority or a greater
                     ///< one: its own came too late
    kGivenUpItself,  ///< by the plan, as it would have been late itself. Detail: by that
    kEndedEarly,     ///< its program was told to end it (on_late: exit). Detail: what it would have
                     ///< been late by, even alone
    kOutside,  ///< its thread slept, neither for the GPU nor held: a lock, I/O, another thread
};

struct ChainStatus {
    char name[kNameBytes];
    std::atomic<std::int64_t> period_ns, deadline_ns;
    std::uint32_t first_task, num_tasks;
    std::atomic<StatusMode> mode;  ///< the config's
    /// What it may be at most, as of the last word that named the chain, and 1; 0: not told, none
    /// has.
    std::atomic<std::uint32_t> allowed_mode;

    // Counted when a frame comes or ends:
    alignas(64) std::atomic<std::uint64_t> instances;  ///< frames that arrived
    std::atomic<std::uint64_t> finished, missed, exited;
    std::atomic<std::uint32_t> misses_in_a_row, most_misses_in_a_row;
    std::atomic<std::uint32_t> guard;  ///< 0 enforce, 1 priorities, 2 observe: what is done for it
    std::atomic<std::uint32_t> late_starts;
    std::atomic<std::int64_t> latency_sum_ns, latency_max_ns;
    std::atomic<std::int64_t> last_arrival_ns;
    // Counted by its tasks, as of the last frame that ended:
    std::atomic<std::uint64_t> launches, scheduled, marks, holds;
    std::atomic<std::int64_t> held_ns, paced_ns;
    /// Missed frames, by MissCause: they add up to `missed`.
    std::atomic<std::uint64_t> causes[kCauseCounters];
    /// Of the last late frame:
    std::atomic<std::uint64_t> last_miss;  ///< its number among those that ended, from 1; 0: none
    std::atomic<std::uint16_t> last_cause;
    std::atomic<std::int16_t> last_behind;
    std::atomic<std::uint32_t> last_late_us;   ///< beyond its deadline
    std::atomic<std::int64_t> last_amount_ns;  ///< that the cause took of it

    /// The last frames that ended: number n at [n % kFrameRing], n from 0. `frames` counts them,
    /// after they are there.
    alignas(64) std::atomic<std::uint64_t> frames;
    FrameRecord ring[kFrameRing];

    // In the mode kShadow, as of the last frame that ended:
    alignas(64) std::atomic<std::uint64_t> would_hold;  ///< launches that would have been held
    std::atomic<std::int64_t> would_held_ns;
    std::atomic<std::int32_t> would_behind;  ///< chain that most of them would wait for, and 1; 0
    /// Of the last late frame, what MissCause says of its cause's detail; 0: not told. Saturated.
    std::atomic<std::uint16_t> last_detail;
};

struct TaskStatus {
    char name[kNameBytes];
    std::uint32_t chain, stage;
    std::uint32_t num_kernels;  ///< of its plan; 0: it has none
    /// Index of the plan's first PlannedLaunch, and 1: `num_kernels` of them. 0: there was no room.
    std::uint32_t first_launch;
    std::int64_t planned_gpu_ns;
    std::int64_t planned_cpu_ns;
    /// Of its last launches, as the driver takes it: the smallest goes first.
    std::atomic<std::int32_t> priority;
    char reserved[28];
};

/// A launch of a task's plan. Written once, when UrgenGo starts.
struct PlannedLaunch {
    std::uint32_t gpu_ns;  ///< by the profile; saturated
    std::uint16_t name;    ///< index of its KernelName; kNoKernelName: it is not told
    std::uint16_t reserved;
};
struct KernelName {
    char name[kNameBytes];  ///< mangled; what does not fit is cut off
};

/// What the word asks for. The rest of the word counts requests, so that no two are the same.
enum class ControlCommand : std::uint8_t {
    kNone = 0,
    kOff = 1,      ///< nothing is decided, held, marked or counted
    kObserve = 2,  ///< frames and launches are counted; nothing is changed
    kOn = 3,       ///< what the process was started with
    // The same of one chain: ControlRequest::chain. That of all chains holds besides, and the
    // weaker one counts.
    kChainOff = 16,
    kChainObserve = 17,
    kChainOn = 18,      ///< what the config says of the chain
    kReload = 19,       ///< takes what can change at run time from the config at ControlPage::path
    kShadow = 20,       ///< of all chains: decided as where it is done, and nothing of it is done
    kChainShadow = 21,  ///< the same of one chain
};

/// What a word says besides.
struct ControlRequest {
    std::atomic<std::uint32_t> word;   ///< its own: else it is of another request, and not heeded
    std::atomic<std::uint32_t> chain;  ///< index
};

struct ControlPage {
    std::uint64_t magic;
    std::uint32_t version;
    /// A futex: request number << 8 | ControlCommand. Whoever may write the file may write it.
    std::atomic<std::uint32_t> word;
    /// Of request number n at [n % kControlRing], written before the word: of words that come fast
    /// after each other none is left out.
    ControlRequest requests[kControlRing];
    char path[kControlPathBytes];  ///< absolute, of a resolved config; written before the word
};

constexpr std::uint32_t next_control_word(std::uint32_t word, ControlCommand command) {
    return ((word >> 8) + 1) << 8 | static_cast<std::uint32_t>(command);
}
constexpr ControlCommand command_of(std::uint32_t word) {
    return static_cast<ControlCommand>(word & 0xff);
}
/// Numbers are of 24 bits.
constexpr std::uint32_t number_of(std::uint32_t word) {
    return word >> 8;
}

static_assert(sizeof(StatusHeader) == 384 + 8 * kControlRing + 1024 &&
              offsetof(StatusHeader, answers) == 384);
static_assert(sizeof(FrameRecord) == 16);
static_assert(sizeof(ChainStatus) == 512 + 16 * kFrameRing + 64 &&
              offsetof(ChainStatus, frames) == 448);
static_assert(sizeof(PlannedLaunch) == 8 && sizeof(KernelName) == kNameBytes);
static_assert(sizeof(TaskStatus) == 128 && offsetof(TaskStatus, priority) == 96 &&
              sizeof(ControlPage) == 16 + 8 * kControlRing + kControlPathBytes);

}  // namespace urgengo::abi
