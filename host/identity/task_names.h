// SPDX-License-Identifier: Apache-2.0
//
// Which tasks the names of threads and NVTX ranges stand for.
#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "host/config/config.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::identity {

/// A thread as it is known by its name; its own.
struct NamedThread {
    char name[16] = {};
    bool was_read = false;       ///< ever
    std::uint16_t patience = 1;  ///< so many times the name was found unchanged, up to a bound
    std::uint16_t num_candidates = 0;
    /// Tasks that a thread of this name may work for, in the config's order.
    std::array<std::int16_t, abi::kMaxTasks> candidates{};
    int last = -1;  ///< the last of them that ran here; -1: none
};

class TaskNames {
  public:
    /// Before there are threads. @param is_off  its chain is: no thread works for it
    void add_task(int task, const config::Task& match, bool is_off);

    /// Reads the calling thread's name, which takes 200 ns.
    void read(NamedThread& thread);
    /// @returns the first task whose `nvtx:` names the range; -1: none
    int task_of_range(const std::string& range) const;
    bool knows_ranges() const { return knows_ranges_; }

    /// @returns names of threads that stood for no task, some of them; none while one is added.
    ///          For the program's end, perhaps out of a signal's handler
    std::vector<std::string> unmatched();

  private:
    struct Known {
        int task = 0;
        std::string thread_glob, nvtx_glob;
        bool by_thread = false;   ///< some thread's name stands for it
        bool any_thread = false;  ///< every name does: a kernel tells
    };

    std::vector<Known> tasks_;
    bool knows_ranges_ = false;
    std::mutex mutex_;
    std::set<std::string> unmatched_;
};

}  // namespace urgengo::identity
