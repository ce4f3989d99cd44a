// SPDX-License-Identifier: Apache-2.0
//
// What UrgenGo tells of itself inside the program, in a file of its own, if URGENGO_LOG asks for
// it: how it started, what changed, why a frame was late. Never from a launch path.
//
// 1 A thread of the program puts a line into a ring: no lock, no allocation, no file. Where the
// ring
//   is full, the line is dropped, and counted. Off, that is one load of a flag.
// 2 A thread of ours writes the file, 20 times a second at most. It opens the file each time: the
//   program may close descriptors that are not its own, and get their numbers for something else.
// 3 At the program's end what is in the ring is written, if that thread comes to it within 0.2 s.
//
// The few lines for people are base/log.h's; they come here, too. What is loaded into programs may
// bring no library, so this is not spdlog.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <ctime>
#include <string>
#include <string_view>
#include <utility>

#include "host/base/log_detail.h"

namespace urgengo {

class OwnLog {
  public:
    static constexpr std::size_t kLines = 1024;  ///< of the ring; power of two
    static constexpr std::size_t kMostText = 224;
    static constexpr std::uint64_t kMostBytes = std::uint64_t{64} << 20;  ///< of the file

    constexpr OwnLog() = default;

    /// Makes the file, and the thread that writes it. Once.
    /// @returns why there is none; empty: there is
    std::string start(LogDetail detail, const std::string& path);

    bool tells(LogDetail detail) const { return detail_.load(std::memory_order_relaxed) >= detail; }
    /// Puts the line into the ring if it is to be told; what is longer than kMostText is cut.
    /// @threads any
    void note(LogDetail detail, std::string_view text);

    /// The program ends: waits a little for the file to have all. Later lines are dropped.
    void finish();
    /// In a forked child, which has no such thread: it tells nothing.
    void forked() { detail_.store(LogDetail::kOff, std::memory_order_relaxed); }

    /// Lines that found no room.
    std::uint64_t dropped() const { return dropped_.load(std::memory_order_relaxed); }

  private:
    struct Line;

    static void run(void* log);
    bool write_lines();
    std::string take_lines();

    std::atomic<LogDetail> detail_{LogDetail::kOff};
    std::atomic<std::uint64_t> tail_{0}, dropped_{0};
    Line* ring_ = nullptr;  ///< never freed: threads may write until the process is gone
    const char* path_ = nullptr;
    // The thread's:
    std::uint64_t head_ = 0, told_dropped_ = 0, written_bytes_ = 0;
    // Futexes: it is to end; it has ended.
    std::atomic<std::uint32_t> ends_{0}, has_ended_{0};
};

/// The process' own.
OwnLog& own_log();

template <typename... Args>
void note(LogDetail detail, fmt::format_string<Args...> format, Args&&... args) {
    if (!own_log().tells(detail)) [[likely]]
        return;
    char text[OwnLog::kMostText];
    const auto end = fmt::format_to_n(text, sizeof text, format, std::forward<Args>(args)...);
    own_log().note(detail, {text, std::min<std::size_t>(end.size, sizeof text)});
}

}  // namespace urgengo
