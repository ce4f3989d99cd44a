// SPDX-License-Identifier: Apache-2.0
//
// Writes down what happens in a program under UrgenGo (abi/run_record.h): each thread into a ring
// of its own in one mapped file, so there is no lock, nothing has to be flushed, and the file is
// whole whatever ends the program.
//
//  1 A thread gets its ring at its first record: that takes system calls, once. A later record is a
//    store of 64 bytes, and one of how many there are.
//  2 A thread that ends leaves its ring to the next one that needs one.
//  3 The flight recorder (RunKeeps::kNewest) is always on, and overwrites its oldest records. A
//    trace (kOldest) takes another ring where one is full, at the same cost as the first, until the
//    file is full: then records are lost, and counted.
//
// A record takes 6 ns; 51 in a trace, with its part of the next ring; a thread's first one some 80
// us (measured, 2-core machine).
//
// @threads any; takes no lock and never waits
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "host/config/config.h"
#include "host/observe/page_folder.h"
#include "host/observe/shared_file.h"
#include "urgengo/abi/run_record.h"

namespace urgengo::observe {

inline constexpr std::uint32_t kFlightRecords = 4096;  ///< a thread's, by default

struct RecordOptions {
    std::string trace;  ///< file of a trace; empty: the flight recorder
    /// A thread's records of the flight recorder, rounded up to a power of two; 0: there is none.
    std::uint32_t flight_records = kFlightRecords;
    std::string conditions;  ///< a JSON object: under what the program runs
};

class RunRecorder {
  public:
    /// Is off until start().
    RunRecorder() = default;
    ~RunRecorder();
    RunRecorder(const RunRecorder&) = delete;
    RunRecorder& operator=(const RunRecorder&) = delete;

    /// @param path   of the new file
    /// @param group  that may read it, besides its owner; empty: none
    /// @param conditions  under what the program runs, a JSON object; empty: not told
    /// @returns why there is no recording; empty: there is one
    std::string start(const std::string& path, abi::RunKeeps keeps, std::uint32_t ring_records,
                      std::uint32_t most_rings, const std::string& group,
                      const config::Config& config, const std::string& conditions = {});

    bool is_on() const { return header_ != nullptr && !is_frozen_.load(std::memory_order_relaxed); }
    /// Nothing is added any more where it would overwrite: what was until now is kept.
    void freeze() {
        if (header_ && header_->keeps == abi::RunKeeps::kNewest) is_frozen_.store(true);
    }
    /// Of its file; empty while it is off.
    const std::string& path() const { return path_; }
    /// Its thread is filled in.
    void add(const abi::RunRecord& record);
    /// By one thread, once.
    void set_gpu(const char* name);
    /// The calling thread ends: its ring is another one's from here on.
    void thread_ends();
    /// No thread gets a ring any more.
    void finish() { next_.store(rings_.size()); }

  private:
    abi::RunRing* find_left(std::uint32_t thread);
    abi::RunRing* take_new(std::uint32_t thread);
    abi::RunRing* find_ring(std::uint32_t thread, bool is_first);
    void lose(bool is_first);
    void lay_out(const config::Config& config, const std::string& conditions);

    std::string path_;
    MappedFile file_;
    std::size_t bytes_ = 0;
    std::uint64_t ring_bytes_ = 0;
    std::uint32_t mask_ = 0;  ///< of a record's number: its place
    std::uint64_t id_ = 0;    ///< tells recorders apart; 0: it is off
    abi::RunHeader* header_ = nullptr;
    std::atomic<bool> is_frozen_{false};
    std::vector<std::atomic<abi::RunRing*>> rings_;  ///< room for all; null: it is not there yet
    std::atomic<std::uint64_t> next_{0};             ///< of them
};

}  // namespace urgengo::observe
