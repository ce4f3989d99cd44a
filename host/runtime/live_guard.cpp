// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/live_guard.h"

#include <fmt/format.h>

#include "host/base/log.h"
#include "host/base/own_log.h"

namespace urgengo::runtime {
namespace {

std::vector<std::chrono::nanoseconds> periods_of(const config::Config& config) {
    std::vector<std::chrono::nanoseconds> periods;
    for (const config::Chain& chain : config.chains) periods.push_back(chain.period);
    return periods;
}

bool schedules(const config::Scheduler& scheduler) {
    return scheduler.admission != config::Admission::kNone ||
           scheduler.binding != config::Binding::kNone;
}

}  // namespace

LiveGuard::LiveGuard(const config::Config& config)
    : is_on_(config.scheduler.guard && schedules(config.scheduler)),
      guard_(periods_of(config)),
      contradicts_(config.chains.size()),
      modes_(config.chains.size()) {
    for (const config::Chain& chain : config.chains) {
        names_.push_back(chain.name);
        deadlines_.push_back(chain.deadline);
    }
}

void LiveGuard::frame_began(std::size_t chain, std::chrono::nanoseconds arrival) {
    if (!is_on_) return;
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock.owns_lock()) return;
    pause_if_asked();
    guard_.frame_began(chain, arrival, deadlines_[chain]);
}

bool LiveGuard::frame_ended(std::size_t chain, std::chrono::nanoseconds latency,
                            const Surroundings& surroundings, std::chrono::nanoseconds now) {
    if (!is_on_) return false;
    std::string line;
    bool changed = false;
    {
        const std::unique_lock lock(mutex_, std::try_to_lock);
        if (!lock.owns_lock()) return false;
        pause_if_asked();
        changed = guard_.bystanders_are_busy(surroundings.beside_bystander);
        guard_.nobody_is_held(surroundings.nobody_is_held);
        changed |= guard_.frame_ended(chain, latency, deadlines_[chain], now);
        if (changed) publish();
        if (changed && own_log().tells(LogDetail::kInfo)) note_modes();
        // Not while it may still give some of them back.
        if (!has_said_ && guard_.num_fallen() > 0 && !guard_.is_comparing()) {
            has_said_ = true;
            line = say();
        }
    }
    if (!line.empty()) log_line(line);
    return changed;
}

// The thread that has the mutex now, or next, does it. No thread waits for the mutex.
void LiveGuard::pause() {
    must_pause_.store(true, std::memory_order_relaxed);
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (lock.owns_lock()) pause_if_asked();
}

void LiveGuard::pause_if_asked() {
    if (must_pause_.exchange(false, std::memory_order_relaxed) && guard_.pause()) publish();
}

void LiveGuard::publish() {
    for (std::size_t i = 0; i < modes_.size(); ++i) {
        const sched::GuardMode mode = guard_.mode(i);
        if (modes_[i].exchange(mode, std::memory_order_relaxed) != mode && told_) told_(i, mode);
    }
}

void LiveGuard::note_modes() const {
    for (std::size_t i = 0; i < names_.size(); ++i)
        if (guard_.mode(i) != sched::GuardMode::kEnforce)
            note(LogDetail::kInfo, "guard: chain '{}' gets {}", names_[i],
                 sched::to_word(guard_.mode(i)));
    note(LogDetail::kInfo, "guard: {}{}", guard_.summary(),
         guard_.is_comparing() ? " (comparing)" : "");
}

std::string LiveGuard::say() const {
    std::string text = "guard: " + guard_.summary();
    std::string fallen;
    for (std::size_t i = 0; i < names_.size(); ++i) {
        const sched::GuardedChain& chain = guard_.settled(i);
        if (chain.mode == sched::GuardMode::kEnforce) continue;
        fallen += fmt::format("{}'{}' to {}", fallen.empty() ? "" : ", ", names_[i],
                              sched::to_word(chain.mode));
    }
    return fallen.empty() ? text : text + ": " + fallen;
}

// The thread that reloads waits for those of the program, which never wait for it.
void LiveGuard::describe(std::size_t chain, std::chrono::nanoseconds period,
                         std::chrono::nanoseconds deadline) {
    const std::lock_guard lock(mutex_);
    guard_.describe(chain, period);
    deadlines_[chain] = deadline;
}

void LiveGuard::estimates_contradict(std::size_t chain, bool they_do) {
    if (contradicts_[chain].load(std::memory_order_relaxed) == they_do) return;
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock.owns_lock()) return;  // the next frame tells it
    guard_.estimates_contradict(chain, they_do);
    contradicts_[chain].store(they_do, std::memory_order_relaxed);
}

std::vector<const char*> LiveGuard::words() {
    std::vector<const char*> words(names_.size(), "off");
    const std::unique_lock lock(mutex_, std::try_to_lock);
    for (std::size_t i = 0; is_on_ && lock.owns_lock() && i < words.size(); ++i)
        words[i] = sched::to_word(guard_.settled(i).mode);
    return words;
}

std::vector<sched::GuardedChain> LiveGuard::found() {
    std::vector<sched::GuardedChain> found(names_.size());
    const std::unique_lock lock(mutex_, std::try_to_lock);
    for (std::size_t i = 0; is_on_ && lock.owns_lock() && i < found.size(); ++i)
        found[i] = guard_.settled(i);
    return found;
}

std::string LiveGuard::summary() {
    const std::unique_lock lock(mutex_, std::try_to_lock);
    const bool has_compared = is_on_ && lock.owns_lock() && guard_.num_comparisons() > 0;
    return has_compared ? say() : std::string();
}

bool LiveGuard::has_fallen_back() {
    const std::unique_lock lock(mutex_, std::try_to_lock);
    return lock.owns_lock() && guard_.num_fallen() > 0;
}

}  // namespace urgengo::runtime
