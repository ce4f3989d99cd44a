// SPDX-License-Identifier: Apache-2.0
//
// A frame ends where there is no memory to tell its cause. The process's operator new is replaced:
// it fails in a thread that asks for that, and else does what it always does. Not under the address
// sanitizer, which has its own.
#ifndef __SANITIZE_ADDRESS__
#include <cstdlib>
#include <new>

#include "tests/support/common_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

thread_local bool has_no_memory = false;

}  // namespace

// Inlined, the compiler warns of a free() for what operator new gave.
[[gnu::noinline]] void* operator new(std::size_t size) {
    void* const memory = has_no_memory ? nullptr : std::malloc(size == 0 ? 1 : size);
    if (!memory) throw std::bad_alloc();
    return memory;
}
[[gnu::noinline]] void operator delete(void* memory) noexcept {
    std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept {
    std::free(memory);
}

TEST_CASE("Cause of a late frame is not known where there is no memory to tell it",
          "[runtime][causes]") {
    CommonFixture f;
    runtime::FrameCauses& causes = f.common().observers.causes;
    const runtime::ChainState& chain = *f.common().roster.chains()[0];
    f.tight().facts.holds.add({1s, 1010ms, 1050ms, 1});
    observe::Cause cause;
    bool has_thrown = false;
    has_no_memory = true;
    try {
        cause = causes.frame_ended(chain, 1s, 1100ms);
    } catch (const std::bad_alloc&) {
        has_thrown = true;
    }
    has_no_memory = false;
    CHECK_FALSE(has_thrown);
    CHECK(cause.kind == observe::MissCause::kUnknown);
    const auto counts = causes.counts(chain);
    REQUIRE(counts.size() == 1);
    CHECK(counts[0].cause == observe::MissCause::kUnknown);
    CHECK(causes.frame_ended(chain, 1s, 1100ms).kind == observe::MissCause::kHeld);
}

#endif  // __SANITIZE_ADDRESS__
