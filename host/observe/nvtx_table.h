// SPDX-License-Identifier: Apache-2.0
//
// All that we say in NVTX to another tool (nvtx_out.h): one table of each kind, which
// docs/nvtx.md lists.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace urgengo::observe::nvtx {

inline constexpr const char* kDomain = "urgengo";

enum class Category : std::uint32_t { kLaunch = 1, kHold, kChain, kDispatch };
inline constexpr std::array kCategories = {"launch", "hold", "chain", "dispatch"};  // from 1 on

/// Texts that stay the same; registered, besides the names of chains and tasks, and the words of
/// causes (miss_cause.h).
enum class Word : std::uint8_t {
    // Ranges and marks:
    kHold,
    kPaced,
    kMiss,
    kEarlyExit,
    kDropped,
    kPriority,
    kMode,
    kTrip,
    kGateClosed,
    kGatesOpen,
    kRound,
    kPark,
    // Outcomes:
    kInTime,
    kLate,
    kExited,
    kUnderWay,
    // Modes:
    kOff,
    kObserve,
    kEnforce,
    kShadow,
    // Why a launch waits, in the order of abi::Why, without kNone:
    kRank,
    kRunAhead,
    kTurnToLaunch,
    kDrain,
    kThreshold,
    kBucket,
    kGroup,
    kExclusive,
};
inline constexpr std::array kWords = {
    "hold",      "paced",          "miss",       "early exit", "dropped", "priority", "mode",
    "trip",      "gate closed",    "gates open", "round",      "park",    "in time",  "late",
    "exited",    "under way",      "off",        "observe",    "enforce", "shadow",   "rank",
    "run-ahead", "turn to launch", "drain",      "threshold",  "bucket",  "group",    "exclusive"};
inline constexpr std::size_t kNumWords = kWords.size();
static_assert(kNumWords == static_cast<std::size_t>(Word::kExclusive) + 1);

/// Every entry takes eight bytes.
enum class Kind : std::uint8_t {
    kText,     ///< a registered string
    kNumber,   ///< signed
    kMessage,  ///< a registered string that names the event
    kBegin,    ///< time of the GPU's clock, ns
    kEnd,
};
struct Entry {
    const char* name;
    Kind kind = Kind::kNumber;
};

enum class Schema : std::uint8_t { kInstance, kHold, kPriority, kMode, kGates, kGpu };
inline constexpr std::size_t kNumSchemas = 6;
inline constexpr std::size_t kMostEntries = 9;

inline constexpr Entry kInstanceEntries[] = {
    {"chain", Kind::kText},   {"task", Kind::kText},   {"instance"},
    {"deadline_ns"},          {"laxity_begin_ns"},     {"laxity_end_ns"},
    {"outcome", Kind::kText}, {"reason", Kind::kText}, {"behind", Kind::kText}};
inline constexpr Entry kHoldEntries[] = {
    {"chain", Kind::kText}, {"task", Kind::kText}, {"behind", Kind::kText},
    {"why", Kind::kText},   {"held_ns"},           {"paced_ns"},
    {"laxity_begin_ns"},    {"laxity_end_ns"}};
inline constexpr Entry kPriorityEntries[] = {
    {"chain", Kind::kText}, {"task", Kind::kText}, {"priority"}, {"before"}};
inline constexpr Entry kModeEntries[] = {{"mode", Kind::kText}};
inline constexpr Entry kGatesEntries[] = {{"task", Kind::kText}, {"closed"}, {"opened"}};
inline constexpr Entry kGpuEntries[] = {{"task", Kind::kMessage},
                                        {"begin_ns", Kind::kBegin},
                                        {"end_ns", Kind::kEnd},
                                        {"chain", Kind::kText},
                                        {"instance"},
                                        {"first_launch"},
                                        {"end_launch"}};

struct SchemaInfo {
    const char* name;
    std::span<const Entry> entries;
};
inline constexpr std::array<SchemaInfo, kNumSchemas> kSchemas = {{
    {"urgengo.instance", kInstanceEntries},
    {"urgengo.hold", kHoldEntries},
    {"urgengo.priority", kPriorityEntries},
    {"urgengo.mode", kModeEntries},
    {"urgengo.gates", kGatesEntries},
    {"urgengo.gpu", kGpuEntries},
}};

/// One of each for every chain; the chain's name comes first: "lidar laxity".
enum class Counter : std::uint8_t { kLaxity, kExecuting, kPriority, kHeld };
struct CounterInfo {
    const char* name;
    const char* unit;
    const char* description;
};
inline constexpr std::size_t kNumCounters = 4;
inline constexpr std::array<CounterInfo, kNumCounters> kCounters = {{
    {"laxity", "ns", "time to the deadline, less all that the instance still needs"},
    {"executing", "launch", "index of the launch that the GPU is at, in the task's instance"},
    {"priority", "priority", "stream priority of the last launch; the smallest is the greatest"},
    {"held", "ns", "for how long launches of the task's instance were held"},
}};

inline constexpr const char* kTimeScope = "urgengo/gpu";
inline constexpr const char* kThreadName = "urgengo";

}  // namespace urgengo::observe::nvtx
