// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo bench calls` found: the time of every kind of call, bare and under UrgenGo, and the
// difference, which is UrgenGo's own. Pure.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/bench/smoke/bench_results.h"

namespace urgengo::cli {

/// One way in which the benchmark program is run. The first condition of a bench is the bare one.
/// What is written down of the run (host/observe/run_recorder.h).
enum class CallRecords {
    kFlight,  ///< the flight recorder, as without being asked
    kNone,
    kTrace,
};

struct CallCondition {
    std::string name;    ///< "bare", "no config", "40 chains", ...
    std::string filter;  ///< which cases, a regular expression
    int chains = 0;      ///< configured, and all but one with work on the GPU; 0: no config
    std::optional<int> mark_every_us{};  ///< 0: behind every launch; none: the default
    double kernel_us = 3;                ///< what a launch counts as
    CallRecords records = CallRecords::kFlight;
    bool nvtx = false;  ///< a tool is attached, which does nothing
};

/// One case's times in one run of the program.
struct CallTime {
    double ns = 0;            ///< of one call: the median over frames, or the mean if not in frames
    double driver_calls = 0;  ///< that one call makes, if the driver counts them
    double nvtx_calls = 0;    ///< of a tool that counts them, with the frame's begin and end
};

/// By the name of the case.
using CallTimes = std::map<std::string, CallTime>;

/// @param json  what the program wrote with --benchmark_out
/// @errors what is wrong with it
Result<CallTimes> parse_call_times(const std::string& json, const std::string& file);

/// @param stats   what UrgenGo wrote at the program's exit
/// @param chain   whose launches were timed
/// @returns why the launches were not what they pass for, scheduled with no task to wait for; empty
///          if they were
std::string why_not_scheduled(const std::string& stats, const std::string& chain);
/// @returns why not every launch was followed by a mark, which is a launch, too; empty if they were
std::string why_not_marked(const CallTimes& times);
/// @returns why the NVTX tool was not told of all launches' frames; empty if it was
std::string why_not_told(const CallTimes& times);

struct CallBench {
    std::vector<CallCondition> conditions;     ///< the first is bare
    std::vector<std::vector<CallTimes>> runs;  ///< shape [conditions][rounds]
    std::string driver_name;                   ///< behind the calls
    std::string cpu, version, commit, date_utc, command_line;

    /// Time with UrgenGo less the bare median.
    Spread own_ns(const std::string& call, std::size_t condition) const;
    Spread driver_ns(const std::string& call) const;
    double driver_calls(const std::string& call, std::size_t condition) const;
    double nvtx_calls(const std::string& call, std::size_t condition) const;
};

/// What a call may cost at most, own time. @returns 0 if there is no goal
/// @source the project's goals: pass-through 1 ns, a wrapped call without work 3 ns, a scheduled
///         launch with no task to wait for 200 ns
double call_goal_ns(const std::string& call);

std::string format_call_table(const CallBench& bench);
std::string to_json(const CallBench& bench);

}  // namespace urgengo::cli
