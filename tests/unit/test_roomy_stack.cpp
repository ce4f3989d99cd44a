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

/// Calls a function that needs so much, in a thread that has so much.
Seen in_thread_with(std::size_t has, std::size_t needs) {
    Seen seen{.needs = needs};
    pthread_attr_t attributes;
    REQUIRE(pthread_attr_init(&attributes) == 0);
    REQUIRE(pthread_attr_setstacksize(&attributes, has) == 0);
    pthread_t thread;
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
    REQUIRE(pthread_create(&thread, &attributes, run, &seen) == 0);
    pthread_attr_destroy(&attributes);
    REQUIRE(pthread_join(thread, nullptr) == 0);
    return seen;
}

}  // namespace

TEST_CASE("A thread is not cancelled while it is on another stack, or may be", "[base][stack]") {
    for (const std::size_t stack : {64 * kKiB, 2048 * kKiB}) {
        bool is_through = false, goes_on = false;
        struct Its {
            bool &is_through, &goes_on;
        } its{is_through, goes_on};
        pthread_attr_t attributes;
        REQUIRE(pthread_attr_init(&attributes) == 0);
        REQUIRE(pthread_attr_setstacksize(&attributes, stack) == 0);
        pthread_t thread;
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
        REQUIRE(pthread_create(&thread, &attributes, run, &its) == 0);
        pthread_attr_destroy(&attributes);
        void* result = nullptr;
        REQUIRE(pthread_join(thread, &result) == 0);
        CHECK(is_through);
        CHECK_FALSE(goes_on);
        CHECK(result == PTHREAD_CANCELED);
    }
}

TEST_CASE("What may need much stack has its thread's own if that is large", "[base][stack]") {
    const Seen seen = in_thread_with(2048 * kKiB, 1024 * kKiB);
    CHECK(seen.thread > seen.function);
    CHECK(seen.thread - seen.function < 64 * kKiB);
}

#if !URGENGO_SANITIZED
TEST_CASE("What may need much stack has megabytes where its thread has little", "[base][stack]") {
    const Seen seen = in_thread_with(128 * kKiB, 7 * 1024 * kKiB);
    CHECK(seen.function != 0);
}
#endif
