// SPDX-License-Identifier: Apache-2.0
//
// What a run found: per-instance records, their summary, and its two forms, a table and JSON. Pure.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace urgengo::chains {

enum class Outcome {
    kNotRun,  ///< the run was interrupted first; not counted
    kOnTime,
    kLate,
    kExited,   ///< UrgenGo said that the deadline can no longer be met
    kDropped,  ///< overtaken by a newer frame while it waited
};

/// What happened to a frame, and when. All times are since the run's start.
struct InstanceRecord {
    std::chrono::nanoseconds arrival{0};
    std::chrono::nanoseconds end{0};  ///< of the last task; of kOnTime and kLate
    Outcome outcome = Outcome::kNotRun;
    int thread = 0;                     ///< id of the one that made the first launch; 0: none made
    std::chrono::nanoseconds begin{0};  ///< the first launch's call
    std::chrono::nanoseconds first_launched{0};  ///< its return

    bool completed() const { return outcome == Outcome::kOnTime || outcome == Outcome::kLate; }
    /// Of a completed one.
    std::chrono::nanoseconds latency() const { return end - arrival; }
};

struct LatencySummary {
    double mean_ms = 0, p50_ms = 0, p95_ms = 0, p99_ms = 0, max_ms = 0;
};

struct ChainReport {
    std::string name;
    double period_ms = 0;    ///< as run
    double deadline_ms = 0;  ///< as run; infinite without deadlines
    bool tight = false;
    int instances = 0;
    int missed = 0;  ///< late, exited or dropped
    int exited = 0;
    int dropped = 0;
    std::optional<LatencySummary> latency;  ///< over completed instances; none if there are none
    std::vector<InstanceRecord> records;

    double miss_ratio() const { return instances == 0 ? 0 : double(missed) / instances; }
};

/// Counts the records and keeps them; name, period, deadline and tight stay as they are.
void summarize(ChainReport& report, std::vector<InstanceRecord> records);

/// The smallest value that at least `fraction` of all values do not exceed (nearest rank).
/// @param sorted  ascending, not empty
double percentile(const std::vector<double>& sorted, double fraction);

/// How long one driver call of the disturber's took.
struct CallReport {
    std::string name;
    std::size_t count = 0;
    double p50_us = 0, p99_us = 0, max_us = 0;
};

struct RunReport {
    std::vector<std::pair<std::string, std::string>> parameters;  ///< as the user would give them
    std::string gpu;
    int num_sms = 0;
    std::string cuda_driver_version;
    std::string kernel_driver_version;  ///< empty: not readable
    std::string version, commit;
    std::string date_utc;
    std::string command_line;
    std::string cpu_segments;  ///< spin | sleep
    std::string urgengo;       ///< not loaded | scheduling | observing | off
    std::string results;       ///< ok | BAD | not checked
    std::string results_detail;
    std::uint64_t checksum = 0;
    bool interrupted = false;
    std::chrono::nanoseconds start{0};         ///< on CLOCK_MONOTONIC
    std::chrono::nanoseconds arrivals_for{0};  ///< frames arrive for so long
    double wall_s = 0;
    double cpu_cores = 0;  ///< mean, of the whole process
    std::vector<ChainReport> chains;
    std::vector<CallReport> disturber;  ///< empty: there was none

    /// The mean of the chains' miss ratios, over chains that had an instance.
    double overall_miss_ratio() const;
    /// Instances that were completed while frames arrived: not the queue that is worked off after.
    int finished_in_time() const;
    /// The same a second. 0 if frames arrived for no time.
    double instances_per_s() const;
};

/// @returns the table and the lines below it
std::string format_table(const RunReport& report);

/// @returns the last line of the table alone: the overall deadline miss ratio
std::string format_overall(const RunReport& report);

std::string format_json(const RunReport& report, bool with_instances);

}  // namespace urgengo::chains
