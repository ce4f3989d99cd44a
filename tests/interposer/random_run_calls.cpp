// SPDX-License-Identifier: Apache-2.0
//
// The driver's calls for a random program's operations.
#include <cstdlib>
#include <memory>
#include <thread>

#include "tests/interposer/random_run.h"

namespace twin {

CUresult Run::run(const Operation& operation) {
    const CUstream stream = stream_of(operation);
    const auto number = static_cast<std::size_t>(operation.value);
    const int index = static_cast<int>(&operation - program_.operations.data());
    switch (operation.kind) {
        case Kind::kMix:
            return launch_mix(operation, stream, machine_.word(operation.word));
        case Kind::kStore:
            return launch_store(machine_.gpu.store,
                                reinterpret_cast<std::uint64_t*>(machine_.word(operation.word)),
                                operation.value, stream);
        case Kind::kTiny:
            return launch_tiny(machine_.gpu.tiny, stream);
        case Kind::kWide:
            return launch_wide(operation.variant % 2 ? machine_.long_ : machine_.gpu.wide, stream);
        case Kind::kCopy:
            return copy(operation, stream);
        case Kind::kMemset:
            return set(operation, stream);
        case Kind::kWriteValue:
            return cuStreamWriteValue64(stream, machine_.word(operation.word), operation.value,
                                        CU_STREAM_WRITE_VALUE_DEFAULT);
        case Kind::kHostMix: {
            Call* const call = new_call(operation, index);
            return operation.variant % 2 ? cuLaunchHostFunc(stream, mix_on_host, call)
                                         : cuStreamAddCallback(stream, mix_in_callback, call, 0);
        }
        case Kind::kPool:
            return use_pool(operation, stream);
        case Kind::kGraph:
            return launch_graph(operation, stream);
        case Kind::kReadBack:
            return read_back(operation);
        case Kind::kRecord:
            return operation.variant % 2 ? cuEventRecord(events_[number], stream)
                                         : cuEventRecordWithFlags(events_[number], stream, 0);
        case Kind::kWaitEvent:
            return cuStreamWaitEvent(stream, events_[number], CU_EVENT_WAIT_DEFAULT);
        case Kind::kWriteFlag:
            return cuStreamWriteValue64(stream, on_gpu(machine_.flags + number), 1,
                                        CU_STREAM_WRITE_VALUE_DEFAULT);
        case Kind::kWaitFlag:
            return operation.variant % 2
                       ? cuStreamWaitValue32(stream, on_gpu(machine_.flags + number), 1,
                                             CU_STREAM_WAIT_VALUE_EQ)
                       : cuStreamWaitValue64(stream, on_gpu(machine_.flags + number), 1,
                                             CU_STREAM_WAIT_VALUE_GEQ);
        case Kind::kStreamSync:
            return is_per_thread(operation) ? machine_.synchronize_ptsz(nullptr)
                                            : cuStreamSynchronize(stream);
        case Kind::kEventSync:
            return cuEventSynchronize(events_[number]);
        case Kind::kPoll:
            return poll(stream);
        case Kind::kContextSync:
            return cuCtxSynchronize();
        case Kind::kAllocFree: {
            CUdeviceptr memory = 0;
            if (const CUresult result = cuMemAlloc(&memory, 4096)) return result;
            return cuMemFree(memory);
        }
        case Kind::kRegister:
            return register_and_back();
        case Kind::kLoadUnload: {
            CUmodule module = nullptr;
            if (const CUresult result = cuModuleLoadData(&module, kImage)) return result;
            return cuModuleUnload(module);
        }
        case Kind::kQuery: {
            const CUresult result = cuStreamQuery(stream);  // either may be right
            return result == CUDA_ERROR_NOT_READY ? CUDA_SUCCESS : result;
        }
        case Kind::kRefused:
            return refused(operation, stream);
    }
    return CUDA_ERROR_UNKNOWN;
}

CUresult Run::launch_mix(const Operation& operation, CUstream stream, CUdeviceptr word) const {
    std::uint64_t value = operation.value;
    void* parameters[] = {&word, &value};
    CUlaunchAttribute attribute{};
    attribute.id = CU_LAUNCH_ATTRIBUTE_PRIORITY;
    attribute.value.priority = -static_cast<int>(operation.variant / 8 % 6);
    CUlaunchConfig config{1, 1, 1, 1, 1, 1, 0, stream, &attribute, 1};
    switch (operation.variant % 8) {
        case 0:
            config.numAttrs = 0;
            return cuLaunchKernelEx(&config, machine_.mix, parameters, nullptr);
        case 1:
            return cuLaunchKernelEx(&config, machine_.mix, parameters, nullptr);
        case 2:
            return cuLaunchCooperativeKernel(machine_.mix, 1, 1, 1, 1, 1, 1, 0, stream, parameters);
        case 3:
            if (is_per_thread(operation))
                return machine_.launch_ptsz(machine_.mix, 1, 1, 1, 1, 1, 1, 0, nullptr, parameters,
                                            nullptr);
            [[fallthrough]];
        default:
            return cuLaunchKernel(machine_.mix, 1, 1, 1, 1, 1, 1, 0, stream, parameters, nullptr);
    }
}

CUresult Run::launch_graph(const Operation& operation, CUstream stream) {
    const CUstream capturing = machine_.capturing[static_cast<std::size_t>(operation.thread)];
    const CUdeviceptr word = machine_.word(operation.word), other = machine_.word(operation.from);
    // In the global mode other threads' calls may fail, which is theirs to know.
    const auto mode = program_.num_threads == 1 ? CU_STREAM_CAPTURE_MODE_GLOBAL
                      : operation.variant % 2   ? CU_STREAM_CAPTURE_MODE_THREAD_LOCAL
                                                : CU_STREAM_CAPTURE_MODE_RELAXED;
    if (const CUresult result = cuStreamBeginCapture(capturing, mode)) return result;
    CUresult sum = launch_mix(operation, capturing, word);
    const auto add = [&sum](CUresult result) {
        if (sum == CUDA_SUCCESS) sum = result;
    };
    add(launch_tiny(machine_.gpu.tiny, capturing));
    add(cuMemcpyDtoDAsync(other, word, sizeof(std::uint64_t), capturing));
    if (operation.word < kNumHostWords)
        add(cuLaunchHostFunc(capturing, mix_on_host, new_call(operation, -1)));
    add(launch_mix(operation, capturing, other));
    CUgraph graph = nullptr;
    CUgraphExec executable = nullptr;
    add(cuStreamEndCapture(capturing, &graph));
    if (sum != CUDA_SUCCESS) return sum;
    add(cuGraphInstantiate(&executable, graph, 0));
    if (sum != CUDA_SUCCESS) return sum;
    for (unsigned i = 0; i <= operation.variant / 2 % 2; ++i)
        add(cuGraphLaunch(executable, stream));
    add(cuGraphExecDestroy(executable));
    add(cuGraphDestroy(graph));
    return sum;
}

CUresult Run::use_pool(const Operation& operation, CUstream stream) const {
    CUdeviceptr memory = 0;
    if (const CUresult result = cuMemAllocAsync(&memory, 256, stream)) return result;
    CUresult sum = cuMemcpyDtoDAsync(memory, machine_.word(operation.from), kWordBytes, stream);
    const auto add = [&sum](CUresult result) {
        if (sum == CUDA_SUCCESS) sum = result;
    };
    add(launch_mix(operation, stream, memory));
    add(cuMemcpyAsync(machine_.word(operation.word), memory, kWordBytes, stream));
    add(cuMemFreeAsync(memory, stream));
    return sum;
}

CUresult Run::copy(const Operation& operation, CUstream stream) const {
    const CUdeviceptr to = machine_.word(operation.word), from = machine_.word(operation.from);
    if (is_per_thread(operation) && operation.variant % 2)
        return machine_.copy_ptsz(to, from, kWordBytes, nullptr);
    if (!stream && operation.variant % 4 == 1) return cuMemcpy(to, from, kWordBytes);
    if (operation.from < kNumHostWords && operation.variant % 4 == 2)
        return cuMemcpyHtoDAsync(to, reinterpret_cast<const void*>(from), kWordBytes, stream);
    if (operation.word < kNumHostWords && operation.variant % 4 == 3)
        return cuMemcpyDtoHAsync(reinterpret_cast<void*>(to), from, kWordBytes, stream);
    return cuMemcpyAsync(to, from, kWordBytes, stream);
}

CUresult Run::set(const Operation& operation, CUstream stream) const {
    const CUdeviceptr word = machine_.word(operation.word);
    const auto value = static_cast<unsigned>(operation.value);
    switch (operation.variant % 4) {
        case 0:
            return cuMemsetD8Async(word, static_cast<unsigned char>(value), 5, stream);
        case 1:
            return cuMemsetD16Async(word, static_cast<unsigned short>(value), 3, stream);
        case 2:
            if (!stream) return cuMemsetD32(word, value, 4);
            [[fallthrough]];
        default:
            return cuMemsetD32Async(word, value, 4, stream);
    }
}

CUresult Run::read_back(const Operation& operation) {
    std::uint64_t found = 0;
    const auto copy = is_per_thread(operation) ? machine_.copy_to_host_ptds : cuMemcpyDtoH;
    const CUresult result = copy(&found, machine_.word(operation.word), sizeof found);
    read_[static_cast<std::size_t>(operation.thread)].add(found);
    if (verbose_) say("read %016llx", static_cast<unsigned long long>(found));
    return result;
}

CUresult Run::poll(CUstream stream) const {
    while (true) {
        const CUresult result = cuStreamQuery(stream);
        if (result != CUDA_ERROR_NOT_READY) return result;
        std::this_thread::yield();
    }
}

CUresult Run::register_and_back() {
    constexpr std::size_t kPage = 4096;
    const std::unique_ptr<void, decltype(&std::free)> page(std::aligned_alloc(kPage, kPage),
                                                           &std::free);
    if (const CUresult result = cuMemHostRegister(page.get(), kPage, 0)) return result;
    return cuMemHostUnregister(page.get());
}

CUresult Run::refused(const Operation& operation, CUstream stream) const {
    switch (operation.variant) {
        case 0:
            return cuLaunchKernel(machine_.gpu.tiny, 0, 1, 1, 1, 1, 1, 0, stream, nullptr, nullptr);
        case 1:
            return cuLaunchKernel(machine_.gpu.tiny, 1, 1, 1, 2048, 1, 1, 0, stream, nullptr,
                                  nullptr);
        default:
            return cuMemsetD32Async(machine_.word(0) + 1, 0, 1, stream);
    }
}

}  // namespace twin
