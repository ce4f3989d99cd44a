// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_trace.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "host/base/atomic_file.h"
#include "tools/trace/nvtxw_backend.h"
#include "tools/trace/run_export.h"
#include "tools/trace/run_json.h"
#include "tools/trace/run_nsys.h"
#include "tools/trace/run_reader.h"
#include "tools/trace/run_story.h"
#include "tools/trace/run_summary.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/progress_bar.h"
#include "tools/urgengo/text_table.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;
using trace::to_ms;

constexpr std::size_t kMostLate = 10;

void print(const Json& root) {
    fmt::print("{}\n", root.dump(2, ' ', false, Json::error_handler_t::replace));
}

double span_s(const trace::Run& run) {
    return 1e-9 * static_cast<double>(run.last_ns() - run.first_ns());
}

// --- info

Json frame_json(const trace::Run& run, const trace::RunFrame& frame) {
    Json told = {{"chain", run.chains[frame.chain].name},
                 {"frame", frame.number},
                 {"arrival_ns", frame.arrival_ns},
                 {"ended", frame.has_ended}};
    if (!frame.has_ended) return told;
    told["latency_ms"] = to_ms(frame.latency_ns);
    told["late"] = frame.is_late();
    told["exited"] = frame.exited;
    if (!frame.is_late()) return told;
    told["late_ms"] = to_ms(frame.latency_ns - run.chains[frame.chain].deadline_ns);
    told["cause"] = observe::to_word(frame.cause);
    told["behind"] = trace::chain_name(run, frame.behind);
    told["cause_ms"] = to_ms(frame.amount_ns);
    trace::add_detail(told, frame.cause, frame.cause_detail);
    return told;
}

int info_json(const trace::Run& run, const trace::RunStory& story) {
    Json root = {{"format_version", 1},
                 {"pid", run.process},
                 {"program", run.program},
                 {"seconds", span_s(run)},
                 {"from", trace::date_of(run, run.first_ns())},
                 {"records", run.records.size()},
                 {"overwritten", run.overwritten},
                 {"lost", run.lost},
                 {"threads", run.threads.size()},
                 {"warnings", run.warnings}};
    root["chains"] = Json::array();
    for (const trace::ChainSummary& chain : trace::summarize(run, story)) {
        Json told = {{"name", chain.name},
                     {"deadline_ms", to_ms(chain.deadline_ns)},
                     {"frames", chain.frames},
                     {"ended", chain.ended},
                     {"late", chain.late},
                     {"exited", chain.exited},
                     {"dropped", chain.dropped},
                     {"median_ms", to_ms(chain.median_ns)},
                     {"p99_ms", to_ms(chain.p99_ns)},
                     {"max_ms", to_ms(chain.max_ns)},
                     {"holds", chain.holds},
                     {"held_ms", to_ms(chain.held_ns)},
                     {"paced_ms", to_ms(chain.paced_ns)}};
        told["causes"] = Json::array();
        for (const observe::CauseCount& cause : chain.causes)
            told["causes"].push_back({{"cause", observe::to_word(cause.cause)},
                                      {"behind", cause.behind},
                                      {"frames", cause.count}});
        root["chains"].push_back(told);
    }
    const trace::GateSummary gates = trace::summarize_gates(story);
    root["gates"] = {{"host_rounds", gates.host_rounds},
                     {"opened_by_host", gates.opened_by_host},
                     {"opened_by_gpu", gates.openings_by_gpu},
                     {"gpu_rounds", gates.gpu_rounds},
                     {"gpu_rounds_ms", to_ms(gates.gpu_rounds_ns)},
                     {"parks", gates.parks},
                     {"parked_ms", to_ms(gates.parked_ns)},
                     {"most_parked_ms", to_ms(gates.most_parked_ns)},
                     {"most_opening_ms", to_ms(gates.most_opening_ns)},
                     {"refused", gates.refused}};
    root["late"] = Json::array();
    for (const std::size_t index : trace::late_frames(story))
        root["late"].push_back(frame_json(run, story.frames[index]));
    print(root);
    return 0;
}

int info(const trace::Run& run, const trace::RunStory& story) {
    fmt::print(
        "{} (pid {}), {:.1f} s from {}: {} records of {} threads{}{}\n\n", run.program, run.process,
        span_s(run), trace::date_of(run, run.first_ns()), run.records.size(), run.threads.size(),
        run.overwritten > 0 ? fmt::format(", {} older ones overwritten", run.overwritten) : "",
        run.lost > 0 ? fmt::format(", {} lost", run.lost) : "");
    TextTable table;
    table.add_row({"chain", "deadline", "frames", "late", "dropped", "median", "p99", "max",
                   "held ms", "paced ms", "late most often"});
    const auto ms = [](std::int64_t ns) { return fmt::format("{:.1f}", to_ms(ns)); };
    for (const trace::ChainSummary& chain : trace::summarize(run, story)) {
        table.add_row({chain.name, ms(chain.deadline_ns), std::to_string(chain.frames),
                       std::to_string(chain.late), std::to_string(chain.dropped),
                       ms(chain.median_ns), ms(chain.p99_ns), ms(chain.max_ns), ms(chain.held_ns),
                       ms(chain.paced_ns), trace::most_often(chain)});
    }
    fmt::print("{}", table.text());
    const std::string gates = trace::gates_words(trace::summarize_gates(story));
    if (!gates.empty()) fmt::print("\ngates: {}\n", gates);
    const std::vector<std::size_t> late = trace::late_frames(story);
    if (late.empty()) return 0;
    const std::size_t first = late.size() - std::min(late.size(), kMostLate);
    fmt::print("\nlate frames{}:\n",
               first > 0 ? fmt::format(", the last {} of {}", kMostLate, late.size()) : "");
    for (std::size_t i = first; i < late.size(); ++i) {
        const trace::RunFrame& frame = story.frames[late[i]];
        fmt::print("  {}  {}\n", trace::frame_name(run, frame), trace::outcome_words(run, frame));
    }
    return 0;
}

// --- why

/// @returns the frame's index, or what is wrong
Result<std::size_t> choose_frame(const trace::Run& run, const trace::RunStory& story,
                                 const TraceOptions& options) {
    std::string names;
    std::size_t chain = run.chains.size();
    for (std::size_t i = 0; i < run.chains.size(); ++i) {
        names += (i ? ", " : "") + run.chains[i].name;
        if (run.chains[i].name == options.chain) chain = i;
    }
    if (!options.chain.empty() && chain == run.chains.size())
        return Error{fmt::format("--chain: found '{}', accepted: {}", options.chain, names)};
    if (options.frame != 0) {
        if (options.chain.empty())
            return Error{"--frame: found no chain, accepted: --chain, one of " + names};
        const std::size_t found = story.find(chain, options.frame);
        if (found != trace::kNoFrame) return found;
        std::uint32_t first = 0, last = 0;
        for (const trace::RunFrame& frame : story.frames) {
            if (frame.chain != chain || frame.number == 0) continue;
            if (first == 0) first = frame.number;
            last = std::max(last, frame.number);
        }
        return Error{fmt::format("--frame: found {}, accepted: {} to {} of {}, as recorded",
                                 options.frame, first, last, options.chain)};
    }
    const std::vector<std::size_t> late = trace::late_frames(story);
    for (std::size_t i = late.size(); i-- > 0;)
        if (options.chain.empty() || story.frames[late[i]].chain == chain) return late[i];
    return Error{"no frame was late" +
                 (options.chain.empty() ? std::string() : " of " + options.chain) +
                 "; accepted: --chain and --frame of any"};
}

void print_times(const trace::Run& run, const char* what,
                 const std::vector<trace::TimeOfChain>& times) {
    std::string words;
    for (const trace::TimeOfChain& each : times)
        words += fmt::format("{}{} {:.3f} ms", words.empty() ? "" : ", ",
                             run.chains[each.chain].name, to_ms(each.time_ns));
    if (!words.empty()) fmt::print("{}: {}\n", what, words);
}

int why(const trace::Run& run, const trace::RunStory& story, const TraceOptions& options) {
    const auto index = choose_frame(run, story, options);
    if (!index) return fail(kExitUsage, "trace why: " + index.error());
    const trace::RunFrame& frame = story.frames[*index];
    const std::vector<trace::StoryLine> lines = trace::frame_story(run, story, *index);
    const std::vector<trace::TimeOfChain> held = trace::held_behind(story, *index);
    const std::vector<trace::TimeOfChain> others = trace::meanwhile(story, *index);
    if (options.json) {
        Json root = frame_json(run, frame);
        root["format_version"] = 1;
        root["words"] = trace::outcome_words(run, frame);
        root["story"] = trace::story_json(lines);
        root["held_behind"] = trace::times_json(run, held);
        root["meanwhile"] = trace::times_json(run, others);
        print(root);
        return 0;
    }
    fmt::print("{}: {}\n", trace::frame_name(run, frame), trace::outcome_words(run, frame));
    if (frame.has_ended)
        fmt::print("latency {:.3f} ms, deadline {:.3f} ms\n", to_ms(frame.latency_ns),
                   to_ms(run.chains[frame.chain].deadline_ns));
    fmt::print("\n{:>12} {:>12}  ms after its arrival\n", "from", "to");
    for (const trace::StoryLine& line : lines)
        fmt::print("{:>12.3f} {:>12}  {:{}}{}\n", to_ms(line.begin_ns),
                   line.end_ns > line.begin_ns ? fmt::format("{:.3f}", to_ms(line.end_ns)) : "", "",
                   2 * line.depth, line.what);
    fmt::print("\n");
    print_times(run, "held, in all, behind", held);
    print_times(run, "while it was in a GPU segment, in one of theirs were", others);
    return 0;
}

// --- export

int export_to_nsys(const trace::Run& run, const trace::RunStory& story,
                   const TraceOptions& options) {
    const auto backend = trace::load_nvtxw_backend();
    if (!backend) return fail(kExitFailure, "trace export --nsys: " + backend.error());
    const auto written = trace::write_nsys(run, story, *backend->interface, options.out);
    if (!written) return fail(kExitFailure, backend->path + ": " + written.error());
    tools::log_info("wrote {} events by {}", *written, backend->path);
    return 0;
}

int export_to(const trace::Run& run, const trace::RunStory& story, const TraceOptions& options) {
    if (options.perfetto + options.chrome + options.csv + options.nsys != 1)
        return fail(kExitUsage,
                    "trace export: accepted: one of --perfetto, --chrome, --csv, --nsys");
    if (options.out.empty()) return fail(kExitUsage, "trace export: no file, accepted: -o FILE");
    if (options.nsys) return export_to_nsys(run, story, options);
    const std::string text = options.perfetto ? trace::to_perfetto(run, story)
                             : options.chrome ? trace::to_chrome(run, story)
                                              : trace::to_csv(run, story);
    if (const auto written = write_file_atomically(options.out, text); !written)
        return fail(kExitFailure, written.error());
    return 0;
}

}  // namespace

CLI::App* add_trace(CLI::App& app, TraceOptions& options) {
    CLI::App* command =
        app.add_subcommand("trace", "What happened in a run, and why a frame was late");
    command->footer(
        "info FILE: frames, late ones and their causes, holds, per chain.\n"
        "why FILE [--chain NAME [--frame N]]: what was done for a frame; the last late one.\n"
        "export FILE --perfetto | --chrome | --csv | --nsys -o OUT: for ui.perfetto.dev,\n"
        "chrome://tracing, a table, or by the library that NVTXW3_LIBRARY names.\n"
        "FILE is what `urgengo run --trace` or `urgengo ctl dump` has written, or what a killed\n"
        "program has left of it.");
    command->add_option("what", options.what, "info, why or export")
        ->required()
        ->check(CLI::IsMember({"info", "why", "export"}));
    command->add_option("file", options.file, "The trace")->required();
    command->add_flag("--json", options.json, "info, why: print JSON");
    command->add_option("--chain", options.chain, "why: the chain's name");
    command->add_option("--frame", options.frame, "why: the frame's number, from 1")
        ->check(CLI::PositiveNumber);
    command->add_flag("--perfetto", options.perfetto, "export: Perfetto's protobuf");
    command->add_flag("--chrome", options.chrome, "export: Chrome's trace events, JSON");
    command->add_flag("--csv", options.csv, "export: a table, times in ns of CLOCK_MONOTONIC");
    command->add_flag("--nsys", options.nsys,
                      "export: through NVTXW, for Nsight Systems; its library names the file");
    command->add_option("-o,--out", options.out,
                        "export: the file to write; --nsys: the session's name");
    return command;
}

int cmd_trace(const TraceOptions& options) {
    ProgressBar bar;
    const auto run =
        trace::read_run(options.file, [&](double part) { bar.show(part, options.file); });
    if (!run) return fail(kExitFailure, run.error());
    if (!options.json)
        for (const std::string& warning : run->warnings) tools::log_warning("{}", warning);
    const trace::RunStory story = trace::tell(*run);
    if (options.what == "why") return why(*run, story, options);
    if (options.what == "export") return export_to(*run, story, options);
    return options.json ? info_json(*run, story) : info(*run, story);
}

}  // namespace urgengo::cli
