// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/page/find_pages.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <functional>
#include <utility>

#include "host/base/clock.h"
#include "host/base/settings.h"
#include "tools/log/log.h"

namespace urgengo::cli {

namespace {

/// Whether the process' user has made it, and under its own name: others may put files, or links to
/// them, into the folder.
bool is_genuine(const PageReading& page) {
    return page.stem.substr(page.stem.rfind('/') + 1) == observe::page_stem(page.process) &&
           observe::may_be_of(page.file, page.process, page.liveness);
}

std::string in_words(const std::vector<PageReading>& pages) {
    std::string words;
    for (const PageReading& page : pages)
        words +=
            fmt::format("{}{} ({})", words.empty() ? "" : ", ", page.process.process, page.program);
    return words;
}

/// Leaves those that it holds for, if there are any.
template <typename Predicate>
void prefer(std::vector<PageReading>& pages, const Predicate& holds) {
    if (std::any_of(pages.begin(), pages.end(), holds)) std::erase_if(pages, std::not_fn(holds));
}

/// @returns them, the oldest first
std::vector<PageReading> read_pages(const std::string& folder) {
    std::vector<PageReading> pages;
    for (const std::string& stem : observe::list_pages(folder)) {
        auto page = read_page(stem, monotonic_now());
        if (!page)
            tools::log_debug("passes over {}", page.error());
        else if (!is_genuine(*page))
            tools::log_debug("passes over {}: it is not of the process that it names", stem);
        else
            pages.push_back(std::move(*page));
    }
    std::stable_sort(pages.begin(), pages.end(),
                     [](const PageReading& a, const PageReading& b) { return a.began < b.began; });
    return pages;
}

bool is_gone(const PageReading& page) {
    return page.liveness == observe::Liveness::kGone || page.is_over;
}

}  // namespace

std::string page_folder() {
    return read_settings().share.folder;
}

std::vector<PageReading> find_pages(const std::string& folder, bool looks_for_exec) {
    if (folder.empty()) return {};
    observe::remove_stale_pages(folder, looks_for_exec);
    std::vector<PageReading> pages = read_pages(folder);
    std::erase_if(pages, is_gone);
    return pages;
}

Result<std::vector<PageReading>> choose_page_with_gone(const std::string& folder,
                                                       std::uint32_t pid) {
    std::vector<PageReading> pages;
    if (!folder.empty()) pages = read_pages(folder);
    if (pid != 0)
        std::erase_if(pages, [&](const PageReading& p) { return p.process.process != pid; });
    if (pages.empty() || !std::all_of(pages.begin(), pages.end(), is_gone))
        return choose_pages(folder, pid, false);
    return std::vector<PageReading>{std::move(pages.back())};
}

Result<std::vector<PageReading>> choose_pages(const std::string& folder, std::uint32_t pid,
                                              bool all, bool looks_for_exec) {
    std::vector<PageReading> pages = find_pages(folder, looks_for_exec);
    const std::string where = folder.empty() ? "URGENGO_SHARE is 0" : "in " + folder;
    const auto is_here = [space = observe::own_process().pid_namespace](const PageReading& page) {
        return page.process.pid_namespace == space;
    };
    if (pid != 0) {
        std::erase_if(pages, [&](const PageReading& p) { return p.process.process != pid; });
        std::vector<PageReading> elsewhere;
        for (PageReading& page : pages)
            if (!is_here(page)) elsewhere.push_back(page);
        std::erase_if(pages, std::not_fn(is_here));
        if (pages.empty() && elsewhere.empty())
            return Error{fmt::format("found no process {} under UrgenGo that may be looked at ({})",
                                     pid, where)};
        if (pages.empty())
            return Error{fmt::format(
                "found no process {} under UrgenGo in this pid namespace ({}), but in another: {}, "
                "accepted: its number there, in that namespace, or --all",
                pid, where, in_words(elsewhere))};
        return pages;
    }
    if (all) return pages;
    if (pages.empty())
        return Error{fmt::format(
            "found no process under UrgenGo that may be looked at ({}); a process is found from "
            "its first launch on",
            where)};
    prefer(pages, is_here);
    const std::uint32_t user = geteuid();
    if (user != 0) prefer(pages, [&](const PageReading& page) { return page.file.user == user; });
    if (pages.size() > 1)
        return Error{fmt::format("found {} processes: {}, accepted: --pid N, or --all",
                                 pages.size(), in_words(pages))};
    return pages;
}

}  // namespace urgengo::cli
