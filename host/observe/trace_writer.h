// SPDX-License-Identifier: Apache-2.0
//
// Writes a trace (include/urgengo/abi/trace_record.h) into a mapped, sparse file: threads claim
// chunks and fill them in place, so nothing has to be flushed, and the file is complete whatever
// ends the program.
//
// Any thread may write, each through its own TraceCursor; no lock. A full trace loses the rest, and
// says how much in its header.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <string_view>

#include "host/base/clock.h"
#include "host/base/result.h"
#include "urgengo/abi/trace_record.h"

namespace urgengo::observe {

/// A thread's place in the trace.
struct TraceCursor {
    abi::TraceRecord* next = nullptr;
    abi::TraceRecord* end = nullptr;
    std::uint32_t thread = 0;  ///< gettid; 0 until the first record
};

class TraceWriter {
  public:
    /// Makes a new file, replacing any old one.
    /// @param max_bytes  of the file; it is sparse, so this is a limit and no cost
    /// @errors the file cannot be made or mapped
    static Result<TraceWriter*> create(const std::string& path, std::size_t max_bytes = 2ull << 30);

    /// @returns a record to fill in, or null if the trace is full. Its kind is to be set last, with
    ///          publish(); all else but `thread` and `task` (-1) is zero.
    abi::TraceRecord* add(TraceCursor& cursor, nanoseconds time);
    static void publish(abi::TraceRecord& record, abi::TraceKind kind) {
        __atomic_store_n(reinterpret_cast<std::uint8_t*>(&record.kind),
                         static_cast<std::uint8_t>(kind), __ATOMIC_RELEASE);
    }

    /// Writes a text, so that records can name it by its hash (fnv1a64).
    void add_text(TraceCursor& cursor, std::uint64_t hash, std::string_view text);

    abi::TraceHeader& header() { return *header_; }
    /// Cuts the file to what was used. No more records after this.
    void close();

  private:
    TraceWriter(int fd, void* memory, std::size_t bytes);

    bool allocate(std::uint64_t chunk);

    const int fd_;
    abi::TraceHeader* const header_;
    abi::TraceRecord* const records_;
    std::atomic<std::uint64_t> next_chunk_{0};
    std::atomic<bool> closed_{false};
};

/// @returns the calling thread's CPU time, low 32 bits of microseconds
std::uint32_t thread_cpu_us();

}  // namespace urgengo::observe
