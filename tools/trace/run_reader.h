// SPDX-License-Identifier: Apache-2.0
//
// Reads what happened in a run (include/urgengo/abi/run_record.h): a trace, a copy of a flight
// recorder, or what a killed program has left.
//
// Nothing in the file is believed: sizes, offsets and indices are held against the file's size, and
// what is kept of it is no larger than the file. A file that is cut short, or whose records make no
// sense, is read as far as it does, with a warning.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "urgengo/abi/run_record.h"

namespace urgengo::trace {

using abi::RunKind;
using abi::RunRecord;

struct RunChainNames {
    std::string name;
    std::int64_t period_ns = 0, deadline_ns = 0;
};
struct RunTaskNames {
    std::string name;
    std::size_t chain = 0;
};

struct Run {
    std::uint32_t process = 0;
    std::string program;
    std::string gpu;         ///< empty: not known
    std::string conditions;  ///< a JSON object, as it was written; empty: not told
    abi::RunKeeps keeps = abi::RunKeeps::kNewest;
    std::int64_t begin_ns = 0, begin_realtime_ns = 0;
    std::int64_t copied_ns = 0;  ///< 0: it is no copy
    std::vector<RunChainNames> chains;
    std::vector<RunTaskNames> tasks;
    std::map<std::uint32_t, std::string> threads;  ///< names, by id
    /// Of all threads, in the order of their times. Their indices are good, or -1; no end comes
    /// before its begin; the difference of two times, and of two durations, is one.
    std::vector<RunRecord> records;
    std::uint64_t overwritten = 0;  ///< records that newer ones have replaced
    std::uint64_t lost = 0;         ///< that found no room
    std::vector<std::string> warnings;

    std::int64_t first_ns() const { return records.empty() ? begin_ns : records.front().time_ns; }
    std::int64_t last_ns() const { return records.empty() ? begin_ns : records.back().time_ns; }
};

/// Is told how far something is, 0 to 1, now and then.
using ShowPart = std::function<void(double part)>;

/// @param show    may be null
/// @errors one line: file, what was found, what is accepted
Result<Run> read_run(const std::string& path, const ShowPart& show = nullptr);

/// The same for bytes that were read already; `file` is what errors and warnings call them.
Result<Run> parse_run(std::span<const char> bytes, const std::string& file);

/// Copies the file of a program that may go on writing it: what it may have overwritten meanwhile
/// is marked as such.
/// @param written_now  reads the 8 bytes at an offset of the file, as they are by then
/// @param[in,out] bytes  of the file, read before
void mark_overwritten(std::span<char> bytes,
                      const std::function<std::uint64_t(std::uint64_t offset)>& written_now);

}  // namespace urgengo::trace
