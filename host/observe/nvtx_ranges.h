// SPDX-License-Identifier: Apache-2.0
//
// The NVTX ranges that each thread of the program is in: nvtxRangePush and nvtxRangePop, of all
// domains. (Ranges that start in one thread and may end in another say nothing of a thread.)
// Filled by interposer/nvtx_tool.h; a thread's stack is touched by that thread only.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace urgengo::observe {

class RangeStack {
  public:
    static constexpr int kMaxDepth = 16;
    static constexpr std::size_t kMaxNameBytes = 128;

    /// @param name    UTF-8; what follows kMaxNameBytes is cut off
    /// @param domain  null: the default one. A pop ends the innermost range of its own domain.
    /// Ranges deeper than kMaxDepth are counted and not kept.
    void push(std::string_view name, const void* domain = nullptr);
    /// Does nothing if the domain has no range.
    void pop(const void* domain = nullptr);

    /// Changes with each push and pop; never 0.
    std::uint32_t epoch() const { return epoch_; }

    /// @param matches  called with (name, fnv1a64 of it) from the innermost range outwards
    /// @returns the name of the first for which it is true; empty if there is none
    template <typename Matches>
    std::string_view innermost(Matches&& matches) const {
        for (int i = depth_; i-- > 0;)
            if (matches(ranges_[i].text(), ranges_[i].hash)) return ranges_[i].text();
        return {};
    }

  private:
    struct Range {
        const void* domain;
        std::uint64_t hash;
        std::size_t length;
        char name[kMaxNameBytes];
        std::string_view text() const { return {name, length}; }
    };

    std::uint32_t epoch_ = 1;
    int depth_ = 0;   // of what is kept
    int deeper_ = 0;  // ranges that are not
    std::array<Range, kMaxDepth> ranges_;
};

/// @returns the calling thread's stack; null if it never pushed a range. For the launch path: one
///          load.
const RangeStack* this_thread_ranges();

/// @returns the same, made if needed; null if there is no memory, or the thread is ending
RangeStack* make_this_thread_ranges();

}  // namespace urgengo::observe
