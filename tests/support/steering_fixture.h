// SPDX-License-Identifier: Apache-2.0
//
// The runtime of RuntimeFixture, and words for it.
#pragma once

#include "host/runtime/steering.h"
#include "tests/support/runtime_fixture.h"

namespace urgengo::testing {

struct SteeringFixture : RuntimeFixture {
    std::uint32_t word = 0;

    void steer(abi::ControlCommand command) {
        word = abi::next_control_word(word, command);
        rt().steering().obey(word);
    }
    void steer(abi::ControlCommand command, std::uint32_t chain) {
        word = abi::next_control_word(word, command);
        const runtime::Steering::Request request{word, chain};
        rt().steering().obey({&request, 1});
    }
    abi::ControlResult result() {
        const abi::ControlAnswer& answer =
            header().answers[abi::number_of(word) % abi::kControlRing];
        return answer.word == word ? answer.result.load() : abi::ControlResult::kNone;
    }
    abi::StatusHeader& header() { return rt().status().header(); }
    abi::SharedPage& page() { return rt().status().akb(); }
    /// Both are on the GPU, the loose one second in the order.
    void begin_both() {
        begin(thread_a, "tight");
        begin(thread_b, "loose");
        launch(thread_a);
        wait_a();
    }
};

}  // namespace urgengo::testing
