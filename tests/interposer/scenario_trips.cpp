// SPDX-License-Identifier: Apache-2.0
//
// A program in which UrgenGo finds no memory while it is told of a frame, once or twice, if
// failing_allocator.cpp is preloaded: that is an error of UrgenGo's own. The program goes on.
#include <dlfcn.h>

#include <urgengo/urgengo.h>

#include <thread>

#include "tests/interposer/gpu.h"
#include "tests/interposer/kernel_log.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

constexpr int kFrames = 20;

/// A thread that UrgenGo has not seen yet needs memory there.
void tell_without_memory(const ug_hints& hints) {
    void* const found = dlsym(RTLD_DEFAULT, "fail_allocations");
    const auto fail_allocations = reinterpret_cast<void (*)(bool)>(found);
    std::thread([&] {
        if (fail_allocations) fail_allocations(true);
        errno = kErrno;
        hints.task_begin(hints.arrival("steady", 0, UG_CLOCK_MONOTONIC), "work");
        const int errno_after = errno;
        if (fail_allocations) fail_allocations(false);
        say("errno %d", errno_after);
    }).join();
}

int trips(const Arguments& arguments) {
    ug_hints hints;
    ug_hints_load(&hints);
    const Gpu gpu;
    const CUfunction mix = gpu.function(kMixName);
    const CUstream stream = make_stream();
    std::uint64_t* const word = make_mapped(1);
    const auto frames = [&] {
        for (std::uint64_t frame = 0; frame < kFrames; ++frame) {
            hints.task_begin(hints.arrival("steady", 0, UG_CLOCK_MONOTONIC), "work");
            for (int i = 0; i < 3; ++i) MUST(launch_wide(gpu.wide, stream));
            std::uint64_t value = frame;
            CUdeviceptr to = on_gpu(word);
            void* parameters[] = {&to, &value};
            MUST(cuLaunchKernel(mix, 1, 1, 1, 1, 1, 1, 0, stream, parameters, nullptr));
            MUST(cuStreamSynchronize(stream));
            hints.task_end();
        }
        int priority = 99;
        MUST(of_driver<decltype(cuStreamGetPriority)>("cuStreamGetPriority")(stream, &priority));
        say("%llu, priority %d", static_cast<unsigned long long>(*word), priority);
    };
    frames();
    for (const std::string& time : arguments) {
        tell_without_memory(hints);
        say("%s time", time.c_str());
        frames();
    }
    return 0;
}

const Scenario s1("trips", trips, Runs::kSimulated);

}  // namespace
}  // namespace twin
