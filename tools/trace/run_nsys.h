// SPDX-License-Identifier: Apache-2.0
//
// A run, written through NVTXW (nvtxw.h) to a library of Nsight Systems, or another one: what
// docs/nvtx.md lists. A stream for each chain, and one for what is of none, in one domain; times
// are those of CLOCK_MONOTONIC.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "host/base/result.h"
#include "host/observe/nvtx_table.h"
#include "tools/trace/run_story.h"

namespace urgengo::trace {

namespace nvtxw {
struct Interface;

/// Every entry takes eight bytes.
enum class Kind : std::uint8_t {
    kBegin,     ///< time, ns
    kEnd,       ///< time, ns
    kAt,        ///< time of a mark, ns
    kMessage,   ///< a registered string that names the event
    kCategory,  ///< as in docs/nvtx.md; 32 bits of the eight
    kText,      ///< a registered string
    kNumber,    ///< signed
};
struct Entry {
    const char* name;
    Kind kind = Kind::kNumber;
};
inline constexpr Entry kFrameEntries[] = {{"begin_ns", Kind::kBegin},
                                          {"end_ns", Kind::kEnd},
                                          {"message", Kind::kMessage},
                                          {"category", Kind::kCategory},
                                          {"chain", Kind::kText},
                                          {"frame"},
                                          {"deadline_ns"},
                                          {"outcome", Kind::kText},
                                          {"reason", Kind::kText},
                                          {"behind", Kind::kText}};
inline constexpr Entry kTaskEntries[] = {{"begin_ns", Kind::kBegin},
                                         {"end_ns", Kind::kEnd},
                                         {"message", Kind::kMessage},
                                         {"category", Kind::kCategory},
                                         {"chain", Kind::kText},
                                         {"task", Kind::kText},
                                         {"frame"}};
inline constexpr Entry kWrittenHoldEntries[] = {{"begin_ns", Kind::kBegin},
                                                {"end_ns", Kind::kEnd},
                                                {"message", Kind::kMessage},
                                                {"category", Kind::kCategory},
                                                {"chain", Kind::kText},
                                                {"task", Kind::kText},
                                                {"frame"},
                                                {"behind", Kind::kText},
                                                {"why", Kind::kText}};
inline constexpr Entry kLaunchesEntries[] = {{"begin_ns", Kind::kBegin},
                                             {"end_ns", Kind::kEnd},
                                             {"message", Kind::kMessage},
                                             {"category", Kind::kCategory},
                                             {"chain", Kind::kText},
                                             {"task", Kind::kText},
                                             {"frame"},
                                             {"stream"},
                                             {"first_launch"},
                                             {"end_launch"}};
inline constexpr Entry kMissEntries[] = {{"at_ns", Kind::kAt},
                                         {"message", Kind::kMessage},
                                         {"category", Kind::kCategory},
                                         {"chain", Kind::kText},
                                         {"frame"},
                                         {"reason", Kind::kText},
                                         {"behind", Kind::kText}};
inline constexpr Entry kWrittenModeEntries[] = {{"at_ns", Kind::kAt},
                                                {"message", Kind::kMessage},
                                                {"category", Kind::kCategory},
                                                {"mode", Kind::kText}};

enum class Schema : std::uint8_t { kFrame, kTask, kHold, kLaunches, kMiss, kMode };
struct SchemaInfo {
    const char* name;
    std::span<const Entry> entries;
};
inline constexpr std::array<SchemaInfo, 6> kSchemas = {{
    {"urgengo.written.frame", kFrameEntries},
    {"urgengo.written.task", kTaskEntries},
    {"urgengo.written.hold", kWrittenHoldEntries},
    {"urgengo.written.launches", kLaunchesEntries},
    {"urgengo.written.miss", kMissEntries},
    {"urgengo.written.mode", kWrittenModeEntries},
}};
}  // namespace nvtxw

/// @param name  of the session: what the backend makes of it is its own
/// @returns how many events were written
/// @errors one line: which function refused, and how. The session is left without its end, so that
///         no half of a run is taken for a whole one
Result<std::size_t> write_nsys(const Run& run, const RunStory& story,
                               const nvtxw::Interface& backend, const std::string& name);

}  // namespace urgengo::trace
