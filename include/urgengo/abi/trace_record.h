// SPDX-License-Identifier: Apache-2.0
//
// A trace: what a program did on the GPU, one 64-byte record an event. Written by the interposer
// (host/observe/trace_writer), read by tools (tools/trace).
//
// The file is a TraceHeader, then chunks of kTraceChunkRecords records. A chunk belongs to one
// thread, which fills it from its begin; within a thread records are in time order, chunks of
// different threads are not. The file is mapped while the program runs, so it is complete whatever
// ends the program; the rest of a chunk, and of a file whose program was killed, is kNone records.
//
// Times are nanoseconds: `*_ns` on CLOCK_MONOTONIC, `gpu_*_ns` on the GPU's %globaltimer, low 48
// bits (compare those with each other only), CUPTI's on its own clock, which kClockPair records
// relate to CLOCK_MONOTONIC.
#pragma once

#include <cstdint>

namespace urgengo::abi {

inline constexpr std::uint64_t kTraceMagic = 0x45434152'54475555;  // "UUGTRACE"
inline constexpr std::uint32_t kTraceVersion = 1;
inline constexpr std::uint32_t kTraceChunkRecords = 512;

/// How kernels were timed.
enum class TraceTimes : std::uint32_t {
    kMarks = 0,  ///< by marks around launches, or not at all
    kCupti,      ///< by CUPTI: kKernelTime and kClockPair records, TraceLaunch::correlations
    kRefused,    ///< they were to be, by CUPTI, and `note` says why it could not be
};

struct TraceHeader {
    std::uint64_t magic;
    std::uint32_t version;
    std::uint32_t record_bytes;  ///< sizeof(TraceRecord)
    std::uint32_t chunk_records;
    std::uint32_t process;         ///< id
    std::int64_t begin_ns;         ///< when the trace began
    std::uint64_t chunks;          ///< handed out; more than fit: the rest was lost
    std::uint64_t max_chunks;      ///< that fit
    std::uint32_t mark_ns;         ///< GPU time that a mark adds between two kernels
    std::uint32_t num_sms;         ///< of the GPU; 0 until the first launch
    char gpu[64];                  ///< its name, zero-terminated
    std::uint32_t driver_version;  ///< as cuDriverGetVersion: 13000
    std::uint32_t sm_clock_mhz;    ///< as CU_DEVICE_ATTRIBUTE_CLOCK_RATE: the peak
    std::uint32_t memory_clock_mhz;
    TraceTimes kernel_times;        ///< where the launches' GPU times are from
    std::uint32_t dropped_kernels;  ///< records that CUPTI lost
    char note[96];                  ///< why kernel_times are not what was asked for; or empty
    std::uint32_t pause_ns;         ///< of the GPU's in a kernel's time by marks; 0: not measured
    std::uint32_t reserved[4];      // to 256 bytes
};

enum class TraceKind : std::uint8_t {
    kNone = 0,       ///< not written
    kText,           ///< 40 bytes of a text: of a kernel's or NVTX range's name, by its hash
    kThread,         ///< the thread's name was read, and it is new or has changed
    kLaunch,         ///< a kernel or graph was launched
    kWait,           ///< a call waited for the GPU
    kArrival,        ///< hint: a frame of `chain` arrived
    kTaskBegin,      ///< hint
    kTaskEnd,        ///< hint
    kRangePush,      ///< NVTX range, on this thread
    kRangePop,       ///< NVTX
    kInstanceBegin,  ///< what the runtime takes for the begin of an instance of `task`
    kInstanceEnd,    ///< and for its end
    kKernelTime,     ///< CUPTI: a kernel was on the GPU. Of no thread, and in no order
    kClockPair,      ///< CUPTI: its clock, when ours was time_ns. The same
};

/// What a call waited for. Profiles name it (host/observe/wait_name.h).
enum class TraceWait : std::uint8_t {
    kStream,       ///< cuStreamSynchronize
    kContext,      ///< cuCtxSynchronize
    kEvent,        ///< cuEventSynchronize
    kCopy,         ///< a synchronous copy
    kStreamQuery,  ///< cuStreamQuery that found the stream idle
    kEventQuery,   ///< cuEventQuery that found the event complete
};

/// Record flags.
inline constexpr std::uint8_t kTraceGraph = 1;   ///< kLaunch: of a graph
inline constexpr std::uint8_t kTraceCovers = 2;  ///< kWait: for all that the thread launched
inline constexpr std::uint8_t kTraceResync = 4;  ///< kInstanceEnd: by a count that did not fit
inline constexpr std::uint8_t kTraceHinted = 8;  ///< kInstanceBegin, kInstanceEnd
inline constexpr std::uint8_t kTraceObserved =
    16;  ///< kInstanceBegin: confidence too low to schedule

inline constexpr std::uint8_t kTraceCorrelated = 32;  ///< kLaunch: has `correlations`, no GPU times
inline constexpr std::uint8_t kTraceLoose =
    64;  ///< kLaunch: its begin mark may have executed before the kernel came to the GPU

struct TraceLaunch {
    std::uint64_t name_hash;  ///< of its kText; 0 for a graph
    std::uint64_t stream;     ///< tells streams apart: the handle, or 1 legacy, 2 + thread << 8 own
    std::uint32_t grid_blocks;  ///< saturated
    std::uint16_t block_threads;
    std::uint16_t utilization;  ///< share of the GPU, in 1/65535
    union {
        std::uint64_t gpu_begin_ns;  ///< 0: as the end of the launch before it on this stream
        /// kTraceCorrelated: CUPTI's ids of the calls that launched it, either of which its kernels
        /// carry: of the driver's API, of the runtime's around it. 0: none.
        struct {
            std::uint32_t driver, runtime;
        } correlations;
    };
    std::uint64_t gpu_end_ns;  ///< 0: not known (not marked, or the program ended first)
};

struct TraceKernelTime {
    std::uint64_t begin;  ///< on CUPTI's clock, nanoseconds
    std::uint64_t end;
    std::uint32_t correlation;  ///< of the call that launched it
    std::uint32_t stream;       ///< CUPTI's id
    std::uint32_t context;      ///< CUPTI's id
    std::uint32_t grid_blocks;  ///< saturated
    std::uint32_t block_threads;
    std::uint32_t reserved;
};

struct TraceWaitCall {
    std::int64_t end_ns;
    std::uint64_t stream;    ///< as in TraceLaunch; 0: no one stream
    std::uint32_t launches;  ///< of the thread since its last kWait
    TraceWait function;
    std::uint8_t reserved[19];
};

struct TraceText {
    std::uint64_t hash;
    std::uint16_t offset;  ///< of these bytes in the text
    std::uint16_t length;  ///< of the whole text; what is past 4 KiB is cut off
    char bytes[28];
};

struct TraceRecord {
    TraceKind kind;
    std::uint8_t flags;
    std::int16_t task;     ///< index over the config's tasks, in order; -1: of no chain. kArrival:
                           ///< index of the chain
    std::uint32_t thread;  ///< id (gettid)
    std::int64_t time_ns;  ///< when the call came in
    std::uint32_t cpu_us;  ///< the thread's CPU time, low 32 bits: kThread, kWait (at its end), the
                           ///< first launch after one, kTask*; else 0
    std::uint32_t instance;  ///< counts the task's instances; kArrival, kTask*: the hint's token
    union {
        TraceLaunch launch;       ///< kLaunch
        TraceWaitCall wait;       ///< kWait
        TraceKernelTime kernel;   ///< kKernelTime
        std::uint64_t cupti_ns;   ///< kClockPair
        TraceText text;           ///< kText
        char name[16];            ///< kThread, zero-terminated
        std::uint64_t hash;       ///< kRangePush: of its kText
        std::int64_t arrival_ns;  ///< kArrival, kInstanceBegin
    };
};

static_assert(sizeof(TraceHeader) == 256 && sizeof(TraceRecord) == 64);

}  // namespace urgengo::abi
