// SPDX-License-Identifier: Apache-2.0
//
// What the call at hand of the calling thread has spent where, for builds that measure our own time
// (interposer/own_time.h). In all others these spans are nothing.
#pragma once

#ifdef URGENGO_MEASURE_OWN_TIME
#include <x86intrin.h>

#include <cstdint>
#endif

namespace urgengo::own_time {

#ifdef URGENGO_MEASURE_OWN_TIME

inline std::uint64_t ticks() {
    return __rdtsc();
}

/// In ticks, of one call. `polling` is in `held`; the others do not overlap.
struct Spent {
    std::uint64_t in_driver = 0;      ///< the program's own call
    std::uint64_t in_our_driver = 0;  ///< driver calls of ours
    std::uint64_t deciding = 0;       ///< the order, and whether this launch may go
    std::uint64_t held = 0;           ///< asleep, with looks now and then
    std::uint64_t polling = 0;        ///< those looks
    std::uint32_t decisions = 0;      ///< but for those
    std::uint32_t reads = 0;          ///< of the counter, that are in none of the above
};

inline thread_local Spent t_spent __attribute__((tls_model("initial-exec")));
inline thread_local bool t_is_held __attribute__((tls_model("initial-exec"))) = false;

/// Adds its life to a sum.
class Span {
  public:
    explicit Span(std::uint64_t& sum) : sum_(sum) {}
    ~Span() {
        sum_ += ticks() - begin_;
        ++t_spent.reads;
    }
    Span(const Span&) = delete;
    Span& operator=(const Span&) = delete;

  private:
    std::uint64_t& sum_;
    const std::uint64_t begin_ = ticks();
};

/// A driver call of ours. While held, it is part of the hold.
class InOurDriver {
  public:
    ~InOurDriver() {
        if (t_is_held) return;
        const std::uint64_t time = ticks() - begin_;
        t_spent.in_our_driver += time;
        t_spent.deciding -= is_deciding_ ? time : 0;
        ++t_spent.reads;
    }
    static inline thread_local bool t_deciding __attribute__((tls_model("initial-exec"))) = false;

  private:
    const bool is_deciding_ = t_deciding;
    const std::uint64_t begin_ = ticks();
};

/// A look at all tasks, and the decision.
class Deciding {
  public:
    Deciding() { InOurDriver::t_deciding = true; }
    ~Deciding() {
        const std::uint64_t time = ticks() - begin_;
        InOurDriver::t_deciding = false;
        if (t_is_held) {
            t_spent.polling += time;
            return;
        }
        t_spent.deciding += time;
        ++t_spent.decisions;
        ++t_spent.reads;
    }
    Deciding(const Deciding&) = delete;
    Deciding& operator=(const Deciding&) = delete;

  private:
    const std::uint64_t begin_ = ticks();
};

/// From the first sleep of a held launch to its last look.
class Held {
  public:
    Held() { t_is_held = true; }
    ~Held() {
        t_spent.held += ticks() - begin_;
        t_is_held = false;
        ++t_spent.reads;
    }
    Held(const Held&) = delete;
    Held& operator=(const Held&) = delete;

  private:
    const std::uint64_t begin_ = ticks();
};

#else

struct Deciding {
    ~Deciding() {}  // not trivial, so that no compiler warns of an unused variable
};
struct Held {
    ~Held() {}
};

#endif

}  // namespace urgengo::own_time
