// SPDX-License-Identifier: Apache-2.0
//
// Names that the driver answers are its own, and go with the module or context of the kernel. A
// thread that reads one is waited for before another thread's unloading goes to the driver; while
// that is there, no thread asks.
//
//   reader:   num_reading + 1; is a thread unloading? then no name; read; num_reading - 1
//   unloader: num_unloading + 1; wait until num_reading is 0; call the driver; num_unloading - 1
//
// Both count themselves before they look at the other's count (sequentially consistent), so one of
// them sees the other. A reader never waits. It reads for as long as one question takes; an
// unloader that sees one for longer than kLongestWait (its thread was stopped, say) goes on.
#pragma once

#include <atomic>

#include "host/base/clock.h"

namespace urgengo::identity {

class NameGate {
  public:
    /// @threads any; may be on a launch's path
    class Reading {
      public:
        explicit Reading(NameGate& gate) : gate_(gate) {
            gate_.num_reading_.fetch_add(1);
            may_read_ = gate_.num_unloading_.load() == 0;
        }
        ~Reading() { gate_.num_reading_.fetch_sub(1); }
        Reading(const Reading&) = delete;
        Reading& operator=(const Reading&) = delete;

        /// @returns whether a name that is asked for now stays for as long as this does
        explicit operator bool() const { return may_read_; }

      private:
        NameGate& gate_;
        bool may_read_;
    };

    class Unloading {
      public:
        /// @param gate  null: it does nothing
        explicit Unloading(NameGate* gate) : gate_(gate) {
            if (gate_) gate_->close();
        }
        ~Unloading() {
            if (gate_) gate_->num_unloading_.fetch_sub(1);
        }
        Unloading(const Unloading&) = delete;
        Unloading& operator=(const Unloading&) = delete;

      private:
        NameGate* const gate_;
    };

    /// @returns whether a thread unloads just now
    bool is_closed() const { return num_unloading_.load(std::memory_order_relaxed) != 0; }

  private:
    /// By time, not by turns: a reader that lost its core is waited for as well.
    static constexpr nanoseconds kLongestWait = std::chrono::seconds(1);

    void close();

    std::atomic<int> num_reading_{0}, num_unloading_{0};
};

}  // namespace urgengo::identity
