// SPDX-License-Identifier: Apache-2.0
#include "host/base/own_thread.h"

#include <pthread.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <future>

#include "tests/support/catch.h"

using namespace urgengo;

namespace {

constexpr std::size_t kKiB = 1024;

// A program's own, which lies on each thread's stack.
thread_local std::array<char, 512 * kKiB> t_large;

struct Room {
    std::size_t all = 0;   ///< of the stack
    std::size_t left = 0;  ///< below where its thread begins
};

void tell_room(void* argument) {
    Room room;
    pthread_attr_t attributes;
    void* lowest = nullptr;
    if (pthread_getattr_np(pthread_self(), &attributes) == 0) {
        pthread_attr_getstack(&attributes, &lowest, &room.all);
        pthread_attr_destroy(&attributes);
        room.left =
            reinterpret_cast<std::uintptr_t>(&room) - reinterpret_cast<std::uintptr_t>(lowest);
    }
    t_large.back() = 1;
    static_cast<std::promise<Room>*>(argument)->set_value(room);
}

/// Of a thread that starts while new threads are given so much by default.
Room room_with_default(std::size_t bytes) {
    pthread_attr_t before, now;
    REQUIRE(pthread_getattr_default_np(&before) == 0);
    REQUIRE(pthread_attr_init(&now) == 0);
    REQUIRE(pthread_attr_setstacksize(&now, bytes) == 0);
    REQUIRE(pthread_setattr_default_np(&now) == 0);
    std::promise<Room> told;
    const bool started = start_own_thread(tell_room, &told);
    pthread_setattr_default_np(&before);
    pthread_attr_destroy(&before);
    pthread_attr_destroy(&now);
    REQUIRE(started);
    return told.get_future().get();
}

}  // namespace

TEST_CASE("An own thread's stack is what it needs, whatever the program's default is",
          "[base][own_thread]") {
    const std::size_t bytes = GENERATE(704 * kKiB, 8192 * kKiB);
    CAPTURE(bytes);
    const Room room = room_with_default(bytes);
    CHECK(room.left >= 240 * kKiB);
    CHECK(room.all <= 4096 * kKiB);
}
