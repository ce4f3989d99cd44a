// SPDX-License-Identifier: Apache-2.0
//
// A library to preload: no memory is found in a thread that asks for that, so that whatever is
// made by `new` there fails. All else is the C library's.
#include <cerrno>
#include <cstddef>

extern "C" {

void* __libc_malloc(std::size_t bytes);
void* __libc_memalign(std::size_t alignment, std::size_t bytes);

namespace {
__thread bool t_fails __attribute__((tls_model("initial-exec"))) = false;
}

void* malloc(std::size_t bytes) noexcept {
    if (t_fails) {
        errno = ENOMEM;
        return nullptr;
    }
    return __libc_malloc(bytes);
}

void* aligned_alloc(std::size_t alignment, std::size_t bytes) noexcept {
    if (t_fails) {
        errno = ENOMEM;
        return nullptr;
    }
    return __libc_memalign(alignment, bytes);
}

/// Of the calling thread's allocations from here on.
__attribute__((visibility("default"))) void fail_allocations(bool they_do) {
    t_fails = they_do;
}
}
