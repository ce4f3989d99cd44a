// SPDX-License-Identifier: Apache-2.0
//
// Reads a trace file (include/urgengo/abi/trace_record.h): checks it, and gives every thread's
// events in time order, with texts and thread names resolved.
//
// A file that is not a trace is an error. A trace that is not whole (the program was killed, the
// file was cut short, events did not fit) is read as far as it goes, with a warning.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "host/base/result.h"
#include "urgengo/abi/trace_record.h"

namespace urgengo::trace {

using abi::TraceKind;
using abi::TraceRecord;

/// The name a thread had from a moment on.
struct ThreadName {
    std::int64_t since_ns = 0;
    std::string name;
};

struct ThreadTrace {
    std::uint32_t id = 0;
    std::vector<ThreadName> names;           ///< in time order; may be empty
    std::vector<const TraceRecord*> events;  ///< in time order, without kText and kThread

    /// @returns the name at this moment; before the first that was read: the first; "" if none was
    std::string_view name_at(std::int64_t time_ns) const;
};

class Trace {
  public:
    Trace() = default;
    Trace(Trace&&) = default;
    Trace& operator=(Trace&&) = default;
    Trace(const Trace&) = delete;  // events point into records_
    Trace& operator=(const Trace&) = delete;

    const abi::TraceHeader& header() const { return header_; }
    /// In the order of their first events.
    const std::vector<ThreadTrace>& threads() const { return threads_; }
    /// @returns a kernel's or range's name; "" if it is not in the trace
    std::string_view text(std::uint64_t hash) const;
    /// What is not whole, one line each.
    const std::vector<std::string>& warnings() const { return warnings_; }

    /// CUPTI's records (TraceTimes::kCupti), in no order.
    const std::vector<const TraceRecord*>& kernel_times() const { return kernel_times_; }
    const std::vector<const TraceRecord*>& clock_pairs() const { return clock_pairs_; }

    /// @returns the GPU's name
    std::string gpu() const;
    /// @returns "13.0"; "" if the driver's version is not known
    std::string driver() const;

  private:
    friend class TraceParser;

    abi::TraceHeader header_{};
    std::vector<TraceRecord> records_;
    std::vector<ThreadTrace> threads_;
    std::vector<const TraceRecord*> kernel_times_;
    std::vector<const TraceRecord*> clock_pairs_;
    std::unordered_map<std::uint64_t, std::string> texts_;
    std::vector<std::string> warnings_;
};

/// @errors one line: file, what was found, what is accepted
Result<Trace> read_trace(const std::string& path);

/// The same for bytes that were read already; `file` is what errors and warnings call them.
Result<Trace> parse_trace(std::string_view bytes, const std::string& file);

/// @returns the name of what was launched: the kernel's, "(graph)", or one made of its hash if the
///          trace lacks its text
std::string launch_name(const Trace& trace, const TraceRecord& launch);

}  // namespace urgengo::trace
