// SPDX-License-Identifier: Apache-2.0
#include "host/base/roomy_stack.h"

#include <pthread.h>
#include <sys/mman.h>
#include <ucontext.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>

#include "host/base/sanitized.h"
#include "host/base/uncancelled.h"

namespace urgengo {
namespace {

constexpr std::size_t kRoomyBytes = 256 * 1024, kLargeBytes = 8 * 1024 * 1024;

struct Call {
    void (*function)(void*);
    void* argument;
};

// makecontext() passes on ints only.
void call(unsigned low, unsigned high) {
    const auto address = std::uint64_t{high} << 32 | low;
    const auto& its = *reinterpret_cast<const Call*>(static_cast<std::uintptr_t>(address));
    its.function(its.argument);
}

void call_on(void* stack, std::size_t bytes, const Call& its) {
    ucontext_t caller;
    ucontext_t callee;
    if (getcontext(&callee) != 0) return its.function(its.argument);
    callee.uc_stack.ss_sp = stack;
    callee.uc_stack.ss_size = bytes;
    callee.uc_link = &caller;
    const auto address = std::uint64_t{reinterpret_cast<std::uintptr_t>(&its)};
    makecontext(&callee, reinterpret_cast<void (*)()>(call), 2, static_cast<unsigned>(address),
                static_cast<unsigned>(address >> 32));
    swapcontext(&caller, &callee);
}

/// @returns what is left of the thread's own stack; 0 if that cannot be told, or it is on another
std::size_t room_left() {
    pthread_attr_t attributes;
    if (pthread_getattr_np(pthread_self(), &attributes) != 0) return 0;
    void* lowest = nullptr;
    std::size_t bytes = 0, guard_bytes = 0;
    pthread_attr_getstack(&attributes, &lowest, &bytes);
    pthread_attr_getguardsize(&attributes, &guard_bytes);
    pthread_attr_destroy(&attributes);
    const auto begin = reinterpret_cast<std::uintptr_t>(lowest);
    const auto here = reinterpret_cast<std::uintptr_t>(&attributes);
    if (here < begin + guard_bytes || here >= begin + bytes) return 0;
    return here - begin - guard_bytes;
}

/// @returns false: there is no memory for it, and nothing was called
bool on_new_stack(std::size_t bytes, const Call& its) {
#if URGENGO_SANITIZED
    return false;  // they know nothing of such stacks
#endif
    // Below it a page that must not be touched: what overruns it must not write to others' memory.
    const auto guard_bytes = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
    void* mapped = mmap(nullptr, guard_bytes + bytes, PROT_READ | PROT_WRITE,
                        MAP_PRIVATE | MAP_ANONYMOUS | MAP_STACK, -1, 0);
    if (mapped == MAP_FAILED) return false;
    mprotect(mapped, guard_bytes, PROT_NONE);
    void* stack = static_cast<std::byte*>(mapped) + guard_bytes;
    call_on(stack, bytes, its);
    munmap(mapped, guard_bytes + bytes);
    return true;
}

}  // namespace

// Unwinding would end where the stack begins, and at what throws nothing.
void on_roomy_stack(void (*function)(void*), void* argument) {
    const Uncancelled uncancelled;
    if (!on_new_stack(kRoomyBytes, {function, argument})) function(argument);
}

void on_large_stack(void (*function)(void*), void* argument) {
    const Uncancelled uncancelled;
    if (room_left() > kRoomyBytes) return function(argument);
    // Of a program that locks its memory all of it counts.
    if (!on_new_stack(kLargeBytes, {function, argument})) on_roomy_stack(function, argument);
}

}  // namespace urgengo
