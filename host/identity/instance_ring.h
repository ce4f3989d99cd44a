// SPDX-License-Identifier: Apache-2.0
//
// One chain's frames that hints told of and that have not come to their end. Each chain has a ring
// of its own: a fast chain never pushes out a slow one's frames. A token names the frame and its
// chain; 0 names none. Not synchronised: the caller has a mutex (instances.h).
#pragma once

#include <cstdint>
#include <vector>

#include "host/identity/chain.h"

namespace urgengo::identity {

class InstanceRing {
  public:
    static constexpr std::size_t kSize = 256;  ///< frames of a chain at a time

    /// A token of the frame that is the chain's `count`th, from 1 on.
    static std::uint64_t token_of(std::uint64_t count, std::size_t chain, std::size_t num_chains) {
        return count * num_chains + chain;
    }
    /// @returns the index of the token's chain; the number of chains for a token that none has
    static std::size_t chain_of(std::uint64_t token, std::size_t num_chains) {
        return num_chains == 0 || token < num_chains ? num_chains : token % num_chains;
    }

    /// A frame arrives.
    /// @param[out] dropped  whether it takes the place of one that the program never ended, kSize
    ///                      frames ago
    /// @errors  may throw std::bad_alloc, at the first frame
    Instance add(ChainState& chain, std::size_t index, std::size_t num_chains, nanoseconds arrival,
                 bool& dropped) {
        if (frames_.empty()) frames_.resize(kSize);
        const std::uint64_t count = ++count_;
        Instance& entry = frames_[count % kSize];
        dropped = entry.token != 0;
        return entry = {token_of(count, index, num_chains), &chain, arrival};
    }

    /// @returns the frame; one without a token if it has ended or was pushed out
    Instance find(std::uint64_t token, std::size_t num_chains) const {
        if (frames_.empty()) return {};
        const Instance& entry = frames_[token / num_chains % kSize];
        return entry.token == token ? entry : Instance{};
    }

    void forget(std::uint64_t token, std::size_t num_chains) {
        if (frames_.empty()) return;
        Instance& entry = frames_[token / num_chains % kSize];
        if (entry.token == token) entry = {};
    }

    /// Forgets what arrived before this time. @returns how many that were
    std::uint64_t drop_before(nanoseconds time) {
        std::uint64_t dropped = 0;
        for (Instance& entry : frames_) {
            if (entry.token == 0 || entry.arrival >= time) continue;
            entry = {};
            ++dropped;
        }
        return dropped;
    }

  private:
    std::uint64_t count_ = 0;
    std::vector<Instance> frames_;
};

}  // namespace urgengo::identity
