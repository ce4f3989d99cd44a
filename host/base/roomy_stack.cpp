// SPDX-License-Identifier: Apache-2.0
#include "host/base/roomy_stack.h"

#include <pthread.h>
#include <sys/mman.h>
#include <ucontext.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define URGENGO_SANITIZED 1
#elif defined(__has_feature)
#define URGENGO_SANITIZED (__has_feature(address_sanitizer) || __has_feature(thread_sanitizer))
#else
#define URGENGO_SANITIZED 0
#endif

namespace urgengo {
namespace {

constexpr std::size_t kBytes = 256 * 1024;

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

void call_on(void* stack, const Call& its) {
    ucontext_t caller;
    ucontext_t callee;
    if (getcontext(&callee) != 0) return its.function(its.argument);
    callee.uc_stack.ss_sp = stack;
    callee.uc_stack.ss_size = kBytes;
    callee.uc_link = &caller;
    const auto address = std::uint64_t{reinterpret_cast<std::uintptr_t>(&its)};
    makecontext(&callee, reinterpret_cast<void (*)()>(call), 2, static_cast<unsigned>(address),
                static_cast<unsigned>(address >> 32));
    swapcontext(&caller, &callee);
}

}  // namespace

void on_roomy_stack(void (*function)(void*), void* argument) {
#if URGENGO_SANITIZED
    return function(argument);  // they know nothing of such stacks
#endif
    // Below it a page that must not be touched: what overruns it must not write to others' memory.
    const auto guard_bytes = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
    const std::size_t bytes = guard_bytes + kBytes;
    void* mapped = mmap(nullptr, bytes, PROT_READ | PROT_WRITE,
                        MAP_PRIVATE | MAP_ANONYMOUS | MAP_STACK, -1, 0);
    if (mapped == MAP_FAILED) return function(argument);
    mprotect(mapped, guard_bytes, PROT_NONE);
    void* stack = static_cast<std::byte*>(mapped) + guard_bytes;
    int before = 0;  // unwinding ends where the stack begins
    pthread_setcancelstate(PTHREAD_CANCEL_DISABLE, &before);
    call_on(stack, {function, argument});
    pthread_setcancelstate(before, nullptr);
    munmap(mapped, bytes);
}

}  // namespace urgengo
