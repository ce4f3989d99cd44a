// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/top/top_rates.h"

#include <algorithm>

namespace urgengo::cli {
namespace {

using namespace std::chrono_literals;

/// CPU time is counted in hundredths of a second, and looks are told when a frame ends.
constexpr nanoseconds kSpan = 1s;
/// Less is no span to divide by.
constexpr nanoseconds kShortest = 50ms, kShortestOfLooks = 500ms;

double to_s(nanoseconds time) {
    return 1e-9 * static_cast<double>(time.count());
}

}  // namespace

void TopRates::set(std::vector<PageReading>& pages, nanoseconds now) {
    std::map<Process, std::deque<Look>> still_there;
    for (PageReading& page : pages) {
        const Process process{page.process.start_ticks, page.process.process};
        std::deque<Look>& looks = still_there[process] = std::move(looks_[process]);
        const bool is_here = page.liveness == observe::Liveness::kThere ||
                             page.liveness == observe::Liveness::kStopped;
        looks.push_back(
            {now, is_here ? cpu_time_(page.process.process) : std::nullopt, page.looks});
        while (looks.size() > 2 && now - looks[1].time >= kSpan) looks.pop_front();
        const Look& then = looks.front();
        const Look& last = looks.back();
        const nanoseconds span = now - then.time;
        if (span >= kShortest && then.cpu_s && last.cpu_s)
            page.cores = std::max(*last.cpu_s - *then.cpu_s, 0.0) / to_s(span);
        if (span >= kShortestOfLooks)
            page.overhead = std::max(to_s(last.looks - then.looks), 0.0) / to_s(span);
        else if (page.began.count() > 0 && now - page.began >= kShortest)
            page.overhead = to_s(page.looks) / to_s(now - page.began);
    }
    looks_ = std::move(still_there);
}

}  // namespace urgengo::cli
