// SPDX-License-Identifier: Apache-2.0
//
// Frames of one chain that end in several threads at once: each is recorded, and their causes may
// be asked for meanwhile.
#include <atomic>
#include <thread>
#include <vector>

#include "host/runtime/chain_status.h"
#include "tests/support/common_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

TEST_CASE("Frames of a chain that end at once have a record each", "[runtime][status_page]") {
    CommonFixture f;
    runtime::ChainStatus status(f.common());
    const runtime::ChainState& chain = *f.common().roster.chains()[0];
    const abi::ChainStatus& page = f.common().status.chain(0);
    constexpr int kThreads = 4, kRounds = 20;
    constexpr int kEach = abi::kFrameRing / kThreads;
    std::uint64_t wrong = 0;
    for (int round = 0; round < kRounds && wrong == 0; ++round) {
        std::atomic<int> ready{0};
        std::vector<std::thread> threads;
        // The ring is filled once a round, with times of the round.
        for (int t = 0; t < kThreads; ++t)
            threads.emplace_back([&, t] {
                ++ready;
                while (ready < kThreads) {
                }
                for (int i = 0; i < kEach; ++i)
                    status.ended(chain, 1ms, {}, nanoseconds(1 + t * kEach + i));
            });
        for (std::thread& thread : threads) thread.join();
        const auto ended = static_cast<std::uint64_t>(round + 1) * kThreads * kEach;
        wrong += page.frames != ended;
        std::vector<bool> seen(abi::kFrameRing);
        for (const abi::FrameRecord& record : page.ring)
            seen[static_cast<std::size_t>(record.end_ns - 1)] = true;
        for (const bool is_there : seen) wrong += !is_there;
    }
    CHECK(wrong == 0);
}

TEST_CASE("Causes are told while frames end", "[runtime][causes]") {
    CommonFixture f;
    runtime::FrameCauses& causes = f.common().observers.causes;
    const runtime::ChainState& chain = *f.common().roster.chains()[0];
    causes.frame_ended(chain, 1s, 2s);
    std::atomic<bool> is_over{false}, has_begun{false};
    std::thread other([&] {
        while (!is_over) {
            causes.frame_ended(chain, 1s, 2s);
            has_begun = true;
        }
    });
    while (!has_begun) std::this_thread::yield();
    constexpr int kTimes = 20'000;
    int told = 0;
    for (int i = 0; i < kTimes; ++i) told += !causes.counts(chain).empty();
    is_over = true;
    other.join();
    CHECK(told == kTimes);
}
