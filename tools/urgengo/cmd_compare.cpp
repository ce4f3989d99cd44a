// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_compare.h"

#include <fmt/format.h>

#include <algorithm>
#include <random>
#include <thread>

#include "host/base/clock.h"
#include "tools/urgengo/compare/live_comparison.h"
#include "tools/urgengo/compare/started_program.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/interrupts.h"
#include "tools/urgengo/page/find_pages.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/program/program_setup.h"
#include "tools/urgengo/progress_bar.h"

namespace urgengo::cli {
namespace {

constexpr double kDefaultBlock_s = 5;
constexpr std::chrono::seconds kUntilFirstLaunch{120};
constexpr std::chrono::milliseconds kLookForPage{20};

nanoseconds time_of(double seconds) {
    return nanoseconds(static_cast<std::int64_t>(seconds * 1e9));
}

abi::ControlCommand command_of(const std::string& mode) {
    if (mode == "off") return abi::ControlCommand::kOff;
    if (mode == "observe") return abi::ControlCommand::kObserve;
    return mode == "shadow" ? abi::ControlCommand::kShadow : abi::ControlCommand::kOn;
}

/// Of two of the same name, what tells them apart.
Comparison named(std::string a, std::string b, std::uint64_t seed) {
    if (a == b) a += " (1)", b += " (2)";
    return {.a = std::move(a), .b = std::move(b), .seed = seed, .note = {}, .rows = {}};
}

int print(const Comparison& comparison, bool as_json) {
    using nlohmann::ordered_json;
    if (as_json)
        fmt::print("{}\n",
                   to_json(comparison).dump(2, ' ', false, ordered_json::error_handler_t::replace));
    else
        fmt::print("{}", to_text(comparison));
    return 0;
}

/// `urgengo run`, which becomes the program: it keeps its number.
std::vector<std::string> run_line(const CompareOptions& options, const std::string& mode,
                                  const std::vector<std::string>& program) {
    std::vector<std::string> line{urgengo_program(), "run", "--quiet"};
    const auto add = [&](const char* option, const std::string& value) {
        if (!value.empty()) line.insert(line.end(), {option, value});
    };
    add("--config", options.config);
    add("--profile", options.profile);
    add("--preset", options.preset);
    add("--real-libcuda", options.real_libcuda);
    add("--mode", mode);
    line.emplace_back("--");
    line.insert(line.end(), program.begin(), program.end());
    return line;
}

/// Waits until the program launches for the first time.
Result<PageReading> page_of(StartedProgram& program) {
    const nanoseconds end = monotonic_now() + kUntilFirstLaunch;
    for (;;) {
        const auto pages = find_pages(page_folder(), false);
        const auto its = std::find_if(pages.begin(), pages.end(), [&](const PageReading& page) {
            return page.process.process == static_cast<std::uint32_t>(program.process()) &&
                   page.liveness == observe::Liveness::kThere;
        });
        if (its != pages.end()) return *its;
        if (const auto code = program.exit_code())
            return Error{
                fmt::format("the program has ended with exit code {} before it launched "
                            "anything under UrgenGo",
                            *code)};
        if (Interrupts::has_come()) return Error{"interrupted"};
        if (monotonic_now() > end)
            return Error{fmt::format("the program has launched nothing under UrgenGo for {} s",
                                     kUntilFirstLaunch.count())};
        std::this_thread::sleep_for(kLookForPage);
    }
}

/// The program is in the mode that it was in, whatever ends the comparison.
struct Restoring {
    LiveComparison& live;
    ~Restoring() {
        try {
            live.restore();
        } catch (...) {  // the program has ended, say
        }
    }
};

int compare_live(const CompareOptions& options, const PageReading& page, std::uint64_t seed) {
    if (page.mode == abi::StatusMode::kOff || page.mode == abi::StatusMode::kTripped)
        return fail(kExitFailure,
                    fmt::format("process {} is {}, accepted: observe, shadow or enforce",
                                page.process.process, to_word(page.mode)));
    LiveComparison live(page,
                        {.a = command_of(options.with),
                         .b = command_of(options.against),
                         .block = time_of(options.block > 0 ? options.block : kDefaultBlock_s),
                         .warm_up = time_of(options.warm_up),
                         .blocks = options.blocks,
                         .seed = seed});
    Comparison comparison = named(options.with, options.against, seed);
    {
        const Restoring restoring{live};
        ProgressBar bar(!options.quiet);
        comparison.note = live.run([] { return Interrupts::has_come(); },
                                   [&](double part) { bar.show(part, "blocks"); });
    }
    comparison.rows = live.rows();
    return print(comparison, options.json);
}

int compare_started(const CompareOptions& options, const std::vector<std::string>& program,
                    std::uint64_t seed) {
    auto started =
        StartedProgram::start(run_line(options, "", program), current_environment(), options.json);
    if (!started) return fail(kExitFailure, started.error());
    const auto page = page_of(*started);
    if (!page) return fail(kExitFailure, page.error());
    const int code = compare_live(options, *page, seed);
    started->end();
    return code;
}

struct WholeRun {
    double time_s = 0, cpu_s = 0;
};

/// @returns nothing, and why: it failed, or was interrupted
Result<WholeRun> run_once(const CompareOptions& options, const std::vector<std::string>& line,
                          const Environment& environment) {
    auto program = StartedProgram::start(line, environment, options.json);
    if (!program) return Error{program.error()};
    const nanoseconds begin = monotonic_now();
    const nanoseconds end = options.block > 0 ? begin + time_of(options.block) : nanoseconds::max();
    while (!program->exit_code() && !Interrupts::has_come() && monotonic_now() < end)
        std::this_thread::sleep_for(kLookForPage / 4);
    const bool has_ended = program->exit_code().has_value();
    const nanoseconds took = monotonic_now() - begin;
    const int code = program->end();
    if (Interrupts::has_come()) return Error{"interrupted"};
    if (has_ended && code != 0) return Error{fmt::format("a run ended with exit code {}", code)};
    return WholeRun{1e-9 * static_cast<double>(took.count()), program->cpu_s()};
}

// A bare program tells of no frames: what it takes is all that there is to compare.
int compare_with_bare(const CompareOptions& options, const std::vector<std::string>& program,
                      std::uint64_t seed) {
    const Environment environment = current_environment();
    const ProgramSetup setup = set_up_program(program, options.real_libcuda, environment);
    if (setup.exit_code != 0) return fail(setup.exit_code, setup.message);
    std::vector<std::string> bare_line = program;
    bare_line[0] = setup.path;
    Environment bare = bare_environment(environment, setup.interposer);
    // The driver that the other runs have.
    if (!options.real_libcuda.empty())
        prepend_library_folder(bare, setup.real_libcuda.substr(0, setup.real_libcuda.rfind('/')));
    const std::string mode = options.against == "on" ? "" : options.against;
    const auto ours = run_line(options, mode, program);

    Comparison comparison = named("bare", options.against, seed);
    std::vector<BlockPair> times, cpu_times;
    std::mt19937_64 random(seed);
    ProgressBar bar(!options.quiet);
    for (int pair = 0; 2 * pair + 1 < options.blocks && comparison.note.empty(); ++pair) {
        BlockPair time, cpu;
        const bool b_first = random() % 2 == 0;
        for (const bool is_b : {b_first, !b_first}) {
            bar.show((2.0 * pair + (is_b == b_first ? 0 : 1)) / options.blocks, "runs");
            const auto run = run_once(options, is_b ? ours : bare_line, is_b ? environment : bare);
            if (!run) {
                comparison.note = run.error();
                break;
            }
            (is_b ? time.b : time.a) = run->time_s;
            (is_b ? cpu.b : cpu.a) = run->cpu_s;
        }
        if (!comparison.note.empty() && times.empty() && !Interrupts::has_come())
            return fail(kExitFailure, comparison.note);
        if (!comparison.note.empty()) break;
        times.push_back(time);
        cpu_times.push_back(cpu);
    }
    const auto add = [&](const char* measure, const std::vector<BlockPair>& pairs) {
        ComparedRow row;
        row.of = "process";
        row.measure = measure;
        row.unit = "s";
        row.pairs = pairs.size();
        row.difference = difference(pairs, kConfidence, seed);
        comparison.rows.push_back(std::move(row));
    };
    if (options.block <= 0) add("time", times);
    add("CPU", cpu_times);
    tell_together(comparison.rows);
    return print(comparison, options.json);
}

/// @returns what is wrong with the options; empty if nothing is
std::string check(const CompareOptions& options, const std::vector<std::string>& program) {
    if (options.pid != 0 && !program.empty()) return "--pid and a program, accepted: one of them";
    if (options.pid == 0 && program.empty())
        return "no program, accepted: urgengo compare [options] -- program [args...], or --pid N";
    if (options.pid != 0 && options.with_bare)
        return "--pid and --with-bare, accepted: a program that can be started anew";
    if (options.with_bare && options.against == "off")
        return "--with-bare and --against off, accepted: observe, shadow or on";
    return {};
}

}  // namespace

CLI::App* add_compare(CLI::App& app, CompareOptions& options) {
    constexpr double kMostSeconds = 86'400;
    constexpr int kMostBlocks = 100'000;
    CLI::App* command =
        app.add_subcommand("compare", "Is a program better with UrgenGo? Switches to and fro");
    command->footer(
        "After the options: -- program [args...]; it is ended after the last block.\n"
        "Blocks come in pairs, one of each mode, in random order. Frames that span a switch count\n"
        "for none. Ctrl-C tells what there is so far. The mode is in the end what it was.");
    const auto modes = CLI::IsMember({"off", "observe", "shadow", "on"});
    command->add_option("-c,--config", options.config, "The chains [chains.yaml]");
    command->add_option("--profile", options.profile, "As for urgengo run");
    command->add_option("--preset", options.preset, "As for urgengo run");
    command->add_option("--real-libcuda", options.real_libcuda, "As for urgengo run");
    command
        ->add_option("--with", options.with,
                     "off, observe, shadow or on [observe]; off counts no frames")
        ->check(modes);
    command->add_option("--against", options.against, "The other mode [on]")->check(modes);
    auto* const bare = command->add_flag(
        "--with-bare", options.with_bare,
        "Compare whole runs instead, with ones without UrgenGo: their time, and CPU time");
    command->add_option("--pid", options.pid, "A process that runs under UrgenGo already")
        ->check(CLI::PositiveNumber)
        ->excludes(bare);
    command
        ->add_option("--block", options.block,
                     "Seconds of a block [5]; with --with-bare, of a run [to its end]")
        ->check(CLI::Range(0.1, kMostSeconds));
    command->add_option("--blocks", options.blocks, "How many, 12 at least for an interval [40]")
        ->check(CLI::Range(2, kMostBlocks));
    command->add_option("--warm-up", options.warm_up, "Seconds before the first block [5]")
        ->check(CLI::Range(0.0, kMostSeconds));
    command->add_option("--seed", options.seed, "Of the order of blocks [random, and printed]");
    command->add_flag("--json", options.json, "Print JSON; what the program prints goes to stderr");
    command->add_flag("-q,--quiet", options.quiet, "No progress bar");
    return command;
}

int cmd_compare(const CompareOptions& options, const std::vector<std::string>& program) {
    if (const std::string wrong = check(options, program); !wrong.empty())
        return fail(kExitUsage, wrong);
    const std::uint64_t seed = options.seed != 0 ? options.seed : 1 + std::random_device()();
    const Interrupts interrupts{SIGINT, SIGTERM, SIGHUP};  // the last: the terminal has gone
    if (options.with_bare) return compare_with_bare(options, program, seed);
    if (options.pid == 0) return compare_started(options, program, seed);
    const auto pages = choose_pages(page_folder(), options.pid, false);
    if (!pages) return fail(kExitFailure, pages.error());
    return compare_live(options, pages->front(), seed);
}

}  // namespace urgengo::cli
