// SPDX-License-Identifier: Apache-2.0
//
// Data: copies in every direction, memsets, launches on every kind of stream and by every entry
// point, modules that come and go.
#include <array>
#include <cstring>
#include <numeric>

#include "tests/interposer/gpu.h"
#include "tests/interposer/kernel_log.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

using Words = std::array<std::uint64_t, 16>;

void say_words(const char* what, const Words& words) {
    std::string line = what;
    for (std::uint64_t w : words) line += ' ' + std::to_string(w);
    say("%s", line.c_str());
}

int copies(const Arguments&) {
    const Gpu gpu;
    Words h_words;
    std::iota(h_words.begin(), h_words.end(), 100);
    CUdeviceptr d_a = 0, d_b = 0;
    SHOW(cuMemAlloc(&d_a, sizeof h_words));
    SHOW(cuMemAlloc(&d_b, sizeof h_words));
    SHOW(cuMemcpyHtoD(d_a, h_words.data(), sizeof h_words));
    SHOW(cuMemcpyDtoD(d_b, d_a, sizeof h_words));
    SHOW(launch_tiny(gpu.tiny, nullptr));
    SHOW(cuMemsetD8(d_b, 7, 8));
    SHOW(cuMemsetD32(d_b + 16, 9, 2));
    h_words.fill(0);
    SHOW(cuMemcpyDtoH(h_words.data(), d_b, sizeof h_words));
    say_words("synchronous", h_words);

    const CUstream stream = make_stream();
    std::uint64_t* mapped = make_mapped(h_words.size());
    SHOW(launch_wide(gpu.wide, stream));
    SHOW(cuMemsetD16Async(d_a, 3, 4, stream));
    SHOW(cuMemcpyDtoHAsync(mapped, d_a, sizeof h_words, stream));
    SHOW(cuStreamSynchronize(stream));
    std::memcpy(h_words.data(), mapped, sizeof h_words);
    say_words("asynchronous", h_words);
    SHOW(cuStreamQuery(stream));
    SHOW(cuMemFree(d_a));
    SHOW(cuMemFree(d_b));
    return 0;
}

int streams(const Arguments&) {
    const Gpu gpu;
    std::uint64_t* to = make_mapped(16);
    const CUstream plain = make_stream(CU_STREAM_DEFAULT);
    const CUstream non_blocking = make_stream(CU_STREAM_NON_BLOCKING);
    const CUstream kinds[] = {nullptr, CU_STREAM_LEGACY, CU_STREAM_PER_THREAD, plain, non_blocking};
    for (std::size_t i = 0; i < std::size(kinds); ++i) {
        SHOW(launch_wide(gpu.wide, kinds[i]));
        SHOW(launch_store(gpu.store, to + 2 * i, 11 * (i + 1), kinds[i]));
        SHOW(cuStreamSynchronize(kinds[i]));
        say("stream %zu: %llu", i, static_cast<unsigned long long>(to[2 * i]));
    }
    // Waits of other kinds.
    CUevent event = nullptr;
    SHOW(cuEventCreate(&event, CU_EVENT_DISABLE_TIMING));
    SHOW(launch_store(gpu.store, to, 5, plain));
    SHOW(cuEventRecord(event, plain));
    SHOW(cuEventSynchronize(event));
    SHOW(cuEventQuery(event));
    say("after the event: %llu", static_cast<unsigned long long>(to[0]));
    SHOW(launch_store(gpu.store, to, 6, plain));
    SHOW(launch_store(gpu.store, to + 2, 7, non_blocking));
    SHOW(cuCtxSynchronize());
    say("after the context: %llu %llu", static_cast<unsigned long long>(to[0]),
        static_cast<unsigned long long>(to[2]));
    return 0;
}

/// Did the last kernel of that name run on this stream? Waits for it.
void say_stream(const char* kernel, CUstream stream) {
    unsigned long long id = 0;
    MUST(cuCtxSynchronize());
    MUST(cuStreamGetId(stream, &id));
    const auto records = kernel_log(kernel);
    say("%s ran on the stream asked for: %d", kernel,
        !records.empty() && records.back().stream_id == id);
}

// The same work through the entry points for the per-thread default stream.
int per_thread(const Arguments&) {
    const Gpu gpu;
    const auto find = [](const char* name, int version) {
        return entry_point(name, version, CU_GET_PROC_ADDRESS_PER_THREAD_DEFAULT_STREAM);
    };
    const auto launch = reinterpret_cast<decltype(&cuLaunchKernel)>(find("cuLaunchKernel", 7000));
    const auto launch_ex =
        reinterpret_cast<decltype(&cuLaunchKernelEx)>(find("cuLaunchKernelEx", 11060));
    const auto launch_cooperative = reinterpret_cast<decltype(&cuLaunchCooperativeKernel)>(
        find("cuLaunchCooperativeKernel", 9000));
    const auto synchronize =
        reinterpret_cast<decltype(&cuStreamSynchronize)>(find("cuStreamSynchronize", 7000));
    const auto copy = reinterpret_cast<decltype(&cuMemcpyDtoH)>(find("cuMemcpyDtoH", 7000));

    std::uint64_t* to = make_mapped(8);
    const CUstream other = make_stream();
    for (CUstream stream : {CUstream{nullptr}, other}) {
        CUdeviceptr d_to = on_gpu(to);
        std::uint64_t value = 21;
        void* parameters[] = {&d_to, &value, &value};
        SHOW(launch(gpu.store, 1, 1, 1, 1, 1, 1, 0, stream, parameters, nullptr));
        d_to = on_gpu(to + 2), value = 22;
        const CUlaunchConfig config{1, 1, 1, 1, 1, 1, 0, stream, nullptr, 0};
        SHOW(launch_ex(&config, gpu.store, parameters, nullptr));
        d_to = on_gpu(to + 4), value = 23;
        SHOW(launch_cooperative(gpu.store, 1, 1, 1, 1, 1, 1, 0, stream, parameters));
        SHOW(synchronize(stream));
        say("%d %d %d", int(to[0]), int(to[2]), int(to[4]));
        to[0] = to[2] = to[4] = 0;
    }
    if (simulated()) {  // whose log tells streams
        // Null is the thread's own stream here, and the legacy one there.
        const CUlaunchConfig null_stream{1, 1, 1, 1, 1, 1, 0, nullptr, nullptr, 0};
        SHOW(launch(gpu.function("own_1"), 1, 1, 1, 1, 1, 1, 0, nullptr, nullptr, nullptr));
        say_stream("own_1", CU_STREAM_PER_THREAD);
        SHOW(launch_ex(&null_stream, gpu.function("own_2"), nullptr, nullptr));
        say_stream("own_2", CU_STREAM_PER_THREAD);
        SHOW(launch_cooperative(gpu.function("own_3"), 1, 1, 1, 1, 1, 1, 0, nullptr, nullptr));
        say_stream("own_3", CU_STREAM_PER_THREAD);
        const CUfunction legacy_1 = gpu.function("legacy_1");
        SHOW(cuLaunchKernel(legacy_1, 1, 1, 1, 1, 1, 1, 0, nullptr, nullptr, nullptr));
        say_stream("legacy_1", CU_STREAM_LEGACY);
        SHOW(cuLaunchKernelEx(&null_stream, gpu.function("legacy_2"), nullptr, nullptr));
        say_stream("legacy_2", CU_STREAM_LEGACY);
    }

    CUdeviceptr d_word = 0;
    std::uint64_t word = 31;
    SHOW(cuMemAlloc(&d_word, sizeof word));
    SHOW(cuMemcpyHtoD(d_word, &word, sizeof word));
    word = 0;
    SHOW(launch(gpu.tiny, 1, 1, 1, 1, 1, 1, 0, nullptr, nullptr, nullptr));
    SHOW(copy(&word, d_word, sizeof word));
    say("copied %d", int(word));
    return 0;
}

// Handles of unloaded kernels come back as others: what is remembered of them must not.
int modules(const Arguments&) {
    const Gpu gpu;
    std::uint64_t* to = make_mapped(2);
    CUfunction unloaded = nullptr;
    for (int i = 0; i < 12; ++i) {
        CUmodule module = nullptr;
        CUfunction store = nullptr, other = nullptr;
        SHOW(cuModuleLoadData(&module, kImage));
        SHOW(cuModuleGetFunction(&other, module, i % 2 ? "tiny" : "wide"));
        SHOW(cuModuleGetFunction(&store, module, kStoreName));
        SHOW(launch_tiny(other, nullptr));
        SHOW(launch_store(store, to, 40 + std::uint64_t(i), nullptr));
        SHOW(cuCtxSynchronize());
        say("%d", int(to[0]));
        SHOW(cuModuleUnload(module));
        unloaded = store;
    }
    if (simulated()) SHOW(launch_store(unloaded, to, 1, nullptr));  // else undefined
    SHOW(cuModuleUnload(nullptr));

    CUlibrary library = nullptr;
    CUkernel kernel = nullptr;
    SHOW(cuLibraryLoadData(&library, kImage, nullptr, nullptr, 0, nullptr, nullptr, 0));
    SHOW(cuLibraryGetKernel(&kernel, library, kStoreName));
    // A CUkernel may be passed as a CUfunction.
    SHOW(launch_store(reinterpret_cast<CUfunction>(kernel), to, 60, nullptr));
    SHOW(cuCtxSynchronize());
    say("%d", int(to[0]));
    SHOW(cuLibraryUnload(library));
    return 0;
}

const Scenario s1("copies", copies), s2("streams", streams), s3("per_thread", per_thread),
    s4("modules", modules);

}  // namespace
}  // namespace twin
