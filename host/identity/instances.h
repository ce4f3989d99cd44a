// SPDX-License-Identifier: Apache-2.0
//
// Frames on their way through chains: those that hints tell of, by tokens, and those without hints,
// which are handed on from one task of their chain to the next in order.
//
// @threads any; each call takes a mutex, for less than a microsecond, a few times a frame
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "host/identity/chain.h"
#include "host/identity/instance_ring.h"

namespace urgengo::identity {

class Instances {
  public:
    using Told = std::function<void(const ChainState&)>;

    /// @param dropped  is told of every frame that counts as missed here, after it was counted;
    ///                 without a lock of ours: it may call another tool
    explicit Instances(Told dropped = {}) : dropped_(std::move(dropped)) {}

    /// Before there are threads; in the order of the chains' indices.
    void add_chain(ChainState& chain) { chains_.push_back({&chain, {}, {}}); }

    // --- by hints
    /// @returns the frame's token. One that the program never ended counts as missed, once it has
    ///          too many
    std::uint64_t arrived(std::size_t chain, nanoseconds when);
    /// @returns the frame; one without a token if it has ended, or there was none
    Instance find(std::uint64_t token);
    void forget(std::uint64_t token);
    /// Those whose deadline has passed count as missed. For the program's end, perhaps out of a
    /// signal's handler: does nothing while another thread is in a call.
    void drop_late(nanoseconds now);

    // --- without
    /// A thread begins the chain's task at `stage`.
    /// @param slept_since  it has had nothing to do since then; nothing: it had
    /// @returns the arrival of the oldest frame that the task before it has finished
    std::optional<nanoseconds> taken_over(std::size_t chain, std::size_t stage,
                                          std::optional<nanoseconds> slept_since);
    /// If there is none: the frame enters the chain there.
    void entered(std::size_t chain, std::size_t stage, nanoseconds arrival);
    /// The chain's task at `stage` is done with that frame.
    void handed_on(std::size_t chain, std::size_t stage, nanoseconds arrival, nanoseconds now);
    /// No later task takes a frame that has come this far; none of them is missed.
    void forget_passages();
    void forget_passages(std::size_t chain);

  private:
    /// An instance without hints that is somewhere between its chain's tasks.
    struct Passage {
        nanoseconds arrival{0};
        std::size_t next_stage = 0;  ///< the task that has not begun yet
        bool running = false;        ///< the one before it has not ended yet
        nanoseconds finished{0};     ///< when it has
    };
    struct Chain {
        ChainState* state = nullptr;
        InstanceRing hinted;
        std::vector<Passage> passages;
    };

    void missed(ChainState& chain, std::uint64_t frames) const;

    const Told dropped_;
    std::mutex mutex_;
    std::vector<Chain> chains_;
};

}  // namespace urgengo::identity
