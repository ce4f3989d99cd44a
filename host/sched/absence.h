// SPDX-License-Identifier: Apache-2.0
//
// Absence: when holding the less urgent may be what keeps the more urgent away.
//
// 1 A program takes locks around its launches. A held thread keeps them, and the thread of a more
//   urgent chain that waits for one cannot even ask. Most locks cannot be seen (but mutexes:
//   lending.h, 4); that a thread does not come when it should can be.
// 2 A chain is *absent* when the first launch of its next frame (a period after the last one's
//   arrival, but not right when a frame of its ends late), or of the one that has arrived, is later
//   than the jitter seen and a margin allow. An instance has *stalled* when its thread should
//   launch and does not: its CPU segment should have ended, or it has nothing on the GPU and has
//   launched nothing for a while.
// 3 Meanwhile urgency is lent: holds of all that are less urgent end, or of the one that is known
// to
//   be waited for (lending.h, 4), and what they launch goes at the lowest priority. For at most a
//   period of the absent chain, and kLongestLoan: then it counts as gone until its next frame
//   comes, so a camera that has stopped disables nothing.
// 4 A frame that comes, or makes its first launch, within kHelps of a loan has waited for what the
//   loan let go of. If it does not, the loan was in vain: the chain is lent nothing for a frame,
//   after the next such loan for three, then for seven and so on, until one helps. A chain whose
//   frames come when they like costs the others a question every 2 ms (task_thread.h).
// 5 Frames are expected a period apart, counted from those that came early: a late one moves the
//   others by kDrift of its delay. The jitter seen is the largest recent delay. One during which a
//   launch waited, or that a loan ended, may be of our making: it teaches nothing while there are
//   others to learn from. (Delays just within what is waited for would make that longer and
//   longer.)
// 6 A launch that is only paced takes no GPU time from a more urgent task: it goes for any chain
//   that is awaited (lending.h, 3).
// 7 What is held keeps no thread away that computes, gets no core or sleeps until a time
//   (task_thread.h). Nothing is lent to it, unless that lasts: it may spin for a lock. (On busy
//   cores, where threads are late, each loan let a whole frame of the less urgent in at once.)
//
// `Jitter` and `Expectation` are written by the thread that tells of a frame and read by all that
// are held; a race costs a loan too many or too few. Pure but for that: time is an argument.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <optional>

#include "host/model/slot_view.h"

namespace urgengo::sched {

using std::chrono::nanoseconds;

/// Beyond the jitter seen, a frame is waited for so much longer; at least:
inline constexpr nanoseconds kAbsenceMargin{1'000'000};
/// And this part of the period.
inline constexpr int kMarginOfPeriod = 64;
inline constexpr nanoseconds kLongestLoan{100'000'000};
/// So soon after a loan begins its frame comes, if that helps.
inline constexpr nanoseconds kHelps{3'000'000};

constexpr nanoseconds absence_margin(nanoseconds period) {
    return std::max(kAbsenceMargin, period / kMarginOfPeriod);
}

/// A CPU segment's delay may be a wait for a held thread: it counts for one in so many.
inline constexpr int kShareOfDelay = 4;

/// The largest recent delay: forgets a sixty-fourth of it at each that is smaller.
class Jitter {
  public:
    nanoseconds seen() const { return nanoseconds(seen_ns_.load(std::memory_order_relaxed)); }
    /// @param share  of what it is larger by than any, it counts for one in so many
    void saw(nanoseconds delay, int share) {
        std::int64_t seen_ns = seen_ns_.load(std::memory_order_relaxed);
        if (delay.count() > seen_ns)
            seen_ns += (delay.count() - seen_ns) / share;
        else
            seen_ns -= seen_ns / 64;
        seen_ns_.store(seen_ns, std::memory_order_relaxed);
    }

  private:
    std::atomic<std::int64_t> seen_ns_{0};
};

/// A launch that is only paced, by its own work on the GPU, goes so much later than held ones: what
/// these are held for may be all that was missing, and it would be before them on the GPU.
inline constexpr nanoseconds kPacedLater{1'000'000};

/// For a thread that goes on by itself (7), so much later.
inline constexpr nanoseconds kByItselfLater{10'000'000};

/// In a GPU segment threads launch one after the other: a pause of this is no pace.
inline constexpr nanoseconds kStall{300'000};
/// A task whose launching others slow down waits for its turn at what they share, as it should.
inline constexpr nanoseconds kStallAmongSlow{3'000'000};

/// A chain or task whose launch should have come: urgency is lent from `since` to `until`.
struct Awaited {
    nanoseconds since{0}, until{0};
    nanoseconds deadline{0};  ///< of its instance, as far as is known
    // Neither counts where the thread is known to wait for a mutex (lending.h, 4).
    nanoseconds patience{0};  ///< of `since`: the jitter seen and the margin
    bool rests = false;       ///< nothing is lent to this frame, after loans in vain
};

/// @returns whether a held task with this deadline should go, for the awaited one
constexpr bool is_lent(const Awaited& awaited, nanoseconds held_deadline, nanoseconds now) {
    return awaited.since <= now && now < awaited.until && awaited.deadline < held_deadline;
}

/// When a chain's next first launch should come.
class Expectation {
  public:
    /// A frame has arrived. One that is told of out of order says nothing of when the next is due.
    /// @param waited  when a launch of any chain waited last
    /// @returns whether it started late: beyond when it was due, the jitter seen and the margin
    bool arrived(nanoseconds arrival, nanoseconds period, nanoseconds waited = nanoseconds{0}) {
        const nanoseconds last(arrival_ns_.load(kRelaxed)), due = due_after(period);
        if (arrival < last) return false;
        const nanoseconds delay = arrival - due;
        arrival_ns_.store(arrival.count(), kRelaxed);
        const bool is_first = last.count() == 0;
        // Frames were left out, or the first one: counted anew.
        const bool is_anew = is_first || delay >= period;
        due_ns_.store((is_anew || delay.count() < 0 ? arrival : due + delay / kDrift).count(),
                      kRelaxed);
        const bool is_late = !is_first && delay > jitter_.seen() + absence_margin(period);
        const nanoseconds lent_at(lent_at_ns_.exchange(0, kRelaxed));
        const bool was_lent = lent_at.count() != 0, helped = arrival - lent_at <= kHelps;
        if (was_lent)
            learn_from_loan(helped);
        else if (const auto rests = rests_.load(kRelaxed); rests > 0)
            rests_.store(static_cast<std::uint16_t>(rests - 1), kRelaxed);
        if (!is_anew && !(was_lent && helped) && teaches(waited < due))
            jitter_.saw(std::max(delay, nanoseconds{0}), 1);
        return is_late;
    }

    /// The frame that arrived then has made its first launch, or never will.
    void launched(nanoseconds arrival, nanoseconds now) {
        if (arrival.count() > launched_ns_.load(kRelaxed))
            launched_ns_.store(arrival.count(), kRelaxed);
        const nanoseconds lent_at(lent_at_ns_.exchange(0, kRelaxed));
        // The next arrival takes one off, before anything is lent to that frame.
        if (lent_at.count() != 0) learn_from_loan(now - lent_at <= kHelps, 1);
    }

    /// A frame of its has ended: until then its thread could not come to the next one.
    void ended(nanoseconds now) { ended_ns_.store(now.count(), kRelaxed); }

    /// A held launch goes, for the sake of the awaited frame.
    void lend(nanoseconds now) {
        std::int64_t none = 0;
        lent_at_ns_.compare_exchange_strong(none, now.count(), kRelaxed);
    }

    /// @param cpu  of its frames, before their first launch
    /// @returns the frame whose first launch is to come; nothing while that is not known
    std::optional<Awaited> awaited(nanoseconds period, nanoseconds deadline,
                                   nanoseconds cpu) const {
        const nanoseconds last(arrival_ns_.load(kRelaxed));
        if (last.count() == 0) return std::nullopt;
        const bool has_launched = launched_ns_.load(kRelaxed) >= last.count();
        const nanoseconds arrival = has_launched ? due_after(period) : last;
        const nanoseconds can_come = std::max(arrival, nanoseconds(ended_ns_.load(kRelaxed)));
        const nanoseconds patience = jitter_.seen() + absence_margin(period);
        const nanoseconds since = can_come + cpu + patience;
        return Awaited{since, since + longest_loan(period), arrival + deadline, patience,
                       rests_.load(kRelaxed) > 0};
    }

    nanoseconds jitter() const { return jitter_.seen(); }

    static constexpr nanoseconds longest_loan(nanoseconds period) {
        return std::min(period, kLongestLoan);
    }

  private:
    static constexpr auto kRelaxed = std::memory_order_relaxed;
    static constexpr int kMostInVain = 6;
    static constexpr int kDrift = 4;
    /// Frames without a clean one, to which others count: two for each clean one, so many at most.
    static constexpr int kMostUnclean = 16;

    nanoseconds due_after(nanoseconds period) const {
        return nanoseconds(due_ns_.load(kRelaxed)) + period;
    }

    /// @param is_clean  no launch has waited since the frame was due
    bool teaches(bool is_clean) {
        const int known = clean_.load(kRelaxed);
        clean_.store(static_cast<std::uint16_t>(is_clean ? std::min(known + 2, kMostUnclean)
                                                         : std::max(known - 1, 0)),
                     kRelaxed);
        return is_clean || known == 0;
    }

    void learn_from_loan(bool helped, int more = 0) {
        const int in_vain = helped ? 0 : std::min(in_vain_.load(kRelaxed) + 1, kMostInVain);
        in_vain_.store(static_cast<std::uint16_t>(in_vain), kRelaxed);
        const int rests = helped ? 0 : (1 << in_vain) - 1 + more;
        rests_.store(static_cast<std::uint16_t>(rests), kRelaxed);
    }

    std::atomic<std::int64_t> arrival_ns_{0};   ///< of the last frame; 0: none yet
    std::atomic<std::int64_t> due_ns_{0};       ///< when it was due, as is counted
    std::atomic<std::int64_t> launched_ns_{0};  ///< arrival of the last one that has launched
    std::atomic<std::int64_t> ended_ns_{0};     ///< when a frame ended last
    std::atomic<std::int64_t> lent_at_ns_{0};   ///< first, since the last frame; 0: not
    std::atomic<std::uint16_t> in_vain_{0};     ///< loans in a row
    std::atomic<std::uint16_t> rests_{0};       ///< frames that are lent nothing
    std::atomic<std::uint16_t> clean_{0};       ///< teaches()
    Jitter jitter_;
};

/// @param view    the slot as it was read at `now`
/// @param jitter  of the task's CPU segments
/// @returns since when an instance has stalled; nothing if it is not under way, is held, or the GPU
///          is at its work
/// @threads any
std::optional<Awaited> stalled(const abi::TaskSlot& slot, const model::SlotView& view,
                               nanoseconds jitter);

}  // namespace urgengo::sched
