// SPDX-License-Identifier: Apache-2.0
//
// Copies that are large enough to be cut: by every entry point, on every kind of stream, from and
// to every kind of memory; in captures, and where they are refused. And two threads that copy, one
// much and one little and urgent, for test_copies.cpp: that one is meant to differ under UrgenGo.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <functional>
#include <thread>
#include <vector>

#include <urgengo/urgengo.h>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

/// No multiple of anything, and more than a few slices of the tests' 64 KiB. Copies on the device
/// are cut 16 times coarser.
constexpr std::size_t kBytes = (3u << 20) + 12'345;

std::uint8_t* make_host(std::size_t bytes) {
    void* memory = nullptr;
    MUST(cuMemHostAlloc(&memory, bytes, CU_MEMHOSTALLOC_PORTABLE | CU_MEMHOSTALLOC_DEVICEMAP));
    return static_cast<std::uint8_t*>(memory);
}

CUdeviceptr make_device(std::size_t bytes) {
    CUdeviceptr memory = 0;
    MUST(cuMemAlloc(&memory, bytes));
    return memory;
}

// By words and unwatched: megabytes take a sanitizer longer than all the rest.
#define UNSANITIZED __attribute__((no_sanitize("address", "undefined", "thread")))
constexpr std::size_t kWord = sizeof(std::uint64_t);

UNSANITIZED void fill(std::uint8_t* memory, std::size_t bytes, unsigned seed) {
    const auto word = [seed](std::size_t i) UNSANITIZED {
        return std::uint64_t{i * 257 + seed + 1} * 0x9e3779b97f4a7c15u;
    };
    std::size_t i = 0;
    for (; i + kWord <= bytes; i += kWord) {
        const std::uint64_t whole = word(i);
        __builtin_memcpy(memory + i, &whole, kWord);
    }
    for (; i < bytes; ++i) memory[i] = static_cast<std::uint8_t>(word(i));
}

UNSANITIZED unsigned long long hash(const std::uint8_t* memory, std::size_t bytes) {
    std::uint64_t h = 1469598103934665603u;
    const auto add = [&h](std::uint64_t value) UNSANITIZED {
        h = (h ^ value) * 1099511628211u;
        h ^= h >> 32;
    };
    std::size_t i = 0;
    for (; i + kWord <= bytes; i += kWord) {
        std::uint64_t whole;
        __builtin_memcpy(&whole, memory + i, kWord);
        add(whole);
    }
    for (; i < bytes; ++i) add(memory[i]);
    return h;
}

/// All memory that is copied from and to.
struct Memory {
    std::uint8_t *host = make_host(kBytes), *host_to = make_host(kBytes);
    CUdeviceptr device = make_device(2 * kBytes), device_to = make_device(kBytes), managed = 0;
    std::vector<std::uint8_t> pageable = std::vector<std::uint8_t>(kBytes), part = pageable;

    Memory() {
        MUST(cuMemAllocManaged(&managed, kBytes, CU_MEM_ATTACH_GLOBAL));
        // All of it but a last page is page-locked.
        MUST(cuMemHostRegister(part.data(), kBytes, 0));
    }
    void reset(unsigned seed) {
        for (std::uint8_t* memory : {host, pageable.data(), part.data()})
            fill(memory, kBytes, seed);
        fill(host_to, kBytes, seed + 1);
        std::vector<std::uint8_t> pattern(2 * kBytes);
        fill(pattern.data(), 2 * kBytes, seed + 2);
        MUST(cuMemcpyHtoD(device, pattern.data(), 2 * kBytes));
        MUST(cuMemcpyHtoD(managed, pattern.data(), kBytes));
        MUST(cuMemsetD8(device_to, 0, kBytes));
        MUST(cuCtxSynchronize());
    }
    unsigned long long sum() {
        std::vector<std::uint8_t> found(2 * kBytes);
        unsigned long long all = hash(host, kBytes) ^ 3 * hash(host_to, kBytes) ^
                                 5 * hash(pageable.data(), kBytes) ^ 7 * hash(part.data(), kBytes);
        MUST(cuMemcpyDtoH(found.data(), device, 2 * kBytes));
        all ^= 11 * hash(found.data(), 2 * kBytes);
        MUST(cuMemcpyDtoH(found.data(), device_to, kBytes));
        all ^= 13 * hash(found.data(), kBytes);
        MUST(cuMemcpyDtoH(found.data(), managed, kBytes));
        return all ^ 17 * hash(found.data(), kBytes);
    }
};

CUdeviceptr address(const void* on_host) {
    return reinterpret_cast<CUdeviceptr>(on_host);
}

struct Call {
    const char* name;
    std::function<CUresult(CUstream)> copy;
    std::function<CUresult(CUstream)> then = {};  ///< overwrites what was copied
};

std::vector<Call> all_calls(Memory& m) {
    const auto overwrite_device = [&m](CUstream s) {
        return cuMemsetD8Async(m.device, 9, 2 * kBytes, s);
    };
    return {
        {"HtoD", [&m](CUstream s) { return cuMemcpyHtoDAsync(m.device_to, m.host, kBytes, s); }},
        {"HtoD inside",
         [&m](CUstream s) {
             return cuMemcpyHtoDAsync(m.device_to + 5, m.host + 3, kBytes - 5, s);
         }},
        {"HtoD registered",
         [&m](CUstream s) { return cuMemcpyHtoDAsync(m.device_to, m.part.data(), kBytes, s); }},
        {"HtoD pageable",
         [&m](CUstream s) {
             const CUresult result = cuMemcpyHtoDAsync(m.device_to, m.pageable.data(), kBytes, s);
             fill(m.pageable.data(), kBytes, 99);  // it was read when the call returned
             return result;
         }},
        {"DtoH", [&m](CUstream s) { return cuMemcpyDtoHAsync(m.host_to, m.device, kBytes, s); },
         overwrite_device},
        {"DtoH pageable",
         [&m](CUstream s) {
             const CUresult result = cuMemcpyDtoHAsync(m.pageable.data(), m.device, kBytes, s);
             say("there at once: %llx", hash(m.pageable.data(), kBytes));
             return result;
         }},
        {"DtoD",
         [&m](CUstream s) { return cuMemcpyDtoDAsync(m.device_to, m.device + 1, kBytes, s); },
         overwrite_device},
        {"DtoD beside",
         [&m](CUstream s) { return cuMemcpyDtoDAsync(m.device + kBytes, m.device, kBytes, s); }},
        {"from host",
         [&m](CUstream s) { return cuMemcpyAsync(m.device_to, address(m.host), kBytes, s); }},
        {"to host",
         [&m](CUstream s) { return cuMemcpyAsync(address(m.host_to), m.device, kBytes, s); },
         overwrite_device},
        {"on device", [&m](CUstream s) { return cuMemcpyAsync(m.device_to, m.device, kBytes, s); },
         overwrite_device},
        {"host to host",
         [&m](CUstream s) {
             return cuMemcpyAsync(address(m.host_to), address(m.host), kBytes, s);
         }},
        {"from managed",
         [&m](CUstream s) { return cuMemcpyAsync(m.device_to, m.managed, kBytes, s); }},
        {"to managed",
         [&m](CUstream s) { return cuMemcpyHtoDAsync(m.managed, m.host, kBytes, s); }},
        {"nothing", [&m](CUstream s) { return cuMemcpyHtoDAsync(m.device_to, m.host, 0, s); }}};
}

/// What a host function behind the copy sees.
struct Seen {
    Memory* memory;
    unsigned long long host = 0;
};

void CUDA_CB look(void* data) {
    auto& seen = *static_cast<Seen*>(data);
    seen.host = hash(seen.memory->host_to, kBytes);
}

void check(const Gpu& gpu, Memory& memory, const Call& call, const char* stream_name,
           CUstream stream) {
    memory.reset(1);
    Seen seen{&memory};
    CUevent event = nullptr;
    MUST(cuEventCreate(&event, CU_EVENT_DEFAULT));
    MUST(launch_wide(gpu.wide, stream));
    errno = kErrno;
    const CUresult result = call.copy(stream);
    const int errno_after = errno;
    MUST(cuEventRecord(event, stream));
    MUST(cuLaunchHostFunc(stream, look, &seen));
    if (call.then) MUST(call.then(stream));
    MUST(launch_tiny(gpu.tiny, stream));
    MUST(cuEventSynchronize(event));
    MUST(cuStreamSynchronize(stream));
    MUST(cuEventDestroy(event));
    say("%s on the %s stream: %d, errno %d, %llx, %llx", call.name, stream_name, result,
        errno_after, seen.host, memory.sum());
}

int large_copies(const Arguments&) {
    const Gpu gpu;
    Memory memory;
    MUST(launch_tiny(gpu.tiny, nullptr));
    const std::pair<const char*, CUstream> streams[] = {
        {"legacy", nullptr},
        {"per-thread", CU_STREAM_PER_THREAD},
        {"blocking", make_stream(CU_STREAM_DEFAULT)},
        {"non-blocking", make_stream()}};
    for (const auto& [name, stream] : streams)
        for (const Call& call : all_calls(memory)) check(gpu, memory, call, name, stream);

    // The entry points whose null stream is the thread's own.
    using Htod = decltype(&cuMemcpyHtoDAsync);
    using Dtoh = decltype(&cuMemcpyDtoHAsync);
    using Dtod = decltype(&cuMemcpyDtoDAsync);
    using Any = decltype(&cuMemcpyAsync);
    constexpr auto kPerThread = CU_GET_PROC_ADDRESS_PER_THREAD_DEFAULT_STREAM;
    const auto htod = reinterpret_cast<Htod>(entry_point("cuMemcpyHtoDAsync", 7000, kPerThread));
    const auto dtoh = reinterpret_cast<Dtoh>(entry_point("cuMemcpyDtoHAsync", 7000, kPerThread));
    const auto dtod = reinterpret_cast<Dtod>(entry_point("cuMemcpyDtoDAsync", 7000, kPerThread));
    const auto any = reinterpret_cast<Any>(entry_point("cuMemcpyAsync", 7000, kPerThread));
    const Call own[] = {
        {"HtoD", [&](CUstream) { return htod(memory.device_to, memory.host, kBytes, nullptr); }},
        {"DtoH", [&](CUstream) { return dtoh(memory.host_to, memory.device, kBytes, nullptr); }},
        {"DtoD", [&](CUstream) { return dtod(memory.device_to, memory.device, kBytes, nullptr); }},
        {"any",
         [&](CUstream) { return any(memory.device_to, address(memory.host), kBytes, nullptr); }}};
    for (const Call& call : own) check(gpu, memory, call, "thread's own", CU_STREAM_PER_THREAD);
    return 0;
}

// A captured copy is one node, whatever its size.
int large_copies_captured(const Arguments&) {
    const Gpu gpu;
    Memory memory;
    MUST(launch_tiny(gpu.tiny, nullptr));
    const CUstream stream = make_stream(), other = make_stream();
    for (const auto mode : {CU_STREAM_CAPTURE_MODE_GLOBAL, CU_STREAM_CAPTURE_MODE_RELAXED}) {
        memory.reset(2);
        CUgraph graph = nullptr;
        CUgraphExec executable = nullptr;
        MUST(cuStreamBeginCapture(stream, mode));
        SHOW(cuMemcpyHtoDAsync(memory.device_to, memory.host, kBytes, stream));
        SHOW(cuMemcpyDtoHAsync(memory.host_to, memory.device_to, kBytes, stream));
        // On a stream beside, while that one captures.
        SHOW(cuMemcpyDtoHAsync(memory.host_to, memory.device, kBytes, other));
        MUST(cuStreamEndCapture(stream, &graph));
        MUST(cuStreamSynchronize(other));
        std::size_t num_nodes = 0;
        MUST(cuGraphGetNodes(graph, nullptr, &num_nodes));
        say("%zu nodes, %llx", num_nodes, memory.sum());
        MUST(cuGraphInstantiate(&executable, graph, 0));
        MUST(cuGraphLaunch(executable, stream));
        MUST(cuStreamSynchronize(stream));
        say("%llx", memory.sum());
        MUST(cuGraphExecDestroy(executable));
        MUST(cuGraphDestroy(graph));
    }
    return 0;
}

// What is refused is refused as a whole: not a byte has been copied.
int large_copies_refused(const Arguments&) {
    const Gpu gpu;
    Memory memory;
    MUST(launch_tiny(gpu.tiny, nullptr));
    const CUstream stream = make_stream();
    memory.reset(3);
    SHOW(cuMemcpyHtoDAsync(memory.device_to, memory.host, kBytes + 1, stream));
    SHOW(cuMemcpyHtoDAsync(memory.device_to + 1, memory.host, kBytes, stream));
    SHOW(cuMemcpyHtoDAsync(memory.device_to, memory.host + 1, kBytes, stream));
    SHOW(cuMemcpyHtoDAsync(0, memory.host, kBytes, stream));
    SHOW(cuMemcpyHtoDAsync(memory.device_to, nullptr, kBytes, stream));
    SHOW(cuMemcpyHtoDAsync(address(memory.pageable.data()), memory.host, kBytes, stream));
    SHOW(cuMemcpyDtoHAsync(memory.host_to, memory.device_to, kBytes + 1, stream));
    SHOW(cuMemcpyDtoHAsync(memory.host_to, memory.device + kBytes + 1, kBytes, stream));
    SHOW(cuMemcpyDtoHAsync(memory.host_to, address(memory.pageable.data()), kBytes, stream));
    SHOW(cuMemcpyDtoDAsync(memory.device_to, memory.device, kBytes + 1, stream));
    SHOW(cuMemcpyAsync(memory.device_to, address(memory.host), kBytes + 1, stream));
    SHOW(cuMemcpyAsync(memory.device_to, memory.device + kBytes + 1, kBytes, stream));
    MUST(cuStreamSynchronize(stream));
    say("%llx", memory.sum());
    // A copy of several allocations, side by side or not.
    SHOW(cuMemcpyHtoDAsync(memory.device_to, memory.part.data(), 2 * kBytes, stream));
    MUST(cuStreamSynchronize(stream));
    say("%llx", memory.sum());
    return 0;
}

using Clock = std::chrono::steady_clock;

std::int64_t us_since(Clock::time_point begin) {
    return std::chrono::duration_cast<std::chrono::microseconds>(Clock::now() - begin).count();
}

// One thread copies much, the other, in the middle of that, a little: how long each takes, in
// microseconds, the least of a few times.
int copies_beside(const Arguments&) {
    ug_hints hints;
    ug_hints_load(&hints);
    const Gpu gpu;
    constexpr std::size_t kMuch = 64u << 20, kLittle = 64u << 10;
    const CUdeviceptr large = make_device(kMuch), small = make_device(kLittle);
    std::uint8_t* const h_large = make_host(kMuch);
    std::uint8_t* const h_small = make_host(kLittle);
    MUST(launch_tiny(gpu.tiny, nullptr));
    MUST(cuCtxSynchronize());
    const CUstream bulk = make_stream(), urgent = make_stream();
    std::int64_t least_wait = 1'000'000, least_bulk = 1'000'000;
    for (int i = 0; i < 5; ++i) {
        std::atomic<bool> begun{false};
        std::thread copier([&] {
            MUST(cuCtxSetCurrent(gpu.context));
            hints.task_begin(hints.arrival("loose", 0, UG_CLOCK_MONOTONIC), "work");
            const auto begin = Clock::now();
            begun = true;
            MUST(cuMemcpyHtoDAsync(large, h_large, kMuch, bulk));
            MUST(cuStreamSynchronize(bulk));
            least_bulk = std::min(least_bulk, us_since(begin));
            hints.task_end();
        });
        hints.task_begin(hints.arrival("tight", 0, UG_CLOCK_MONOTONIC), "work");
        while (!begun) std::this_thread::yield();
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
        const auto begin = Clock::now();
        MUST(cuMemcpyHtoDAsync(small, h_small, kLittle, urgent));
        MUST(cuStreamSynchronize(urgent));
        least_wait = std::min(least_wait, us_since(begin));
        hints.task_end();
        copier.join();
    }
    say("%lld %lld", static_cast<long long>(least_wait), static_cast<long long>(least_bulk));
    return 0;
}

const Scenario s1("large_copies", large_copies), s2("large_copies_captured", large_copies_captured),
    s3("large_copies_refused", large_copies_refused, Runs::kSimulated),
    s4("copies_beside", copies_beside);

}  // namespace
}  // namespace twin
