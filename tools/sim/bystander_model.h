// SPDX-License-Identifier: Apache-2.0
//
// A thread that belongs to no chain. One fills the GPU now and then, as urgengo-chains'
// (tools/chains/bystander.h): a kernel of waves of 0.2 ms whose blocks take every thread slot, then
// a wait for it, then a sleep. The other one multiplies matrices, as that of
// tools/bench/programs/network_threads.py: some ahead, a wait for them, and again. A product is a
// block for each multiprocessor, which no other work shares, and which does one tile after the
// other: so are the library's on Hopper (nvjet_sm90_*, in tools/sim/data/h100_mix_a.profile.json:
// no more blocks than multiprocessors, and one fills one).
#pragma once

#include "tools/sim/chain_model.h"

namespace urgengo::sim {

struct BystanderSettings {
    nanoseconds length{0};  ///< of its kernels, alone; 0: there is none
    nanoseconds period{10'000'000};
    int ahead = 1;            ///< kernels before each wait
    std::uint32_t tiles = 0;  ///< of a product; 0: it is a kernel that fills thread slots
    nanoseconds before{0};    ///< computes for so long before them
};

/// Half precision, 4096 x 4096, in tiles of 128 x 256: 137 GFLOP in 0.208 ms.
/// @source rounds of eight of that thread on an H100 beside networks under urgengo, in the 7.25 s
/// of
///         a phase (2026-11-25_h100_network_mixes_traced_676df17.json): 3700 where the networks
///         take 0.23 of the GPU alone, 3168 where they take 0.41; as a line, 0.208 ms where they
///         take nothing
inline constexpr BystanderSettings kMatmulBystander{nanoseconds{208'000}, nanoseconds{0}, 8, 512,
                                                    nanoseconds{10'000}};

class BystanderModel {
  public:
    /// @param until  it launches nothing from then on
    BystanderModel(const BystanderSettings& settings, int thread, nanoseconds until,
                   ChainSurroundings& surroundings, Subject& subject);
    void go_on(nanoseconds now);

  private:
    enum class State { kLaunching, kComputing, kAsleep, kWaiting };
    void launch(nanoseconds now);
    void wait(nanoseconds now);
    void waited(nanoseconds now);

    const BystanderSettings settings_;
    const int thread_;
    const nanoseconds until_;
    ChainSurroundings& surroundings_;
    Subject& subject_;
    KernelWork kernel_;
    State state_ = State::kLaunching;
    nanoseconds next_{0};
};

}  // namespace urgengo::sim
