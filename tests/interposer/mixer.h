// SPDX-License-Identifier: Apache-2.0
//
// What the scenarios of order share: a word that every kernel multiplies before it adds, which
// tells which launches ran, how often and in which order; and steps, which say what is about to be
// done, so that the last line tells which call ended the program.
#pragma once

#include <cstdio>
#include <utility>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {

struct Mixer {
    CUresult launch(std::uint64_t value, CUstream stream) const {
        return launch(on_gpu(word), value, stream);
    }
    CUresult launch(CUdeviceptr to, std::uint64_t value, CUstream stream) const {
        void* parameters[] = {&to, &value};
        return cuLaunchKernel(mix, 1, 1, 1, 1, 1, 1, 0, stream, parameters, nullptr);
    }
    CUresult launch_wide(CUstream stream) const { return twin::launch_wide(gpu.wide, stream); }
    void say_word() const { say("%llx", static_cast<unsigned long long>(*word)); }

    Gpu gpu;
    CUfunction mix = gpu.function(kMixName);
    std::uint64_t* word = make_mapped(2);
};

/// @returns null if the driver does not have it
template <typename Function>
Function* find(const char* name, int version) {
    void* function = nullptr;
    CUdriverProcAddressQueryResult status;
    const CUresult result = cuGetProcAddress(name, &function, version, 0, &status);
    if (result != CUDA_SUCCESS || !function) say("%s: missing", name);
    return result == CUDA_SUCCESS ? reinterpret_cast<Function*>(function) : nullptr;
}

/// Adds to the word that it is given, as a host function.
inline void CUDA_CB add_seven(void* word) {
    auto& its = *static_cast<std::uint64_t*>(word);
    its = 31 * its + 7;
}

/// As show(), and says so before the call too.
template <typename Call>
CUresult step(const char* text, Call&& call) {
    say("%s ...", text);
    std::fflush(stdout);
    const CUresult result = show(text, std::forward<Call>(call));
    std::fflush(stdout);
    return result;
}

/// Does the same on every kind of stream.
/// @param work  (const Mixer&, CUstream)
/// @returns the scenario's exit status
template <typename Work>
int on_every_stream(Work&& work) {
    const Mixer mixer;
    const std::pair<const char*, CUstream> streams[] = {
        {"legacy", nullptr},
        {"per-thread", CU_STREAM_PER_THREAD},
        {"blocking", make_stream(CU_STREAM_DEFAULT)},
        {"non-blocking", make_stream(CU_STREAM_NON_BLOCKING, -1)}};
    for (const auto& [name, stream] : streams) {
        say("%s stream", name);
        *mixer.word = 0;
        work(mixer, stream);
        mixer.say_word();
    }
    return 0;
}

}  // namespace twin

#define STEP(call) ::twin::step(#call, [&] { return (call); })
