// SPDX-License-Identifier: Apache-2.0
//
// What a thread knows of kernels, by their handles: asked for at launches, where finding nothing
// means asking the driver for a name (some us).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace urgengo::identity {

/// @tparam Entry  with a `function`: its handle, null if it is free. Two of them are a cache line.
///
/// Room for 512, in pairs. An entry lies in the first pair from its hash's on that had room. When
/// none of kMostProbed had, the older one of that first pair goes: so that happens to a program
/// of more than 400 kernels, and not to one of three whose hashes are alike. (With no more room
/// than a pair for those, one of six processes asked the driver about 30 launches of each
/// inference, and took 4 % longer; ResNet-50, H200.)
template <typename Entry>
class KernelCache {
  public:
    /// @returns null if it is not there
    Entry* find(const void* function) {
        if (!function) return nullptr;
        for (std::size_t i = home_of(function), end = i + kMostProbed; i < end; ++i) {
            Pair& pair = pairs_[i % kPairs];
            if (pair[0].function == function) return &pair[0];
            if (pair[1].function == function) return &pair[1];
            if (!pair[0].function || !pair[1].function) return nullptr;
        }
        return nullptr;
    }
    /// @returns a free place for it; what lay there is forgotten
    Entry& insert(const void* function) {
        const std::size_t home = home_of(function);
        for (std::size_t i = home; i < home + kMostProbed; ++i)
            for (Entry& entry : pairs_[i % kPairs])
                if (!entry.function) return entry = {};
        Pair& pair = pairs_[home];
        pair[1] = pair[0];
        return pair[0] = {};
    }
    void clear() { pairs_.fill({}); }

  private:
    static constexpr int kPairBits = 8;
    static constexpr std::size_t kPairs = std::size_t{1} << kPairBits;
    static constexpr std::size_t kMostProbed = 32;
    using Pair = std::array<Entry, 2>;

    static std::size_t home_of(const void* function) {
        static_assert(sizeof(Pair) == 64);
        // Handles lie at regular distances: all bits take part, twice, as there are distances that
        // once does not mix.
        constexpr std::uint64_t kFactor = 0x9e3779b97f4a7c15;
        std::uint64_t mixed = reinterpret_cast<std::uint64_t>(function) * kFactor;
        mixed = (mixed ^ (mixed >> 32)) * kFactor;
        return mixed >> (64 - kPairBits);
    }

    alignas(64) std::array<Pair, kPairs> pairs_{};
};

}  // namespace urgengo::identity
