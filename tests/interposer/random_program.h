// SPDX-License-Identifier: Apache-2.0
//
// Random programs of stream operations whose final memory is determined: a seed makes the same
// program on every machine. Knows no CUDA.
//
// 1 Operations stand in one sequence. Each is issued by one of the program's threads, in the order
//   of the sequence; between threads only what `after` says is ordered: an operation waits until
//   those are issued. As these are earlier in the sequence, threads cannot wait in a circle.
// 2 Words of memory are read and written by operations on streams. No two accesses race: before an
//   operation is added, the accesses that it conflicts with are known to be over, or the program
//   gets what orders them: an event, a value in memory, or a thread that waits. What is known is
//   kept as clocks: for each stream, how many of its operations are over.
// 3 Known is only what CUDA promises: order on a stream, event and value waits, synchronisation,
//   and between the legacy and the blocking streams the order of issue, for kernels and copies; but
//   not for copies from the host's memory: a small one on an idle stream does not wait for the
//   legacy stream (measured, H200, driver 580.159.04, bare), though CUDA's text knows no exception.
// 4 A stream may also wait for a value that is written later in the sequence (forward): nothing
//   waits for such a stream, thread or stream, until the write has been added.
// 5 Every call succeeds but kRefused. So no thread waits for the context while another captures:
//   that fails, ends without having waited and breaks the capture, in whatever mode it is.
#pragma once

#include <array>
#include <cstdint>
#include <random>
#include <string>
#include <utility>
#include <vector>

namespace twin {

inline constexpr int kNumWords = 12;     ///< of two 64-bit halves each
inline constexpr int kNumHostWords = 6;  ///< the first ones: in host memory that the GPU sees
inline constexpr int kMaxThreads = 3;
inline constexpr int kLegacyStream = 0;
inline constexpr int kFirstNonBlockingStream = 3;  ///< before them: the legacy and the blocking
inline constexpr int kFirstPerThreadStream = 6;    ///< of thread 0; then those of the others
inline constexpr int kNumStreams = kFirstPerThreadStream + kMaxThreads;

/// What an operation does; `word`, `from`, `value` and `variant` say to what, and by which entry.
enum class Kind {
    kMix,    ///< kernel: word = 31 * word + value
    kStore,  ///< kernel: word = value
    kTiny,   ///< kernel of 10 us
    kWide,   ///< kernel of 300 us or 5 ms on all of the GPU: work piles up behind it
    kCopy,   ///< from -> word
    kMemset,
    kWriteValue,  ///< word = value, by a stream memory operation
    kHostMix,     ///< host function: as kMix
    kPool,        ///< memory of a pool: from -> pool, mixed, -> word, freed
    kGraph,       ///< a captured graph that mixes `word`, copies it to `from`, mixes that
    kReadBack,    ///< synchronous copy of `word` into the program's memory
    kRecord,      ///< of event `value`
    kWaitEvent,   ///< for event `value`
    kWriteFlag,   ///< flag `value` = 1
    kWaitFlag,    ///< until flag `value` is 1
    kStreamSync,
    kEventSync,  ///< with event `value`
    kPoll,       ///< stream queries until it is idle
    kContextSync,
    kAllocFree,   ///< which synchronises too
    kRegister,    ///< of memory of the host's, and back: likewise
    kLoadUnload,  ///< of a module: likewise
    kQuery,       ///< without a wait
    kRefused,     ///< a launch that is an error
};

struct Operation {
    Kind kind;
    int thread;
    int stream;
    int word = -1;
    int from = -1;
    std::uint64_t value = 0;
    unsigned variant = 0;
    std::vector<int> after{};      ///< operations of other threads that must have been issued
    std::vector<int> waits_for{};  ///< host functions that must have run when the call returns
};

struct Program {
    int num_threads = 1;
    std::array<std::string, kMaxThreads> thread_names;
    std::vector<Operation> operations;
    int num_events = 0;
    int num_flags = 0;
    /// Host functions of which the first must run before the second.
    std::vector<std::pair<int, int>> in_order;
};

/// @param forward_waits  whether streams may wait for what is written later; a real GPU with few
///                       connections could not run that
Program make_program(std::uint64_t seed, bool forward_waits);

/// @returns the kind's name
const char* name_of(Kind kind);

/// @returns one line that says what the operation is
std::string to_text(const Operation& operation);

}  // namespace twin
