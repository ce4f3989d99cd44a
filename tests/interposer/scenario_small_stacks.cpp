// SPDX-License-Identifier: Apache-2.0
//
// Threads with the smallest stack that there is, which launch, are held and wait.
#include <pthread.h>
#include <sys/mman.h>

#include <array>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

constexpr std::size_t kStackBytes = 16 * 1024;  // PTHREAD_STACK_MIN, thread-local storage included

struct Small {
    const Gpu* gpu = nullptr;
    const char* name = nullptr;
    CUstream stream = nullptr;
    CUresult result = CUDA_SUCCESS;
    pthread_t thread{};
};

void* launch_from_small_stack(void* argument) {
    auto& small = *static_cast<Small*>(argument);
    pthread_setname_np(pthread_self(), small.name);
    const auto note = [&](CUresult result) {
        if (result != CUDA_SUCCESS) small.result = result;
    };
    note(cuCtxSetCurrent(small.gpu->context));
    for (int frame = 0; frame < 5; ++frame) {
        for (int i = 0; i < 10; ++i) note(launch_wide(small.gpu->wide, small.stream));
        note(cuStreamSynchronize(small.stream));
    }
    return nullptr;
}

// Memory of ours below each stack: what runs over it dies there.
int small_stacks(bool first_launches_too) {
    const Gpu gpu;
    if (!first_launches_too) {
        const CUstream first = make_stream();
        SHOW(launch_wide(gpu.wide, first));
        SHOW(cuStreamSynchronize(first));
    }
    std::array<Small, 4> threads;
    constexpr std::array kNames{"twin_1", "twin_3", "twin_5", "twin_7"};
    constexpr std::size_t kGuard = 64 * 1024;
    for (std::size_t t = 0; t < threads.size(); ++t) {
        threads[t].gpu = &gpu;
        threads[t].name = kNames[t];
        threads[t].stream = make_stream();
        void* memory = mmap(nullptr, kGuard + kStackBytes, PROT_READ | PROT_WRITE,
                            MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
        if (memory == MAP_FAILED || mprotect(memory, kGuard, PROT_NONE) != 0) give_up("mmap", 1);
        pthread_attr_t attributes;
        MUST(pthread_attr_init(&attributes));
        MUST(pthread_attr_setstack(&attributes, static_cast<char*>(memory) + kGuard, kStackBytes));
        MUST(pthread_create(&threads[t].thread, &attributes, launch_from_small_stack, &threads[t]));
    }
    for (Small& small : threads) {
        pthread_join(small.thread, nullptr);
        say("%s: %d", small.name, static_cast<int>(small.result));
    }
    return 0;
}

const Scenario s1("small_stacks", [](const Arguments&) { return small_stacks(false); });
// UrgenGo starts with the first launch.
const Scenario s2("small_stacks_first", [](const Arguments&) { return small_stacks(true); });

}  // namespace
}  // namespace twin
