// SPDX-License-Identifier: Apache-2.0
//
// All tasks and chains of the config, and what a look at one of them tells: its slot, how far the
// GPU is, and what only its record says.
//
// A look may be the first to see a mark executed. When that was, decisions do not know, as they ask
// no clock: the listener is told at once.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "host/config/config.h"
#include "host/model/task_set.h"
#include "host/sched/governed.h"

namespace urgengo::sched {

struct PackLimits;

/// From the time that a mark writes to the host that sees it.
inline constexpr nanoseconds kMarkVisible{2'000};

class ProgressListener {
  public:
    /// A look was the first to see the task's last executed mark.
    /// @param view  what the look saw
    /// @param pending  when it was seen not to be; 0: not known
    /// @threads the one that looks
    virtual void progressed(GovernedTask& task, const SlotView& view, const ug_mark_line& line,
                            nanoseconds pending) = 0;

  protected:
    ~ProgressListener() = default;
};

class Tasks {
  public:
    /// @param all of them  outlive it
    Tasks(const config::Scheduler& scheduler, abi::SharedPage& page, ProgressListener& listener)
        : page_(page),
          listener_(listener),
          slowed_share_(scheduler.packing.launchers > 0 &&
                                scheduler.admission == config::Admission::kPacked
                            ? 1.0 / scheduler.packing.launchers
                            : 0) {}
    // At first, in the order of their indices:
    void add(GovernedChain& chain) { chains_.push_back(&chain); }
    void add(GovernedTask& task) { tasks_.push_back(&task); }

    GovernedTask& operator[](int index) const { return *tasks_[static_cast<std::size_t>(index)]; }
    /// @param index  of a task, or what is none
    /// @returns index of its chain, or -1
    int chain_of(int index) const {
        return index >= 0 && index < static_cast<int>(tasks_.size())
                   ? static_cast<int>((*this)[index].chain->index)
                   : -1;
    }
    const std::vector<GovernedTask*>& all() const { return tasks_; }
    const std::vector<GovernedChain*>& chains() const { return chains_; }

    /// Calls act(GovernedTask&) for each task that may work on an instance.
    template <typename Act>
    void for_each_active(Act&& act) const {
        for (std::size_t i = 0; i < abi::kTaskWords; ++i)
            for (std::uint64_t bits = page_.active[i].load(std::memory_order_relaxed); bits != 0;
                 bits &= bits - 1)
                act(*tasks_[64 * i + static_cast<std::size_t>(__builtin_ctzll(bits))]);
    }

    /// Whether it may work on an instance.
    void set_active(const GovernedTask& task, bool active) const {
        auto& word = page_.active[model::TaskSet::word_of(task.index)];
        const std::uint64_t bit = model::TaskSet::bit_of(task.index);
        if (active)
            word.fetch_or(bit, std::memory_order_relaxed);
        else
            word.fetch_and(~bit, std::memory_order_relaxed);
    }

    /// @param line  what the task's marks write; null before any could be issued
    SlotView look(GovernedTask& task, const ug_mark_line* line, nanoseconds now) const {
        // Before the look: afterwards it may be about the next mark.
        const nanoseconds pending(task.pending_ns.load(std::memory_order_acquire));
        SlotView view = model::read_slot(*task.slot, line, task.index, now);
        view.launching.share = launch_share(view.launching.slowed);
        if (view.ahead.progressed) listener_.progressed(task, view, *line, pending);
        // Not at every look of every thread: the cache line is read by all.
        if (view.ahead.pending && now - pending >= kMarkVisible)
            task.pending_ns.store(now.count(), std::memory_order_release);
        return view;
    }
    SlotView look(GovernedTask& task, nanoseconds now) const {
        return look(task, task.line.load(std::memory_order_acquire), now);
    }

    /// @returns what a task takes of the turns at launching; 0: nothing
    double launch_share(model::Launching verdict) const {
        return verdict == model::Launching::kSlowed ? slowed_share_ : 0;
    }

    std::uint32_t changes(std::memory_order order = std::memory_order_relaxed) const {
        return page_.changes.load(order);
    }
    /// To the dispatcher (dispatch_round.h).
    void publish(const Plan& plan, const PackLimits& limits) const;
    /// Launches that need no asking are asked about again.
    /// @returns SharedPage::changes before that
    std::uint32_t changed() const { return page_.changes.fetch_add(1, std::memory_order_release); }

  private:
    abi::SharedPage& page_;
    ProgressListener& listener_;
    const double slowed_share_;
    std::vector<GovernedTask*> tasks_;
    std::vector<GovernedChain*> chains_;
};

/// As the slot has it now.
inline abi::TaskState state_of(const GovernedTask& task) {
    return task.slot->state.load(std::memory_order_relaxed);
}
inline bool may_be_on_gpu(const GovernedTask& task) {
    const abi::TaskState state = state_of(task);
    return state != abi::TaskState::kIdle && state != abi::TaskState::kCpu;
}

}  // namespace urgengo::sched
