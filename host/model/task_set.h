// SPDX-License-Identifier: Apache-2.0
//
// Sets of tasks, by their indices: a bit a task, as many as the active kernel buffer has slots.
// Plain values, and one that threads share.
//
// A set that threads share is several words, read and written one by one. A reader may find some
// words of before and others of after a change. That is harmless wherever it is used: every bit
// stands for one task by itself (given up, may share, active), a reader acts on it for
// microseconds, and a change of the set is followed by one of SharedPage::changes, after which all
// threads read it anew. What must hold between a bit and something else is said where it is used.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <initializer_list>

#include "urgengo/abi/shared_page.h"

namespace urgengo::model {

class TaskSet {
  public:
    static constexpr std::size_t kWords = abi::kTaskWords;

    constexpr TaskSet() = default;
    constexpr TaskSet(std::initializer_list<int> tasks) {
        for (const int task : tasks) insert(task);
    }

    /// @param task  any; what is no index of a slot is in no set
    constexpr bool contains(int task) const {
        return is_index(task) && (words_[word_of(task)] & bit_of(task)) != 0;
    }
    constexpr void insert(int task) {
        if (is_index(task)) words_[word_of(task)] |= bit_of(task);
    }
    constexpr void erase(int task) {
        if (is_index(task)) words_[word_of(task)] &= ~bit_of(task);
    }
    constexpr bool is_empty() const { return *this == TaskSet(); }
    constexpr bool operator==(const TaskSet&) const = default;

    /// Those in both.
    constexpr TaskSet operator&(const TaskSet& other) const {
        TaskSet both;
        for (std::size_t i = 0; i < kWords; ++i) both.words_[i] = words_[i] & other.words_[i];
        return both;
    }

    /// Calls act(task) for each, the lowest first.
    template <typename Act>
    constexpr void for_each(Act&& act) const {
        for (std::size_t i = 0; i < kWords; ++i)
            for (std::uint64_t bits = words_[i]; bits != 0; bits &= bits - 1)
                act(static_cast<int>(i * 64) + __builtin_ctzll(bits));
    }

    /// @param words  kWords of them, which threads share
    static TaskSet read_from(const std::atomic<std::uint64_t>* words) {
        TaskSet set;
        for (std::size_t i = 0; i < kWords; ++i)
            set.words_[i] = words[i].load(std::memory_order_relaxed);
        return set;
    }
    void copy_to(std::atomic<std::uint64_t>* words) const {
        for (std::size_t i = 0; i < kWords; ++i)
            words[i].store(words_[i], std::memory_order_relaxed);
    }

    static constexpr bool is_index(int task) { return task >= 0 && task < abi::kMaxTasks; }
    static constexpr std::size_t word_of(int task) { return static_cast<std::size_t>(task) / 64; }
    static constexpr std::uint64_t bit_of(int task) { return std::uint64_t{1} << (task % 64); }

  private:
    friend class SharedTaskSet;
    std::array<std::uint64_t, kWords> words_{};
};

/// Any thread may call all of it.
class SharedTaskSet {
  public:
    TaskSet load(std::memory_order order = std::memory_order_relaxed) const {
        TaskSet set;
        for (std::size_t i = 0; i < TaskSet::kWords; ++i) set.words_[i] = words_[i].load(order);
        return set;
    }
    void store(const TaskSet& set) {
        for (std::size_t i = 0; i < TaskSet::kWords; ++i)
            words_[i].store(set.words_[i], std::memory_order_relaxed);
    }
    // One bit, which others' are not lost by: sequentially consistent.
    bool contains(int task) const {
        return (words_[TaskSet::word_of(task)].load() & TaskSet::bit_of(task)) != 0;
    }
    void insert(int task) { words_[TaskSet::word_of(task)].fetch_or(TaskSet::bit_of(task)); }
    void erase(int task) { words_[TaskSet::word_of(task)].fetch_and(~TaskSet::bit_of(task)); }
    bool is_empty() const { return load(std::memory_order_seq_cst).is_empty(); }

  private:
    std::array<std::atomic<std::uint64_t>, TaskSet::kWords> words_{};
};

}  // namespace urgengo::model
