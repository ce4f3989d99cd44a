// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/compare/live_comparison.h"

#include <algorithm>
#include <thread>

#include "host/base/clock.h"
#include "tools/urgengo/compare/started_program.h"
#include "tools/urgengo/page/control.h"

namespace urgengo::cli {
namespace {

constexpr std::chrono::milliseconds kLookAtPage{100};
constexpr std::chrono::seconds kAnswer{5};

// For the longest chain's work of the other mode to be over. Of a block that is too short for that,
// most is to count all the same.
nanoseconds settle_of(const PageReading& page, nanoseconds block) {
    nanoseconds longest{0};
    for (const ChainReading& chain : page.chains)
        longest = std::max({longest, chain.period, chain.deadline});
    return std::min(longest, block / 4);
}

std::vector<ComparedChain> chains_of(const PageReading& page) {
    std::vector<ComparedChain> chains;
    for (const ChainReading& chain : page.chains)
        chains.push_back({chain.name, 1e-6 * static_cast<double>(chain.deadline.count())});
    return chains;
}

}  // namespace

LiveComparison::LiveComparison(const PageReading& page, const Plan& plan)
    : stem_(page.stem),
      process_(page.process.process),
      first_(page.mode),
      plan_(plan),
      chains_(chains_of(page)),
      blocks_(page.chains.size(), settle_of(page, plan.block)),
      frames_(page),
      random_(plan.seed) {}

bool LiveComparison::look() {
    const auto page = read_page(stem_, monotonic_now());
    if (!page || page->is_over || page->liveness == observe::Liveness::kGone) {
        note_ = "the program has ended";
        return false;
    }
    if (page->mode == abi::StatusMode::kTripped) {
        note_ = "UrgenGo has switched itself off there, for good";
        return false;
    }
    if (!frames_.look(*page, blocks_) && !blocks_.blocks().empty()) blocks_.last().is_broken = true;
    return true;
}

bool LiveComparison::wait_until(nanoseconds end, const std::function<bool()>& must_stop) {
    for (;;) {
        if (must_stop()) {
            note_ = "interrupted";
            return false;
        }
        if (!look()) return false;
        const nanoseconds left = end - monotonic_now();
        if (left.count() <= 0) return true;
        std::this_thread::sleep_for(std::min<nanoseconds>(left, kLookAtPage));
    }
}

bool LiveComparison::switch_to(bool is_b) {
    const auto word = send_command(stem_, is_b ? plan_.b : plan_.a);
    if (!word) {
        note_ = word.error();
        return false;
    }
    switch (wait_for_answer(stem_, *word, kAnswer)) {
        case Answer::kDone:
            return true;
        case Answer::kGone:
            note_ = "the program has ended";
            return false;
        case Answer::kStopped:
            note_ = "the program is stopped";
            return false;
        case Answer::kDeaf:
        case Answer::kLate:
            break;
    }
    note_ = "the program does not answer";
    return false;
}

std::string LiveComparison::run(const std::function<bool()>& must_stop,
                                const std::function<void(double)>& show) {
    if (!wait_until(monotonic_now() + plan_.warm_up, must_stop)) return note_;
    bool is_b = false;
    for (int i = 0; i < plan_.blocks; ++i) {
        show(static_cast<double>(i) / plan_.blocks);
        is_b = i % 2 == 0 ? random_() % 2 == 0 : !is_b;
        if (!switch_to(is_b)) return note_;
        const double cpu_s = cpu_time_of(static_cast<pid_t>(process_)).value_or(0);
        ComparedBlock& block = blocks_.begin(is_b, monotonic_now());
        const bool goes_on = wait_until(block.begin + plan_.block, must_stop);
        block.end = monotonic_now();
        block.cpu_s = cpu_time_of(static_cast<pid_t>(process_)).value_or(0) - cpu_s;
        block.is_broken |= !goes_on;
        if (!goes_on) return note_;
    }
    // Frames that ended just before the last block did.
    look();
    return {};
}

void LiveComparison::restore() const {
    const auto command = first_ == abi::StatusMode::kEnforce   ? abi::ControlCommand::kOn
                         : first_ == abi::StatusMode::kShadow  ? abi::ControlCommand::kShadow
                         : first_ == abi::StatusMode::kObserve ? abi::ControlCommand::kObserve
                                                               : abi::ControlCommand::kOff;
    if (const auto word = send_command(stem_, command))
        (void)wait_for_answer(stem_, *word, kAnswer);
}

std::vector<ComparedRow> LiveComparison::rows() const {
    const bool counts =
        plan_.a != abi::ControlCommand::kOff && plan_.b != abi::ControlCommand::kOff;
    return compare_blocks(blocks_, chains_, counts, plan_.seed);
}

}  // namespace urgengo::cli
