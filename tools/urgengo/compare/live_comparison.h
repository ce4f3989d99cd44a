// SPDX-License-Identifier: Apache-2.0
//
// Compares two modes of a process that runs: switches it to and fro, and reads its page.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <random>
#include <string>

#include "tools/urgengo/compare/compare_report.h"
#include "tools/urgengo/compare/live_frames.h"

namespace urgengo::cli {

class LiveComparison {
  public:
    struct Plan {
        abi::ControlCommand a{}, b{};
        nanoseconds block{0}, warm_up{0};
        int blocks = 0;
        std::uint64_t seed = 0;
    };
    /// @param page  of the process
    LiveComparison(const PageReading& page, const Plan& plan);

    /// Until all blocks are done, the process ends, or does not answer.
    /// @param must_stop  asked all the while
    /// @param show       how far it is, 0 to 1
    /// @returns why it stopped before its time; empty if it did not
    std::string run(const std::function<bool()>& must_stop,
                    const std::function<void(double)>& show);
    /// As it was when this began.
    void restore() const;

    std::vector<ComparedRow> rows() const;

  private:
    /// @returns false: it must stop, as `note_` says
    bool switch_to(bool is_b);
    bool wait_until(nanoseconds end, const std::function<bool()>& must_stop);
    bool look();

    const std::string stem_;
    const std::uint32_t process_;
    const abi::StatusMode first_;
    const Plan plan_;
    std::vector<ComparedChain> chains_;
    FrameBlocks blocks_;
    LiveFrames frames_;
    std::mt19937_64 random_;
    std::string note_;
    double cpu_at_begin_s_ = 0;
};

}  // namespace urgengo::cli
