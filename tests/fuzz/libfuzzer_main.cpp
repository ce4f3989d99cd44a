// SPDX-License-Identifier: Apache-2.0
//
// One target of fuzz_targets.h, FUZZ_TARGET, for libFuzzer.
#include <cstdint>

#include "tests/fuzz/fuzz_targets.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    urgengo::fuzz::FUZZ_TARGET(std::as_bytes(std::span(data, size)));
    return 0;
}
