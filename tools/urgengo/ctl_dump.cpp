// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/ctl_dump.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "host/base/atomic_file.h"
#include "host/base/clock.h"
#include "tools/trace/run_reader.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/page/find_pages.h"
#include "tools/urgengo/page/records.h"
#include "tools/urgengo/progress_bar.h"

namespace urgengo::cli {
namespace {

constexpr auto kLook = std::chrono::milliseconds(20);

struct Miss {
    std::string chain;
    std::uint64_t missed = 0;
};

/// @returns the chain that has missed since, and so many frames in a row
std::optional<Miss> new_miss(const PageReading& before, const PageReading& now,
                             std::uint32_t in_a_row) {
    for (std::size_t i = 0; i < std::min(before.chains.size(), now.chains.size()); ++i) {
        const ChainReading &old = before.chains[i], &chain = now.chains[i];
        if (chain.missed > old.missed && chain.misses_in_a_row >= in_a_row)
            return Miss{chain.name, chain.missed};
    }
    return std::nullopt;
}

/// @returns an exit code
int dump(const PageReading& page, const std::string& path, const std::string& why,
         const CtlOptions& options) {
    const auto bytes = copy_records(page);
    if (!bytes) return fail(kExitFailure, bytes.error());
    const auto run = trace::parse_run(*bytes, path);
    if (!run) return fail(kExitFailure, run.error());
    if (const auto written = write_file_atomically(path, *bytes); !written)
        return fail(kExitFailure, written.error());
    const double seconds = 1e-9 * static_cast<double>(run->last_ns() - run->first_ns());
    if (options.json) {
        const nlohmann::ordered_json json = {
            {"file", path},       {"pid", page.process.process},    {"program", page.program},
            {"seconds", seconds}, {"records", run->records.size()}, {"why", why}};
        fmt::print("{}\n",
                   json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace));
    } else if (!options.quiet) {
        fmt::print("{}: {} records of the last {:.1f} s of process {} ({}){}\n", path,
                   run->records.size(), seconds, page.process.process, page.program,
                   why.empty() ? "" : ": " + why);
    }
    std::fflush(stdout);
    return 0;
}

// The page is looked at; the program does not know.
int dump_on_miss(PageReading page, const CtlOptions& options) {
    const auto rest = std::chrono::nanoseconds(static_cast<std::int64_t>(options.after * 1e9));
    const std::string program = fmt::format("process {} ({})", page.process.process, page.program);
    ProgressBar bar(!options.quiet);
    for (std::uint32_t number = 1; number <= options.files;) {
        bar.show(-1,
                 fmt::format("waiting for miss {} of {} of {}", number, options.files, program));
        std::this_thread::sleep_for(kLook);
        auto now = read_page(page.stem, monotonic_now());
        if (!now || now->is_over || now->liveness == observe::Liveness::kGone) {
            if (!options.quiet)
                fmt::print(options.json ? stderr : stdout,
                           "{} has ended; {} of {} dumps were written\n", program, number - 1,
                           options.files);
            return number > 1 ? 0 : kExitFailure;
        }
        const auto miss = new_miss(page, *now, options.in_a_row);
        page = std::move(*now);
        if (!miss) continue;
        std::this_thread::sleep_for(rest);  // what follows tells, too
        const std::string why =
            fmt::format("{} missed its deadline for the {}. time", miss->chain, miss->missed);
        const int exit_code =
            dump(page, dump_name(options.out, number, options.files), why, options);
        if (exit_code != 0) return exit_code;
        ++number;
        if (auto after = read_page(page.stem, monotonic_now())) page = std::move(*after);
    }
    return 0;
}

}  // namespace

std::string dump_name(const std::string& path, std::uint32_t number, std::uint32_t most) {
    std::string name = path;
    const std::string text = std::to_string(number);
    if (const std::size_t at = name.find("%n"); at != std::string::npos)
        return name.replace(at, 2, text);
    if (most <= 1) return name;
    const std::size_t slash = name.rfind('/');
    std::size_t dot = name.rfind('.');
    if (dot == std::string::npos || (slash != std::string::npos && dot < slash)) dot = name.size();
    return name.insert(dot, "-" + text);
}

int ctl_dump(const CtlOptions& options) {
    if (options.out.empty())
        return fail(kExitUsage, "ctl dump: no file, accepted: -o FILE (run.ugtrace, say)");
    if (options.all) return fail(kExitUsage, "ctl dump: found --all, accepted: --pid N");
    const bool is_watching = options.on_miss;
    auto pages = is_watching ? choose_pages(page_folder(), options.pid, false)
                             : choose_page_with_gone(page_folder(), options.pid);
    if (!pages) return fail(kExitFailure, pages.error());
    PageReading& page = pages->front();
    if (is_watching) return dump_on_miss(std::move(page), options);
    const bool is_kept = page.mode == abi::StatusMode::kTripped &&
                         (page.is_over || page.liveness == observe::Liveness::kGone);
    const int exit_code = dump(page, options.out, is_kept ? "UrgenGo had tripped" : "", options);
    if (is_kept && exit_code == 0) observe::remove_page(page.stem);  // it was kept for this
    return exit_code;
}

}  // namespace urgengo::cli
