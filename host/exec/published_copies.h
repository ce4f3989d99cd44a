// SPDX-License-Identifier: Apache-2.0
//
// What a task says of its copies to the threads of others that would copy: which are at the copy
// engine. The thread that makes them writes (one at a time), any thread reads; no
// lock. Makes no driver call: the reader brings the question to the driver along.
//
//   comes()  ->  submitted()  ->  reached  ->  over        `comes` is withdrawn if nothing came of
//   it
//
// 1 A copy is published before it is submitted: a later reader does not slip in before it.
// 2 It is not at the engine before its stream has reached it: one that waits behind a kernel delays
//   no other. An event before it tells (none: its stream was found idle).
// 3 It is over when an event behind it says so, or a wait of the program. So that no thread waits
//   for what cannot be seen to end, it counts no longer than a bound from when it was seen reached
//   (sched/copies.h). Without events, or in another context than theirs, it counts for the time
//   that it should take.
// 4 A reader while a place is written may see parts of two copies: what the driver answers then
//   counts only if the version is still the same afterwards. Else there is a newer copy, and that
//   is as good as one that is not over.
// 5 A reader asks about the oldest first: else one could end, and so the next be reached, between
//   the driver's answers about the next and about the one.
// 6 An event is asked for only in its own context, which is current in the asking thread: it cannot
//   go meanwhile, but by a call that the program must not make.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>

#include "host/base/memory_orders.h"
#include "host/exec/progress_marks.h"

namespace urgengo::exec {

using std::chrono::nanoseconds;

class PublishedCopies {
  public:
    /// Copies of one task that are told apart. More are taken for one: the newest goes on.
    static constexpr std::size_t kPlaces = 4;

    struct Events {
        const MarkContext* context = nullptr;  ///< null: only the time tells
        CUevent reached = nullptr;             ///< null: it was, when it was submitted
        CUevent end = nullptr;                 ///< null: only the time tells
    };
    /// One copy, or the part of it that has been submitted.
    struct Ticket {
        std::size_t place = 0;
        std::uint64_t version = 0;  ///< 0: none
    };
    struct Place {
        std::size_t index = 0;
        bool is_shared = false;  ///< the copy before it is not over: this one is taken for its end
    };

    // --- the thread that copies

    void comes(nanoseconds until);
    void nothing_came() { comes_until_ns_.store(0, std::memory_order_release); }
    /// @param context, ask  as of are_at_engine()
    /// @returns a place for the next copy: its events may then be recorded
    template <typename Ask>
    Place take_place(nanoseconds now, const MarkContext* context, Ask&& ask) {
        const auto oldest_that = [&](auto&& is_free) -> Entry* {
            for (std::size_t i = 1; i <= kPlaces; ++i)
                if (Entry& entry = entries_[(newest_ + i) % kPlaces]; is_free(entry)) return &entry;
            return nullptr;
        };
        Entry* entry = oldest_that([&](const Entry& e) { return !e.may_be_at_engine(now); });
        if (!entry && context)
            entry = oldest_that([&](const Entry& e) {
                const CUevent end = e.end.load(std::memory_order_relaxed);
                return end && e.context.load(std::memory_order_relaxed) == context &&
                       ask(end) == CUDA_SUCCESS;
            });
        if (!entry) return {newest_, true};
        entry->version.store(0, std::memory_order_relaxed);
        return {static_cast<std::size_t>(entry - entries_.data()), false};
    }
    /// @param events  with Place::is_shared, `reached` is not looked at
    /// @param time    that it should take, with what may be before it at the engine
    Ticket submitted(const Place& place, const Events& events, nanoseconds now, nanoseconds time);
    /// This event was seen to be over, and is about to be used again.
    void seen(CUevent end);

    // --- any thread

    /// That copy is over, unless it has gone on since.
    /// @param and_before  so are those before it
    void over(const Ticket& ticket, bool and_before);
    /// @returns whether are_at_engine() is worth asking
    bool may_be_any(nanoseconds now) const;
    /// @param context  the calling thread's; null: none is known
    /// @param ask      (CUevent) -> CUresult, as cuEventQuery answers
    template <typename Ask>
    bool are_at_engine(nanoseconds now, const MarkContext* context, Ask&& ask) {
        // In this order: what came of it is published before it is withdrawn.
        if (comes_until_ns_.load(std::memory_order_acquire) > now.count()) return true;
        std::uint64_t version = 0;
        for (std::size_t i = 0; i < kPlaces; ++i) {
            Entry* entry = oldest_since(version);
            if (!entry) return false;
            if (is_at_engine(*entry, now, context, ask)) return true;
        }
        return false;
    }

  private:
    struct alignas(64) Entry {
        std::atomic<std::uint64_t> version{0};  ///< 0: nothing here, or just being written
        std::atomic<std::uint64_t> over{0};     ///< the version that was seen to be
        std::atomic<std::int64_t> submitted_ns{0}, time_ns{0};
        std::atomic<std::int64_t> reached_ns{0};  ///< or submitted, if later; 0: not seen to be
        std::atomic<const MarkContext*> context{nullptr};
        std::atomic<CUevent> reached{nullptr}, end{nullptr};

        bool may_be_at_engine(nanoseconds now) const;
        /// All that can be said of it without events.
        bool should_run(nanoseconds now) const;
        bool is_within_bound(nanoseconds now, nanoseconds reached) const;
    };

    /// @param[in,out] version  of the last one, and of the one that is found
    /// @returns the oldest that is newer, but for those that were seen to be over; null: none is
    Entry* oldest_since(std::uint64_t& version);

    template <typename Ask>
    static bool is_at_engine(Entry& entry, nanoseconds now, const MarkContext* context, Ask&& ask) {
        const std::uint64_t version = entry.version.load(kAcquire);
        if (version == 0 || version == entry.over.load(kAcquire)) return false;
        const CUevent end = entry.end.load(kAcquire), begin = entry.reached.load(kAcquire);
        if (!end || !context || entry.context.load(kAcquire) != context)
            return entry.should_run(now);
        nanoseconds reached(entry.reached_ns.load(kAcquire));
        if (reached.count() == 0) {
            const CUresult result = ask(begin);
            if (result == CUDA_ERROR_NOT_READY) return false;
            if (result != CUDA_SUCCESS) return entry.should_run(now);
            if (entry.version.load(kAcquire) != version) return true;  // of the copy before
            std::int64_t none = 0;
            if (entry.reached_ns.compare_exchange_strong(none, now.count()))
                reached = now;
            else
                reached = nanoseconds(none);
        }
        if (!entry.is_within_bound(now, reached)) return false;
        const CUresult result = ask(end);
        if (result == CUDA_ERROR_NOT_READY) return true;
        if (result != CUDA_SUCCESS) return entry.should_run(now);
        if (entry.version.load(kAcquire) != version) return true;
        entry.over.store(version, std::memory_order_release);
        return false;
    }

    std::atomic<std::int64_t> comes_until_ns_{0};
    std::array<Entry, kPlaces> entries_;
    std::size_t newest_ = 0;          ///< the writer's
    std::uint64_t last_version_ = 0;  ///< the writer's
};

}  // namespace urgengo::exec
