// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "host/base/atomic_file.h"
#include "tools/log/log.h"
#include "tools/report/run_report.h"
#include "tools/trace/run_reader.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/progress_bar.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

/// The rest of a file's time goes into its numbers and its late frames.
constexpr double kPartOfReading = 0.6;

/// @returns what to call the runs: names of their files, or whole paths where those are alike
std::vector<std::string> labels_of(const std::vector<std::string>& files) {
    std::vector<std::string> labels;
    for (const std::string& file : files) {
        const std::string stem = fs::path(file).stem().string();
        const auto alike = std::count_if(files.begin(), files.end(), [&](const std::string& other) {
            return fs::path(other).stem().string() == stem;
        });
        labels.push_back(alike > 1 ? file : stem);
    }
    return labels;
}

}  // namespace

CLI::App* add_report(CLI::App& app, ReportOptions& options) {
    CLI::App* command =
        app.add_subcommand("report", "Runs in numbers and as a page: misses, latency, causes");
    command->footer(
        "FILE is what `urgengo run --trace` or `urgengo ctl dump` has written; several are shown\n"
        "side by side. A summary is printed; -o writes a page that needs no network.");
    command->add_option("file", options.files, "Traces")->required();
    command->add_option("-o,--out", options.out, "Write the page (HTML) to this file");
    command->add_flag("--json", options.json, "Print JSON instead of the summary");
    command->add_flag("--csv", options.csv, "Print a table instead, one line a run and chain")
        ->excludes("--json");
    command
        ->add_option("--misses", options.most_misses,
                     "Late frames that the page tells one by one, of each run [40]")
        ->check(CLI::Range(0, 1000));
    command->add_flag("-q,--quiet", options.quiet,
                      "Print nothing but what --json or --csv ask for");
    return command;
}

int cmd_report(const ReportOptions& options) {
    const std::vector<std::string> labels = labels_of(options.files);
    std::vector<report::ReportedRun> runs;
    ProgressBar bar(!options.quiet);
    const auto num_files = static_cast<double>(options.files.size());
    for (std::size_t i = 0; i < options.files.size(); ++i) {
        const auto show = [&](double part) {
            bar.show((static_cast<double>(i) + part) / num_files, "traces, " + labels[i]);
        };
        auto run =
            trace::read_run(options.files[i], [&](double part) { show(kPartOfReading * part); });
        if (!run) return fail(kExitFailure, run.error());
        if (!options.json && !options.quiet)
            for (const std::string& warning : run->warnings) tools::log_warning("{}", warning);
        show(kPartOfReading);
        runs.push_back(report::report_run(labels[i], std::move(*run),
                                          options.out.empty() ? 0 : options.most_misses));
    }
    if (!options.out.empty())
        if (const auto written = write_file_atomically(options.out, report::to_html(runs));
            !written)
            return fail(kExitFailure, written.error());
    if (options.json)
        fmt::print(
            "{}\n",
            report::to_json(runs, false).dump(2, ' ', false, Json::error_handler_t::replace));
    else if (options.csv)
        fmt::print("{}", report::to_csv(runs));
    else if (!options.quiet)
        fmt::print("{}", report::to_text(runs));
    return 0;
}

}  // namespace urgengo::cli
