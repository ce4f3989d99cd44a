// SPDX-License-Identifier: Apache-2.0
#include "host/sched/company.h"

#include <algorithm>

namespace urgengo::sched {
namespace {

constexpr nanoseconds kNoOtherLooksAfter{100'000'000};
constexpr nanoseconds kSolitary{1'000'000'000};
constexpr int kSolitaryPeriods = 2;

nanoseconds solitary_after(const std::vector<config::Chain>& chains) {
    nanoseconds after = kSolitary;
    for (const config::Chain& chain : chains)
        after = std::max(after, kSolitaryPeriods * chain.period);
    return after;
}

}  // namespace

Company::Company(const abi::SharedPage& page, const std::vector<config::Chain>& chains,
                 nanoseconds start)
    : page_(page), shared_at_(start), others_at_(start), solitary_after_(solitary_after(chains)) {}

void Company::describe(const std::vector<config::Chain>& chains) {
    solitary_after_.store(solitary_after(chains), kRelaxed);
}

void Company::came(std::size_t chain, nanoseconds now) {
    const std::size_t last = last_chain_.load(kRelaxed);
    if (last != chain) last_chain_.store(chain, kRelaxed);
    if (last != kNoChain && last != chain) others_at_.store(now, kRelaxed);
    note(now);
}

void Company::note(nanoseconds now) {
    if (is_alone()) return;
    shared_at_.store(now, kRelaxed);
    others_at_.store(now, kRelaxed);
}

void Company::unmarked_begins(nanoseconds now) {
    others_at_.store(now, kRelaxed);
    num_unmarked_.fetch_add(1, kRelaxed);
}

bool Company::no_other_looks(nanoseconds now) const {
    return is_alone() && now - shared_at_.load(kRelaxed) > kNoOtherLooksAfter;
}

bool Company::was_alone_since(nanoseconds begin) const {
    return is_alone() && !has_unmarked() && shared_at_.load(kRelaxed) < begin &&
           others_at_.load(kRelaxed) <= begin;
}

}  // namespace urgengo::sched
