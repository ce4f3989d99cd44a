// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_ctl.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

#include "host/base/clock.h"
#include "tools/urgengo/ctl_dump.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/page/control.h"
#include "tools/urgengo/page/find_pages.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/resolve.h"
#include "tools/urgengo/text_table.h"

namespace urgengo::cli {
namespace {

constexpr double kMostSeconds = 3600;

abi::ControlCommand command_of(const CtlOptions& options) {
    using abi::ControlCommand;
    const bool is_all = options.chain.empty();
    if (options.what == "off") return is_all ? ControlCommand::kOff : ControlCommand::kChainOff;
    if (options.what == "observe")
        return is_all ? ControlCommand::kObserve : ControlCommand::kChainObserve;
    if (options.what == "reload") return ControlCommand::kReload;
    if (options.what == "shadow")
        return is_all ? ControlCommand::kShadow : ControlCommand::kChainShadow;
    if (options.what == "on") return is_all ? ControlCommand::kOn : ControlCommand::kChainOn;
    return ControlCommand::kNone;
}

/// @returns the word that was sent, or why none was
/// @param resolved  of reload: the config, as programs read it
Result<std::uint32_t> send(const PageReading& page, const CtlOptions& options,
                           const std::string& resolved) {
    if (!resolved.empty()) {
        if (!page.steers_chains) return Error{"its UrgenGo is too old to reload"};
        return send_command(page.stem, abi::ControlCommand::kReload, kNoChain, resolved);
    }
    if (options.chain.empty()) return send_command(page.stem, command_of(options));
    const auto chain =
        std::find_if(page.chains.begin(), page.chains.end(),
                     [&](const ChainReading& each) { return each.name == options.chain; });
    if (chain == page.chains.end()) {
        std::string names;
        for (const ChainReading& each : page.chains)
            names += (names.empty() ? "" : ", ") + each.name;
        return Error{fmt::format("has no chain '{}', only {}", options.chain, names)};
    }
    if (!page.steers_chains) return Error{"its UrgenGo is too old to steer one chain"};
    return send_command(page.stem, command_of(options),
                        static_cast<std::uint32_t>(chain - page.chains.begin()));
}

struct Steered {
    PageReading page;  ///< afterwards, or as it was last seen
    std::string result;
    bool is_wrong = false;
    double took_ms = 0;
};

/// @returns what became of it, in words
std::string in_words(Answer answer, const CtlOptions& options) {
    switch (answer) {
        case Answer::kDone:
            return "done";
        case Answer::kStopped:
            return "stopped: acts when it is continued";
        case Answer::kGone:
            return "has ended";
        case Answer::kDeaf:
            return "does not listen: it could start no thread, or its control file was cut short";
        case Answer::kLate:
            break;
    }
    return fmt::format("has not answered within {} s", options.timeout);
}

void settle(Steered& steered, Answer answer, std::uint32_t word, const CtlOptions& options) {
    steered.result = in_words(answer, options);
    steered.is_wrong = answer == Answer::kDeaf || answer == Answer::kLate;
    if (steered.is_wrong && steered.page.liveness == observe::Liveness::kElsewhere) {
        // Of a container that has ended the page is there still.
        steered.result += "; it is in another pid namespace, and may have ended";
        steered.is_wrong = !options.all;
    }
    if (auto page = read_page(steered.page.stem, monotonic_now())) steered.page = std::move(*page);
    if (answer != Answer::kDone) return;
    if (steered.page.mode == abi::StatusMode::kTripped) {
        steered.result = "UrgenGo has switched itself off there, for good";
        steered.is_wrong = options.what == "on";
    } else if (const std::string why = refusal(steered.page, word); !why.empty()) {
        steered.result = why;
        steered.is_wrong = true;
    } else if (const std::string text = told(steered.page, word); !text.empty()) {
        steered.result += ": " + text;
    } else if (steered.page.holds_left > 0) {
        steered.result +=
            fmt::format("; {} held threads have had no core since, and go on with one",
                        steered.page.holds_left);
    }
}

// All words are sent before any answer is waited for: one process that hangs keeps no other.
std::vector<Steered> steer(std::vector<PageReading> pages, const CtlOptions& options,
                           const std::string& resolved) {
    struct Sent {
        std::size_t index;
        std::uint32_t word;
    };
    std::vector<Steered> all;
    std::vector<Sent> sent;
    const nanoseconds begin = monotonic_now();
    for (PageReading& page : pages) {
        Steered& steered = all.emplace_back();
        const auto word = send(page, options, resolved);
        steered.page = std::move(page);
        if (word) {
            sent.push_back({all.size() - 1, *word});
        } else {
            steered.result = word.error();
            steered.is_wrong = true;
        }
    }
    const auto longest =
        std::chrono::milliseconds(static_cast<std::int64_t>(options.timeout * 1e3));
    for (const Sent& each : sent) {
        const nanoseconds spent = monotonic_now() - begin;
        const auto left =
            std::max(longest - std::chrono::duration_cast<std::chrono::milliseconds>(spent), {});
        Steered& steered = all[each.index];
        const Answer answer = wait_for_answer(steered.page.stem, each.word, left);
        steered.took_ms = 1e-6 * static_cast<double>((monotonic_now() - begin).count());
        settle(steered, answer, each.word, options);
    }
    return all;
}

/// @returns the mode, and those of chains that have another one
std::string modes_of(const PageReading& page) {
    std::string others;
    for (const ChainReading& chain : page.chains)
        if (const auto mode = mode_of(page, chain); mode != page.mode)
            others += fmt::format("; {} {}", chain.name, to_word(mode));
    return to_word(page.mode) + others;
}

std::string mode_shown(const PageReading& page) {
    return page.liveness == observe::Liveness::kThere
               ? modes_of(page)
               : fmt::format("{} ({})", modes_of(page), to_word(page.liveness));
}

nlohmann::ordered_json to_json(const Steered& steered) {
    const PageReading& page = steered.page;
    nlohmann::ordered_json json = {
        {"pid", page.process.process},       {"program", page.program},
        {"process", to_word(page.liveness)}, {"mode", to_word(page.mode)},
        {"listens", page.is_controlled},     {"held_now", page.held_now}};
    if (!steered.result.empty()) {
        json["result"] = steered.result;
        json["took_ms"] = steered.took_ms;
    }
    json["answered_ns"] = page.control_seen_ns;
    json["holds_left"] = page.holds_left;
    json["chains"] = nlohmann::ordered_json::array();
    for (const ChainReading& chain : page.chains)
        json["chains"].push_back({{"name", chain.name},
                                  {"mode", to_word(mode_of(page, chain))},
                                  {"frames", chain.instances},
                                  {"finished", chain.finished},
                                  {"missed", chain.missed}});
    return json;
}

void print(const std::vector<Steered>& all) {
    const bool has_results =
        std::any_of(all.begin(), all.end(), [](const Steered& s) { return !s.result.empty(); });
    TextTable shown;
    shown.add_row({"pid", "program", "mode", "chains", "frames", "missed", "held now",
                   has_results ? "result" : ""});
    for (const Steered& steered : all) {
        const PageReading& page = steered.page;
        std::uint64_t frames = 0, missed = 0;
        for (const ChainReading& chain : page.chains)
            frames += chain.instances, missed += chain.missed;
        shown.add_row({std::to_string(page.process.process), page.program, mode_shown(page),
                       std::to_string(page.chains.size()), std::to_string(frames),
                       std::to_string(missed), std::to_string(page.held_now), steered.result});
    }
    fmt::print("{}", shown.text());
}

}  // namespace

CLI::App* add_ctl(CLI::App& app, CtlOptions& options) {
    CLI::App* command =
        app.add_subcommand("ctl", "Switch UrgenGo off and on in a program that runs, or hangs");
    command->footer(
        "off: nothing is held or changed any more, within 10 ms.\n"
        "observe: frames are counted, nothing is changed.\n"
        "shadow: what would be held is counted besides, by marks; nothing is held.\n"
        "on: as the program was started.\n"
        "With --chain: that chain alone; the others go on. The weaker one of its mode and that of\n"
        "all chains holds.\n"
        "reload: takes from another config what can change at run time, all of it or nothing:\n"
        "the mode, and of each chain period, deadline, criticality, on_late,\n"
        "max_consecutive_misses and mode.\n"
        "status: what is there, and in which mode.\n"
        "dump: its flight recorder, as a file for `urgengo trace`; also of one that was killed.\n"
        "Exits with 0 if every process has done that, or will when it is continued. With --all,\n"
        "one of another pid namespace need not answer: it may have ended.");
    command->add_option("what", options.what, "off, observe, shadow, on, reload, status or dump")
        ->required()
        ->check(CLI::IsMember({"off", "observe", "shadow", "on", "reload", "status", "dump"}));
    command->add_option("-c,--config", options.config, "The chains, for reload [chains.yaml]");
    auto* const pid = command
                          ->add_option("--pid", options.pid,
                                       "The process, in this pid namespace; else the only one")
                          ->check(CLI::PositiveNumber);
    command->add_option("--chain", options.chain, "This chain of the config alone");
    command->add_flag("--all", options.all, "All processes that this user may steer")
        ->excludes(pid);
    command->add_option("--timeout", options.timeout, "Seconds to wait for an answer [2]")
        ->check(CLI::Range(0.0, kMostSeconds));
    command->add_option("-o,--out", options.out,
                        "dump: the file; %n in it stands for the number of the dump");
    auto* const on_miss = command->add_flag("--on-miss", options.on_miss,
                                            "dump: when a chain has missed its deadline");
    command->add_option("--in-a-row", options.in_a_row, "So many times in a row [1]")
        ->check(CLI::Range(1u, 1'000'000u))
        ->needs(on_miss);
    command->add_option("--after", options.after, "Seconds from the miss to the dump [1]")
        ->check(CLI::Range(0.0, kMostSeconds))
        ->needs(on_miss);
    command->add_option("--files", options.files, "So many dumps, then it is over [1]")
        ->check(CLI::Range(1u, 100'000u))
        ->needs(on_miss);
    command->add_flag("--json", options.json, "Print JSON");
    command->add_flag("-q,--quiet", options.quiet, "Print nothing but what went wrong");
    return command;
}

int cmd_ctl(const CtlOptions& options) {
    if (options.what == "dump") return ctl_dump(options);
    const bool is_status = options.what == "status";
    if (!options.chain.empty() && options.what == "reload")
        return fail(kExitUsage, options.what + " and --chain, accepted: one of them");
    std::string resolved;
    if (options.what == "reload") {
        // What `priority_via: auto` came to stays as it is.
        const auto file = resolve({.yaml = options.config.empty() ? kDefaultConfig : options.config,
                                   .profile = {},
                                   .preset = {},
                                   .allow_stale = true});
        if (!file) return fail(kExitUsage, file.error());
        resolved = file->path;
    }
    auto pages =
        choose_pages(page_folder(), options.pid, options.all || (is_status && options.pid == 0));
    if (!pages) return fail(kExitFailure, pages.error());
    std::vector<Steered> all;
    if (is_status)
        for (PageReading& page : *pages) all.emplace_back().page = std::move(page);
    else
        all = steer(std::move(*pages), options, resolved);

    if (options.json) {
        nlohmann::ordered_json root = {{"format_version", 1}};
        root["processes"] = nlohmann::ordered_json::array();
        for (const Steered& steered : all) root["processes"].push_back(to_json(steered));
        fmt::print("{}\n",
                   root.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace));
    } else if (!options.quiet) {
        if (all.empty())
            fmt::print("no process under UrgenGo\n");
        else
            print(all);
    }
    int exit_code = 0;
    for (const Steered& steered : all) {
        if (!steered.is_wrong) continue;
        exit_code =
            fail(kExitFailure, fmt::format("process {} ({}): {}", steered.page.process.process,
                                           steered.page.program, steered.result));
    }
    return exit_code;
}

}  // namespace urgengo::cli
