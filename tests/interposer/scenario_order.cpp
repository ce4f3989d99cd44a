// SPDX-License-Identifier: Apache-2.0
//
// Order: everything that a stream takes happens in the order of the calls, and across streams as
// events and values say. Host callbacks, and what they find in memory, are the witnesses.
#include <mutex>
#include <string>
#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

/// A witness: called by a stream, notes its name and the word it looks at.
struct Witness {
    const char* name;
    const std::uint64_t* word;
};

std::mutex g_mutex;
std::vector<std::string> g_log;

void CUDA_CB note(void* data) {
    const auto* witness = static_cast<const Witness*>(data);
    const std::lock_guard lock(g_mutex);
    g_log.push_back(std::string(witness->name) + " saw " + std::to_string(*witness->word));
}

void CUDA_CB note_callback(CUstream, CUresult status, void* data) {
    note(data);
    const std::lock_guard lock(g_mutex);
    g_log.back() += ", status " + std::to_string(status);
}

void say_log() {
    const std::lock_guard lock(g_mutex);
    for (const std::string& line : g_log) say("%s", line.c_str());
    g_log.clear();
}

// Nothing may be overtaken: launches of every kind, copies, memsets, memory operations, pool
// allocations, host functions and callbacks, on one stream.
void one_stream(const Gpu& gpu, CUstream stream) {
    std::uint64_t* word = make_mapped(2);
    const CUdeviceptr d_word = on_gpu(word);
    std::uint64_t* source = make_mapped(1);
    *source = 3;
    Witness first{"after store", word}, second{"after copy", word}, third{"after write", word},
        fourth{"after cooperative", word}, fifth{"after memset", word}, sixth{"after wide", word};
    std::uint64_t value = 5;
    CUdeviceptr d_to = d_word, pool = 0;
    void* parameters[] = {&d_to, &value, &value};

    SHOW(launch_wide(gpu.wide, stream));
    SHOW(launch_store(gpu.store, word, 2, stream));
    SHOW(cuLaunchHostFunc(stream, note, &first));
    SHOW(cuMemcpyAsync(d_word, on_gpu(source), sizeof *source, stream));
    SHOW(cuStreamAddCallback(stream, note_callback, &second, 0));
    SHOW(launch_wide(gpu.wide, stream));
    SHOW(cuStreamWriteValue32(stream, d_word, 4, CU_STREAM_WRITE_VALUE_DEFAULT));
    SHOW(cuLaunchHostFunc(stream, note, &third));
    SHOW(cuLaunchCooperativeKernel(gpu.store, 1, 1, 1, 1, 1, 1, 0, stream, parameters));
    SHOW(cuStreamAddCallback(stream, note_callback, &fourth, 0));
    SHOW(cuMemAllocAsync(&pool, 256, stream));
    SHOW(launch_wide(gpu.wide, stream));
    SHOW(cuMemsetD32Async(d_word, 6, 1, stream));
    SHOW(cuLaunchHostFunc(stream, note, &fifth));
    SHOW(cuMemFreeAsync(pool, stream));
    SHOW(launch_wide(gpu.wide, stream));
    SHOW(launch_store(gpu.store, word, 7, stream));
    SHOW(cuLaunchHostFunc(stream, note, &sixth));
    SHOW(cuStreamSynchronize(stream));
    say_log();
}

// Ping-pong between two streams by events.
void by_events(const Gpu& gpu) {
    std::uint64_t* word = make_mapped(2);
    const CUstream streams[] = {make_stream(), make_stream(CU_STREAM_DEFAULT)};
    CUevent event = nullptr;
    SHOW(cuEventCreate(&event, CU_EVENT_DISABLE_TIMING));
    std::vector<std::string> names;
    std::vector<Witness> witnesses;
    for (int i = 0; i < 10; ++i) names.push_back("ping " + std::to_string(i));
    for (const std::string& name : names) witnesses.push_back({name.c_str(), word});
    for (std::size_t i = 0; i < witnesses.size(); ++i) {
        const CUstream here = streams[i % 2], there = streams[(i + 1) % 2];
        MUST(launch_wide(gpu.wide, here));
        MUST(launch_store(gpu.store, word, i, here));
        MUST(cuLaunchHostFunc(here, note, &witnesses[i]));
        MUST(cuEventRecord(event, here));
        MUST(cuStreamWaitEvent(there, event, CU_EVENT_WAIT_DEFAULT));
    }
    SHOW(cuStreamSynchronize(streams[0]));
    SHOW(cuStreamSynchronize(streams[1]));
    SHOW(cuEventQuery(event));
    say_log();
}

// One stream waits for a value that the other writes, and was launched into first: a launch on the
// other one must not be kept back for it.
void by_values(const Gpu& gpu) {
    std::uint64_t* word = make_mapped(2);
    std::uint64_t* flag = make_mapped(1);
    const CUstream waits = make_stream(), writes = make_stream();
    Witness waited{"waiting stream", word}, wrote{"writing stream", word};
    SHOW(launch_wide(gpu.wide, waits));
    SHOW(cuStreamWaitValue32(waits, on_gpu(flag), 1, CU_STREAM_WAIT_VALUE_GEQ));
    SHOW(launch_store(gpu.store, word, 9, waits));
    SHOW(cuLaunchHostFunc(waits, note, &waited));
    SHOW(launch_wide(gpu.wide, waits));
    SHOW(launch_wide(gpu.wide, writes));
    SHOW(launch_store(gpu.store, word, 8, writes));
    SHOW(cuLaunchHostFunc(writes, note, &wrote));
    SHOW(cuStreamWriteValue32(writes, on_gpu(flag), 1, CU_STREAM_WRITE_VALUE_DEFAULT));
    SHOW(cuStreamSynchronize(waits));
    SHOW(cuStreamSynchronize(writes));
    say_log();
}

// A synchronous copy on the legacy stream comes after what blocking streams have.
void by_legacy_copy(const Gpu& gpu) {
    std::uint64_t* word = make_mapped(2);
    const CUstream blocking = make_stream(CU_STREAM_DEFAULT);
    std::uint64_t seen = 0;
    MUST(launch_wide(gpu.wide, blocking));
    MUST(launch_store(gpu.store, word, 12, blocking));
    SHOW(cuMemcpy(reinterpret_cast<CUdeviceptr>(&seen), on_gpu(word), sizeof seen));
    say("copied %d", int(seen));
    CUdeviceptr d_word = 0;
    MUST(cuMemAlloc(&d_word, sizeof seen));
    MUST(launch_wide(gpu.wide, nullptr));
    MUST(cuMemsetD32Async(d_word, 13, 2, nullptr));
    SHOW(cuMemcpyDtoH(&seen, d_word, sizeof seen));
    say("copied %llx", static_cast<unsigned long long>(seen));
}

// The legacy stream and a blocking one wait for each other, whatever stands in for their kernels.
void by_legacy_rule(const Gpu& gpu) {
    std::uint64_t* word = make_mapped(2);
    const CUstream blocking = make_stream(CU_STREAM_DEFAULT);
    Witness behind_legacy{"behind legacy", word}, behind_blocking{"behind blocking", word};
    SHOW(launch_wide(gpu.wide, nullptr));
    SHOW(launch_store(gpu.store, word, 21, nullptr));
    SHOW(launch_tiny(gpu.tiny, blocking));
    SHOW(cuLaunchHostFunc(blocking, note, &behind_legacy));
    SHOW(cuStreamSynchronize(blocking));
    SHOW(launch_wide(gpu.wide, blocking));
    SHOW(launch_store(gpu.store, word, 22, blocking));
    SHOW(launch_tiny(gpu.tiny, nullptr));
    SHOW(cuLaunchHostFunc(nullptr, note, &behind_blocking));
    SHOW(cuStreamSynchronize(nullptr));
    say_log();
}

int order(const Arguments&) {
    const Gpu gpu;
    one_stream(gpu, make_stream());
    one_stream(gpu, nullptr);
    one_stream(gpu, CU_STREAM_PER_THREAD);
    by_events(gpu);
    by_values(gpu);
    by_legacy_copy(gpu);
    by_legacy_rule(gpu);
    return 0;
}

const Scenario s1("order", order);

}  // namespace
}  // namespace twin
