// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_top.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <limits>
#include <thread>
#include <vector>

#include "host/base/clock.h"
#include "tools/urgengo/compare/started_program.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/page/find_pages.h"
#include "tools/urgengo/top/collisions.h"
#include "tools/urgengo/top/top_rates.h"
#include "tools/urgengo/top/top_screen.h"

namespace urgengo::cli {
namespace {

constexpr double kShortest = 0.05, kLongest = 3600;
/// Between the two looks of --once, which tell how many cores are busy.
constexpr std::chrono::milliseconds kBetween{200};

/// All columns, unless they are for a terminal that is narrower.
std::size_t room() {
    winsize size{};
    const bool is_terminal = ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
    return is_terminal ? size.ws_col : std::numeric_limits<std::size_t>::max();
}

void print(const std::vector<PageReading>& pages, const TopOptions& options) {
    const std::vector<TopLine> lines = top_lines(pages, options);
    const std::vector<std::size_t> widths = top_widths(lines);
    const std::vector<TopColumn> shown = columns_that_fit(widths, room());
    for (const TopLine& line : lines) {
        if (line.look == TopLine::Look::kHead) continue;
        fmt::print("{}\n", top_text(line, widths, shown));
        if (line.look == TopLine::Look::kProcess)
            fmt::print("{}\n", top_text(lines[0], widths, shown));
    }
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
    TopRates rates([](std::uint32_t process) { return cpu_time_of(static_cast<pid_t>(process)); });
    auto pages = look(true);
    if (!pages) return fail(kExitFailure, pages.error());
    Collisions collisions;
    const auto set = [&](std::vector<PageReading>& read) {
        const nanoseconds now = monotonic_now();
        rates.set(read, now);
        collisions.set(read, now);
    };
    set(*pages);
    const CollisionLooks looks(collisions);
    if (command.once && !pages->empty()) {
        std::this_thread::sleep_for(kBetween);
        pages = look(false);
        if (!pages) return fail(kExitFailure, pages.error());
        set(*pages);
    }
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
        if (!now) return std::vector<PageReading>{};
        set(*now);
        return std::move(*now);
    });
    return shown ? 0 : fail(kExitFailure, shown.error());
}

}  // namespace urgengo::cli
