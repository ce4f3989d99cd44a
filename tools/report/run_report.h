// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo report` makes of one run or several: one page of HTML that needs no network, JSON,
// a table, or a summary for the terminal.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "tools/report/miss_window.h"
#include "tools/report/run_numbers.h"
#include "tools/trace/run_reader.h"

namespace urgengo::report {

/// A late frame, with what led to it.
struct MissStory {
    std::size_t frame = 0;  ///< its index in the story
    std::string name, words;
    std::vector<trace::StoryLine> lines;
    std::vector<trace::TimeOfChain> held_behind, meanwhile;
    MissWindow window;
};

/// One run, with all that is shown of it.
struct ReportedRun {
    std::string label;  ///< tells it from the others: its file's name
    trace::Run run;
    RunNumbers numbers;
    std::vector<MissStory> misses;  ///< those that were chosen
};

/// @param label        what the run is called
/// @param most_misses  that are told one by one
ReportedRun report_run(std::string label, trace::Run run, std::size_t most_misses);

/// Conditions of a run: what was recorded of its config and machine.
struct Conditions {
    std::vector<std::pair<std::string, std::string>> facts;  ///< name, value
    std::string config;  ///< JSON, indented; empty: not recorded
};
Conditions conditions_of(const trace::Run& run);

/// Format version 1: {"format_version", "runs": [{"label", "chains": [...], ...}]}. Times in ms.
/// @param whole  with latencies and what led to the misses
nlohmann::ordered_json to_json(const std::vector<ReportedRun>& runs, bool whole);
/// One line a chain and run, with a line of names before them.
std::string to_csv(const std::vector<ReportedRun>& runs);
std::string to_text(const std::vector<ReportedRun>& runs);
/// One file: style, charts and numbers are in it.
std::string to_html(const std::vector<ReportedRun>& runs);

}  // namespace urgengo::report
