// SPDX-License-Identifier: Apache-2.0
//
// Ctrl-C during long work: it is noted, and asked for now and then.
#pragma once

#include <csignal>
#include <initializer_list>
#include <utility>
#include <vector>

namespace urgengo::cli {

/// Notes signals while it lives, instead of dying of them. @threads main; one at a time
class Interrupts {
  public:
    explicit Interrupts(std::initializer_list<int> signals = {SIGINT, SIGTERM}) {
        has_come_ = 0;
        is_from_terminal_ = 0;
        struct sigaction action {};
        action.sa_flags = SA_SIGINFO;
        action.sa_sigaction = [](int, siginfo_t* info, void*) {
            is_from_terminal_ = info->si_code == SI_KERNEL;
            has_come_ = 1;
        };
        for (const int signal : signals) {
            struct sigaction before {};
            sigaction(signal, &action, &before);
            before_.emplace_back(signal, before);
        }
    }
    ~Interrupts() {
        for (const auto& [signal, before] : before_) sigaction(signal, &before, nullptr);
    }
    Interrupts(const Interrupts&) = delete;
    Interrupts& operator=(const Interrupts&) = delete;

    static bool has_come() { return has_come_ != 0; }
    /// By Ctrl-C in a terminal, which a program that was started has got, too.
    static bool is_from_terminal() { return is_from_terminal_ != 0; }

  private:
    static inline volatile std::sig_atomic_t has_come_ = 0, is_from_terminal_ = 0;
    std::vector<std::pair<int, struct sigaction>> before_;
};

}  // namespace urgengo::cli
