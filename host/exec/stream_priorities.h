// SPDX-License-Identifier: Apache-2.0
//
// Priorities lent to the program's own streams, for launches that cannot carry one: a graph takes
// the priority that its stream has when it is launched (measured, H200: 14.6 ms behind others at
// the stream's own priority, 0.14 ms at the highest; so on the default streams too). Lent for one
// call and given back at once, so that later launches, captures, and the program's questions see
// the program's own value. (A giving back that the driver refuses is remembered: the program's
// questions are answered for it, and the next loan tries again.)
//
// Threads: any. Several may lend to one stream at a time; the last to give back restores. The lock
// is held for the driver's set and get (60 ns each), never while the program's call runs.
#pragma once

#include <atomic>
#include <mutex>
#include <utility>
#include <vector>

#include "host/exec/stream_key.h"

namespace urgengo::exec {

class StreamPriorities {
  public:
    explicit StreamPriorities(const DriverApi& driver) : driver_(driver) {}

    /// @returns whether the stream now has `priority`: then give_back() is due after the launch
    bool lend(CUstream stream, StreamFlavor flavor, int priority);
    void give_back(CUstream stream, StreamFlavor flavor);

    /// @returns the program's own priority of the stream; 0 if the driver does not tell
    int own(CUstream stream, StreamFlavor flavor) const;
    /// Makes the program's call that asks for the stream's priority while no thread lends or gives
    /// back, and tells what it should have seen.
    /// @param call  () -> CUresult
    /// @param lent  (int own): the stream is lent another priority than its own
    template <typename Call, typename Lent>
    CUresult ask(CUstream stream, StreamFlavor flavor, Call&& call, Lent&& lent) const {
        if (!ever_lent_.load()) [[likely]]
            return call();
        const StreamKey key = stream_key(driver_, stream, flavor);
        const std::lock_guard lock(mutex_);
        const CUresult result = call();
        if (const Loan* loan = find(key); loan && result == CUDA_SUCCESS) lent(loan->own);
        return result;
    }
    /// Makes the program's call that sets the priority of `stream`, by itself or from `from`'s,
    /// while no thread lends or gives back: what is set then is what the stream gets back.
    template <typename Call>
    CUresult set_by_program(CUstream stream, CUstream from, StreamFlavor flavor, Call&& call) {
        if (!ever_lent_.load()) [[likely]]
            return call();
        const StreamKey key = stream_key(driver_, stream, flavor);
        const StreamKey from_key = stream_key(driver_, from, flavor);
        const std::lock_guard lock(mutex_);
        if (const Loan* loan = find(from_key); loan && from != stream) set(from, flavor, loan->own);
        const CUresult result = call();
        if (Loan* loan = find(key); loan && result == CUDA_SUCCESS) get(stream, flavor, loan->own);
        return result;
    }
    /// Its handle may come to mean another stream; null: those of all streams.
    void forget(CUstream stream);
    /// What the driver has refused to take back, and no launch needs: once more. Any thread; not
    /// of default streams, which are their thread's or context's.
    void give_back_refused();
    /// Before something that reads the stream's priority, such as a capture: at once, for
    /// whatever launch it is lent.
    void restore(CUstream stream, StreamFlavor flavor);

  private:
    struct Loan {
        StreamKey key;
        int own;
        int lenders;
    };

    Loan* find(const StreamKey& key) const;
    bool get(CUstream stream, StreamFlavor flavor, int& priority) const;
    bool set(CUstream stream, StreamFlavor flavor, int priority) const;

    const DriverApi& driver_;
    mutable std::mutex mutex_;
    mutable std::vector<Loan> loans_;
    std::atomic<bool> ever_lent_{false};
};

}  // namespace urgengo::exec
