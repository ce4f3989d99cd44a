// SPDX-License-Identifier: Apache-2.0
//
// How long calls are in our own hands, inside a real program, whose caches hold other things than a
// benchmark's. Only in a build of the library made for it (target urgengo_interposer_own_time,
// x86-64, lib/urgengo-own-time/libcuda.so.1; or -DURGENGO_MEASURE_OWN_TIME=ON); else there is
// nothing here. At exit the times go into the file of URGENGO_STATS with ".own_time.json" behind
// its name.
//
// A call's time, from the wrapper's begin to its end, is
//
//     the program's own driver call + what we add + held
//
// and of what we add, decisions and driver calls of our own (marks, queries) are known apart
// (host/base/own_time.h). The counter is read some twenty times more often than without measuring:
// what a reading takes by itself is taken off, its effect on what runs beside it is not.
#pragma once

#ifdef URGENGO_MEASURE_OWN_TIME
#include <string>
#include <utility>

#include "host/base/own_time.h"
#include "host/exec/driver_api.h"
#include "interposer/own_time_recorder.h"
#endif

namespace urgengo::interposer {

enum class CallClass { kLaunch, kCopy, kSync, kEvent, kMemory, kOther };

#ifdef URGENGO_MEASURE_OWN_TIME

/// The call at hand, in a wrapper's scope. Not within another one.
class OwnTime {
  public:
    explicit OwnTime(CallClass call) : call_(call) { own_time::t_spent = {}; }
    ~OwnTime() {
        const std::uint64_t ticks = own_time::ticks() - begin_;
        own_time::recorder().add(call_, own_time::t_spent, ticks);
    }
    OwnTime(const OwnTime&) = delete;
    OwnTime& operator=(const OwnTime&) = delete;

    /// The program's own call.
    template <typename Call>
    static auto in_driver(Call&& call) {
        const own_time::Span span(own_time::t_spent.in_driver);
        return std::forward<Call>(call)();
    }

    /// From here on, the calling thread's calls are another frame's.
    static void frame_begins() { own_time::recorder().frame_begins(); }

    /// The driver's functions for our own use, their time measured.
    static const exec::DriverApi& measured(const exec::DriverApi& driver);

    static void write(const std::string& stats);

  private:
    const CallClass call_;
    const std::uint64_t begin_ = own_time::ticks();
};

#else

class OwnTime {
  public:
    explicit OwnTime(CallClass) {}
    ~OwnTime() {}  // not trivial, so that no compiler warns of an unused variable
    template <typename Call>
    static auto in_driver(Call&& call) {
        return call();
    }
    static void frame_begins() {}
    static const auto& measured(const auto& driver) { return driver; }
    static void write(const auto&) {}
};

#endif

}  // namespace urgengo::interposer
