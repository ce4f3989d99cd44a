// SPDX-License-Identifier: Apache-2.0
//
// Ctrl-C during long work in this thread: it is asked now and then whether to end. One at a time.
#pragma once

#include <array>
#include <csignal>

namespace urgengo::cli {

/// From its making to its end SIGINT and SIGTERM only ask.
class Interruption {
  public:
    Interruption() {
        is_asked_ = 0;
        struct sigaction action {};
        action.sa_handler = [](int) { is_asked_ = 1; };
        sigemptyset(&action.sa_mask);
        for (std::size_t i = 0; i < kSignals.size(); ++i)
            sigaction(kSignals[i], &action, &before_[i]);
    }
    ~Interruption() {
        for (std::size_t i = 0; i < kSignals.size(); ++i)
            sigaction(kSignals[i], &before_[i], nullptr);
    }
    Interruption(const Interruption&) = delete;
    Interruption& operator=(const Interruption&) = delete;

    static bool is_asked() { return is_asked_ != 0; }

  private:
    static constexpr std::array kSignals{SIGINT, SIGTERM};
    static inline volatile std::sig_atomic_t is_asked_ = 0;
    std::array<struct sigaction, kSignals.size()> before_{};
};

}  // namespace urgengo::cli
