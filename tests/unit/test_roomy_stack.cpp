// SPDX-License-Identifier: Apache-2.0
#include "host/base/roomy_stack.h"

#include <pthread.h>

#include <cstddef>
#include <cstdint>

#include "host/base/sanitized.h"
#include "tests/support/catch.h"

using namespace urgengo;

namespace {

constexpr std::size_t kKiB = 1024;

struct Seen {
    std::uintptr_t thread = 0, function = 0;  ///< where their frames are
    std::size_t needs = 0;
};

std::uintptr_t here() {
    return reinterpret_cast<std::uintptr_t>(__builtin_frame_address(0));
}

[[gnu::noinline]] void use(std::size_t bytes) {
    auto* const room = static_cast<volatile char*>(__builtin_alloca(bytes));
    for (std::size_t i = 0; i < bytes; i += kKiB) room[bytes - 1 - i] = 1;
}

/// @returns what a thread of such a stack returned
void* in_thread(std::size_t stack_bytes, void* (*run)(void*), void* argument) {
    pthread_attr_t attributes;
    REQUIRE(pthread_attr_init(&attributes) == 0);
    REQUIRE(pthread_attr_setstacksize(&attributes, stack_bytes) == 0);
    pthread_t thread;
    REQUIRE(pthread_create(&thread, &attributes, run, argument) == 0);
    pthread_attr_destroy(&attributes);
    void* result = nullptr;
    REQUIRE(pthread_join(thread, &result) == 0);
    return result;
}

/// Calls a function that needs so many bytes of stack, in a thread that has so many.
Seen seen_in_thread(std::size_t has, std::size_t needs) {
    Seen seen{.needs = needs};
    const auto run = [](void* argument) -> void* {
        static_cast<Seen*>(argument)->thread = here();
        on_large_stack(
            [](void* to) {
                auto& its = *static_cast<Seen*>(to);
                its.function = here();
                use(its.needs);
            },
            argument);
        return nullptr;
    };
    in_thread(has, run, &seen);
    return seen;
}

}  // namespace

TEST_CASE("A thread is not cancelled while it is on another stack, or may be", "[base][stack]") {
    // A sanitizer's thread-local storage alone may not fit into the smaller one.
    constexpr std::size_t kSmall = URGENGO_SANITIZED ? 1024 * kKiB : 64 * kKiB;
    for (const std::size_t stack : {kSmall, 2048 * kKiB}) {
        bool is_through = false, goes_on = false;
        struct Its {
            bool &is_through, &goes_on;
        } its{is_through, goes_on};
        const auto run = [](void* argument) -> void* {
            auto& to = *static_cast<Its*>(argument);
            pthread_cancel(pthread_self());
            on_large_stack([&] {
                pthread_testcancel();
                to.is_through = true;
            });
            pthread_testcancel();
            to.goes_on = true;
            return nullptr;
        };
        CHECK(in_thread(stack, run, &its) == PTHREAD_CANCELED);
        CHECK(is_through);
        CHECK_FALSE(goes_on);
    }
}

TEST_CASE("What may need much stack has its thread's own if that is large", "[base][stack]") {
    const Seen seen = seen_in_thread(2048 * kKiB, 1024 * kKiB);
    CHECK(seen.thread > seen.function);
    CHECK(seen.thread - seen.function < 64 * kKiB);
}

#if !URGENGO_SANITIZED
TEST_CASE("What may need much stack has megabytes where its thread has little", "[base][stack]") {
    const Seen seen = seen_in_thread(128 * kKiB, 7 * 1024 * kKiB);
    CHECK(seen.function != 0);
}
#endif
