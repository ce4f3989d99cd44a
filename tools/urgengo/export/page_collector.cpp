// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/export/page_collector.h"

#include <utility>

#include "tools/urgengo/export/metrics.h"

namespace urgengo::cli {
namespace {

/// A ring of 1,024 frames goes round in this time at 5,000 frames a second.
constexpr std::chrono::milliseconds kBetweenLooks{200};
constexpr int kLooksBetweenFinds = 5;

}  // namespace

PageCollector::PageCollector(std::string folder, std::uint32_t pid)
    : folder_(std::move(folder)), pid_(pid) {}

void PageCollector::follow() {
    thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

std::vector<PageReading> PageCollector::find() const {
    auto pages = choose_pages(folder_, pid_, true, false);
    return pages ? std::move(*pages) : std::vector<PageReading>{};
}

void PageCollector::update(const std::vector<PageReading>& pages) const {
    std::map<std::string, std::unique_ptr<FrameFollower>> followers;
    for (const PageReading& page : pages) {
        auto& follower = followers_[page.stem];
        if (!follower || !follower->is_of(page.stem)) follower = FrameFollower::open(page.stem);
        if (!follower) continue;
        follower->follow();
        followers[page.stem] = std::move(follower);
    }
    followers_ = std::move(followers);
}

std::vector<prometheus::MetricFamily> PageCollector::Collect() const {
    const std::lock_guard lock(mutex_);
    std::vector<PageReading> pages = find();
    update(pages);
    std::vector<ExportedProcess> processes;
    for (PageReading& page : pages) {
        ExportedProcess& process = processes.emplace_back();
        const auto follower = followers_.find(page.stem);
        if (follower != followers_.end()) process.frames = follower->second->chains();
        process.page = std::move(page);
    }
    return metric_families(processes);
}

void PageCollector::run(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    for (int look = 0; !stop.stop_requested(); ++look) {
        if (look % kLooksBetweenFinds == 0)
            update(find());
        else
            for (const auto& [stem, follower] : followers_) follower->follow();
        wake_.wait_for(lock, stop, kBetweenLooks, [] { return false; });
    }
}

}  // namespace urgengo::cli
