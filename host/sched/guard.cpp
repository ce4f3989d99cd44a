// SPDX-License-Identifier: Apache-2.0
#include "host/sched/guard.h"

#include <algorithm>
#include <cstdio>
#include <utility>

namespace urgengo::sched {
namespace {

using namespace std::chrono_literals;

constexpr nanoseconds kLongestWait = 600s;
/// What is compared earlier may be of a program that is not warm yet.
constexpr nanoseconds kWarmUp = 4s;

/// Lateness of so much more than at the last verdict is another program's.
constexpr double kChangedFactor = 2, kChangedBy = 0.15;
constexpr nanoseconds kChangedAfter = 5s;

/// A few chains that gained so much of all gain are taken for all that gain.
constexpr double kNearlyAll = 0.8;
/// A chain so much later than four times the others' mean suffers alone.
constexpr double kSuffers = 0.1, kTimesOthers = 4;

}  // namespace

Guard::Guard(const std::vector<nanoseconds>& periods)
    : watch_(periods), settled_(periods.size()), now_(periods.size(), GuardMode::kEnforce) {}

void Guard::frame_began(std::size_t chain, nanoseconds arrival, nanoseconds deadline) {
    if (comparison_) comparison_->frame_began(chain, arrival, deadline);
}

bool Guard::bystanders_are_busy(bool they_are) {
    if (they_are == beside_bystander_) return false;
    beside_bystander_ = they_are;
    windows_ = {};
    bool observes = false;
    for (std::size_t i = 0; comparison_ && i < settled_.size(); ++i)
        observes |= std::max(settled_[i].mode, trial_.other[i]) == GuardMode::kObserve;
    if (observes) comparison_.reset();  // it would go on as one of something else
    return apply();
}

bool Guard::frame_ended(std::size_t chain, nanoseconds latency, nanoseconds deadline,
                        nanoseconds now) {
    if (!comparison_ || !comparison_->other_is_on()) {
        const double ratio = ratio_of(latency, deadline);
        watch_.frame_ended(chain, ratio, now);
        if (!watch_.is_starting_up(now)) {
            if (windows_.is_over(now)) windows_.next(now, watch_.window());
            windows_.add(lateness_of(ratio));
        }
    } else {
        windows_.skip(now);
    }
    if (!comparison_) return explore(now) && apply();
    if (trial_.aim == Aim::kLessForAll &&
        kChangedFactor * watch_.level() + kChangedBy < trial_.level_at_begin) {
        // The program has warmed up meanwhile: what was seen is of another one.
        comparison_.reset();
        windows_ = {};
        return apply();
    }
    const Verdict verdict = comparison_->frame_ended(chain, now - latency, deadline, now);
    if (verdict != Verdict::kOpen) conclude(verdict, now);
    return apply();
}

bool Guard::pause() {
    comparison_.reset();
    bool changed = false;
    for (std::size_t i = 0; i < now_.size(); ++i) {  // allocates nothing
        const GuardMode mode = std::min(settled_[i].mode, least());
        changed |= now_[i] != mode;
        now_[i] = mode;
    }
    return changed;
}

std::size_t Guard::num_fallen() const {
    return static_cast<std::size_t>(std::ranges::count_if(
        settled_, [](const GuardedChain& c) { return c.mode != GuardMode::kEnforce; }));
}

std::string Guard::summary() const {
    if (num_comparisons_ == 0) return {};
    double before = 0, after = 0;
    for (const GuardedChain& c : settled_) {
        if (c.mode == GuardMode::kEnforce) continue;
        before += c.before;
        after += c.after;
    }
    const auto fallen = num_fallen();
    char text[200];
    if (fallen == 0)
        std::snprintf(text, sizeof text, "scheduling was compared with doing less %zu times, %s",
                      num_comparisons_,
                      num_fallbacks_ == 0 ? "and was not worse" : "and is no longer worse");
    else
        std::snprintf(text, sizeof text,
                      "scheduling made frames of this program later: %zu of %zu chains fell back "
                      "(their mean lateness: %.2f with it, %.2f without)",
                      fallen, settled_.size(), before / static_cast<double>(fallen),
                      after / static_cast<double>(fallen));
    return text;
}

// --- exploring

bool Guard::wants_less(nanoseconds now) const {
    if (now < less_.after || !watch_.pays_for_comparison(now)) return false;
    return std::ranges::any_of(settled_,
                               [this](const GuardedChain& c) { return c.mode < least(); });
}

bool Guard::explore(nanoseconds now) {
    const bool has_changed = verdict_.at.count() > 0 && now - verdict_.at > kChangedAfter &&
                             watch_.level() > kChangedFactor * verdict_.level + kChangedBy;
    if (has_changed) {
        less_.wait = kShortWait;
        back_.wait = kFirstWait;
        less_.after = back_.after = nanoseconds{0};
        verdict_.level = watch_.level();
        windows_ = {};
    }
    if (num_fallen() > 0 && now >= back_.after) {
        std::vector<GuardMode> other = settled_modes();
        const bool by_steps =
            failed_returns_ % 2 == 1 && std::count(other.begin(), other.end(), GuardMode::kObserve);
        for (GuardMode& mode : other)
            mode = std::min(mode, by_steps ? GuardMode::kPriorities : GuardMode::kEnforce);
        begin(Aim::kBackForAll, std::move(other), Comparison::kAllChains, now);
        return true;
    }
    if (!wants_less(now)) return false;
    std::vector<GuardMode> other = settled_modes();
    const bool some_enforced = std::count(other.begin(), other.end(), GuardMode::kEnforce) > 0;
    const bool by_steps = some_enforced && !nobody_is_held_;
    const GuardMode less = by_steps ? GuardMode::kPriorities : least();
    for (GuardMode& mode : other) mode = std::max(mode, less);
    begin(Aim::kLessForAll, std::move(other), Comparison::kAllChains, now);
    return true;
}

// --- comparing

void Guard::begin(Aim aim, std::vector<GuardMode> other, int subject, nanoseconds now) {
    trial_ = {aim, subject, std::move(other), now, watch_.level()};
    const nanoseconds length = watch_.window();
    const auto in_a_row = static_cast<std::size_t>(LatenessWatch::kLongestWindow / length);
    const bool other_is_less = aim == Aim::kLessForAll || aim == Aim::kLessForOne;
    if (windows_.are_uneven())
        comparison_.emplace(settled_.size(), subject, LatenessWatch::kLongestWindow, now,
                            other_is_less, windows_.worst(in_a_row));
    else
        comparison_.emplace(settled_.size(), subject, length, now, other_is_less);
    ++num_comparisons_;
}

void Guard::conclude(Verdict verdict, nanoseconds now) {
    const Comparison of = *std::exchange(comparison_, std::nullopt);
    watch_.spend();
    verdict_.at = now;
    verdict_.level = of.usual();
    for (std::size_t i = 0; i < settled_.size(); ++i) {
        const Finding finding = of.finding(i);
        if (finding.pairs == 0) continue;
        settled_[i].last = finding;
        settled_[i].compared = trial_.other[i];
    }
    switch (trial_.aim) {
        case Aim::kLessForAll:
            return concluded_less_for_all(verdict, of, now);
        case Aim::kLessForOne:
            return concluded_less_for_one(verdict, of, now);
        case Aim::kBackForMost:
            if (verdict != Verdict::kWorse) settle(of);
            return;
        case Aim::kBackForAll:
            break;
    }
    bool some_lose = false;
    for (std::size_t i = 0; i < settled_.size(); ++i) some_lose = some_lose || of.loses(i);
    if (verdict == Verdict::kWorse || some_lose) {
        ++failed_returns_;
        back_.wait = std::min(2 * back_.wait, kLongestWait);
    } else {
        settle(of);
        less_.wait = kShortWait;
        less_.after = now;
    }
    back_.after = now + back_.wait;
}

void Guard::concluded_less_for_all(Verdict verdict, const Comparison& of, nanoseconds now) {
    if (verdict == Verdict::kBetter) {
        const std::vector<GuardMode> before = settled_modes();
        const std::vector<bool> few = few_that_gain(of);
        settle(of);
        ++num_fallbacks_;
        back_.after = now + back_.wait;
        less_.after =
            now + (few.empty() && of.other() >= LatenessWatch::kMuch ? nanoseconds{0} : kFirstWait);
        if (few.empty()) return;
        std::vector<GuardMode> other = settled_modes();
        for (std::size_t i = 0; i < other.size(); ++i)
            if (!few[i]) other[i] = before[i];
        return begin(Aim::kBackForMost, std::move(other), Comparison::kAllChains, now);
    }
    if (const int one = lone_sufferer(of); one != Comparison::kAllChains) {
        std::vector<GuardMode> other = settled_modes();
        GuardMode& its = other[static_cast<std::size_t>(one)];
        const GuardMode tried = trial_.other[static_cast<std::size_t>(one)];
        if (const GuardMode less = its < tried ? tried : least(); its < less) {
            its = less;
            return begin(Aim::kLessForOne, std::move(other), one, now);
        }
    }
    const bool was_priorities =
        std::count(trial_.other.begin(), trial_.other.end(), GuardMode::kPriorities) > 0;
    if (verdict == Verdict::kAlike && was_priorities && least() == GuardMode::kObserve)
        return begin(Aim::kLessForAll,
                     std::vector<GuardMode>(trial_.other.size(), GuardMode::kObserve),
                     Comparison::kAllChains, now);
    wait_longer(verdict, now);
}

void Guard::concluded_less_for_one(Verdict verdict, const Comparison& of, nanoseconds now) {
    const auto one = static_cast<std::size_t>(trial_.subject);
    if (verdict == Verdict::kBetter) {
        settle(of);
        ++num_fallbacks_;
        back_.after = now + back_.wait;
        less_.after = now + kFirstWait;
        if (of.other(one) < LatenessWatch::kMuch || trial_.other[one] >= least()) return;
        std::vector<GuardMode> other = settled_modes();
        other[one] = least();
        return begin(Aim::kLessForOne, std::move(other), trial_.subject, now);
    }
    if (verdict == Verdict::kAlike && trial_.other[one] < least()) {
        std::vector<GuardMode> other = settled_modes();
        other[one] = GuardMode::kObserve;
        return begin(Aim::kLessForOne, std::move(other), trial_.subject, now);
    }
    wait_longer(verdict, now);
}

// Where all are late, the one that gives way to the others is not harmed, but chosen.
int Guard::lone_sufferer(const Comparison& of) const {
    int most = Comparison::kAllChains;
    double sum = 0;
    for (std::size_t i = 0; i < settled_.size(); ++i) {
        sum += of.usual(i);
        const bool first = most == Comparison::kAllChains;
        const bool gains = of.gains(i) || of.usual(i) - of.other(i) >= kSuffers;
        if (gains && (first || of.usual(i) > of.usual(static_cast<std::size_t>(most))))
            most = static_cast<int>(i);
    }
    if (most == Comparison::kAllChains || settled_.size() < 2) return Comparison::kAllChains;
    const double its = of.usual(static_cast<std::size_t>(most));
    const double others = (sum - its) / static_cast<double>(settled_.size() - 1);
    return its >= kSuffers + kTimesOthers * others ? most : Comparison::kAllChains;
}

/// @returns which; empty if many chains gain
std::vector<bool> Guard::few_that_gain(const Comparison& of) const {
    std::vector<bool> few(settled_.size());
    double gain = 0, of_few = 0;
    std::size_t n = 0;
    for (std::size_t i = 0; i < settled_.size(); ++i) {
        const double its = std::max(of.usual(i) - of.other(i), 0.0);
        gain += its;
        if (its < Comparison::kWorthIt || !(of.gains(i) || its >= kSuffers)) continue;
        few[i] = true;
        of_few += its;
        ++n;
    }
    if (2 * n > settled_.size() || of_few < kNearlyAll * gain || n == 0) few.clear();
    return few;
}

/// What was the other way is the usual one from here on.
void Guard::settle(const Comparison& of) {
    for (std::size_t i = 0; i < settled_.size(); ++i) {
        if (settled_[i].mode != trial_.other[i]) {
            settled_[i].mode = trial_.other[i];
            settled_[i].before = of.usual(i);
            settled_[i].after = of.other(i);
        }
        watch_.is_at(i, of.other(i));
    }
    verdict_.level = of.other();
    windows_ = {};
}

void Guard::wait_longer(Verdict verdict, nanoseconds now) {
    if (watch_.running(trial_.began_at) < kWarmUp) {
        less_.after = now + (verdict == Verdict::kWorse ? kFirstWait / 2 : kShortWait);
        return;
    }
    if (verdict == Verdict::kWorse) less_.wait = std::max(less_.wait, 2 * kFirstWait);
    less_.after = now + less_.wait;
    less_.wait = std::min(2 * less_.wait, kLongestWait);
}

std::vector<GuardMode> Guard::settled_modes() const {
    std::vector<GuardMode> modes;
    for (const GuardedChain& c : settled_) modes.push_back(c.mode);
    return modes;
}

bool Guard::apply() {
    std::vector<GuardMode> modes =
        comparison_ && comparison_->other_is_on() ? trial_.other : settled_modes();
    for (GuardMode& mode : modes) mode = std::min(mode, least());
    const bool changed = modes != now_;
    now_ = std::move(modes);
    return changed;
}

}  // namespace urgengo::sched
