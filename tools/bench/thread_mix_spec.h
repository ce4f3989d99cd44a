// SPDX-License-Identifier: Apache-2.0
//
// What the threads of urgengo_thread_mix do, as its spec says: a JSON file.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace urgengo::bench {

/// When a chain holds the program's mutex.
enum class MixLock {
    kNever,
    kLaunching,
    kFrame,  ///< while it launches, and until all of that is done
};

/// A frame is `kernels` of `kernel_us` in turns over `streams`, forked from and joined with the
/// first one by events; each kernel fills the GPU.
struct MixChain {
    std::string name;  // the thread's
    double period_ms = 0, deadline_ms = 0, offset_ms = 0;
    int kernels = 1;
    unsigned kernel_us = 100;
    int streams = 1;
    MixLock locks = MixLock::kNever;
    std::string waits_for;  // its stream waits for that chain's last frame so far; empty: of none
};

/// Back to back, at no chain's name.
struct MixBystander {
    int kernels = 4;
    unsigned kernel_us = 200;
};

struct MixSpec {
    std::vector<MixChain> chains;
    std::optional<MixBystander> bystander;
};

/// @errors std::runtime_error, with what was found and what is accepted
MixSpec read_mix_spec(const std::string& path);

}  // namespace urgengo::bench
