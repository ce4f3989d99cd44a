// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_top.h"

#include <fmt/format.h>
#include <unistd.h>

#include <vector>

#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/page/find_pages.h"
#include "tools/urgengo/text_table.h"
#include "tools/urgengo/top/top_screen.h"

namespace urgengo::cli {
namespace {

constexpr double kShortest = 0.05, kLongest = 3600;

void print(const std::vector<PageReading>& pages, const TopOptions& options) {
    TextTable table;
    for (const TopLine& line : top_lines(pages, options)) {
        if (line.look == TopLine::Look::kProcess) {
            fmt::print("{}{}\n", table.text(), line.cells[0]);
            table = {};
            table.add_row(top_columns());
        } else if (line.look != TopLine::Look::kHead) {
            table.add_row(line.cells);
        }
    }
    fmt::print("{}", table.text());
}

}  // namespace

CLI::App* add_top(CLI::App& app, TopCommand& command) {
    CLI::App* top = app.add_subcommand("top", "Show chains by urgency, while they run");
    top->footer(
        fmt::format("Keys: {}\nOn a terminal that shows nothing else; --once prints once and ends.",
                    top_keys()));
    top->add_option("--pid", command.pid, "One process; else all that this user may look at")
        ->check(CLI::PositiveNumber);
    auto* const once = top->add_flag("--once", command.once, "Print what there is now, and end");
    top->add_flag("--json", command.json, "As JSON")->needs(once);
    top->add_option("--interval", command.interval, "Seconds between two looks [0.5]")
        ->check(CLI::Range(kShortest, kLongest));
    top->add_option("--sort", command.sort, "urgency, name, missed, p99 or held [urgency]")
        ->check(CLI::IsMember({"urgency", "name", "missed", "p99", "held"}));
    top->add_flag("--reverse", command.reverse, "The last first");
    top->add_flag("--tasks", command.tasks, "Show the tasks of each chain");
    top->add_option("--filter", command.filter, "Show chains whose names hold this");
    return top;
}

int cmd_top(const TopCommand& command) {
    const TopOptions options{.order = top_order(command.sort).value_or(TopOrder::kUrgency),
                             .reverse = command.reverse,
                             .tasks = command.tasks,
                             .filter = command.filter};
    // Whether a process has become another program is looked for once: that takes a lock of its
    // memory.
    const auto look = [&](bool looks_for_exec) {
        return choose_pages(page_folder(), command.pid, true, looks_for_exec);
    };
    auto pages = look(true);
    if (!pages) return fail(kExitFailure, pages.error());
    if (command.json) {
        fmt::print("{}\n", top_json(*pages).dump(2, ' ', false,
                                                 nlohmann::ordered_json::error_handler_t::replace));
        return 0;
    }
    if (command.once) {
        if (pages->empty()) fmt::print("no process under UrgenGo\n");
        print(*pages, options);
        return 0;
    }
    if (isatty(STDIN_FILENO) == 0 || isatty(STDOUT_FILENO) == 0)
        return fail(kExitUsage, "top: found no terminal, accepted: a terminal, or --once");
    const auto shown = show_top(options, command.interval, [&] {
        auto now = look(false);
        return now ? std::move(*now) : std::vector<PageReading>{};
    });
    return shown ? 0 : fail(kExitFailure, shown.error());
}

}  // namespace urgengo::cli
