// SPDX-License-Identifier: Apache-2.0
//
// Writes down when every kernel of a program began and ended, as CUPTI saw it. Loaded by the driver
// (CUDA_INJECTION64_PATH) into a program that runs without UrgenGo; built by stamps_check.py.
// CUPTI_KERNELS names the file: a line for each kernel, in no order: stream, begin, end, name.
#include <cupti.h>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>

namespace {

constexpr std::size_t kBufferBytes = 4 << 20;
constexpr std::size_t kBufferAlignment = 8;

std::FILE* out = nullptr;
std::mutex mutex;  // guards `out`

bool succeeded(CUptiResult result, const char* what) {
    if (result == CUPTI_SUCCESS) return true;
    const char* text = "no description";
    cuptiGetResultString(result, &text);
    std::fprintf(stderr, "cupti_kernels: %s: %s\n", what, text);
    return false;
}

void CUPTIAPI give_buffer(std::uint8_t** buffer, std::size_t* size, std::size_t* max_records) {
    *size = kBufferBytes;
    *max_records = 0;
    *buffer = static_cast<std::uint8_t*>(std::aligned_alloc(kBufferAlignment, kBufferBytes));
}

void write(const CUpti_ActivityKernel9& kernel) {
    std::fprintf(out, "%u %llu %llu %s\n", kernel.streamId,
                 static_cast<unsigned long long>(kernel.start),
                 static_cast<unsigned long long>(kernel.end), kernel.name);
}

void CUPTIAPI take_buffer(CUcontext context, std::uint32_t stream, std::uint8_t* buffer,
                          std::size_t, std::size_t valid_bytes) {
    const std::lock_guard lock(mutex);
    CUpti_Activity* record = nullptr;
    while (out && cuptiActivityGetNextRecord(buffer, valid_bytes, &record) == CUPTI_SUCCESS) {
        if (record->kind != CUPTI_ACTIVITY_KIND_CONCURRENT_KERNEL) continue;
        // Later versions of the record only add to its end.
        CUpti_ActivityKernel9 kernel;
        std::memcpy(&kernel, record, sizeof(kernel));
        write(kernel);
    }
    std::size_t dropped = 0;
    cuptiActivityGetNumDroppedRecords(context, stream, &dropped);
    if (dropped) std::fprintf(stderr, "cupti_kernels: %zu records dropped\n", dropped);
    std::free(buffer);
}

void finish() {
    succeeded(cuptiActivityFlushAll(CUPTI_ACTIVITY_FLAG_FLUSH_FORCED), "flush");
    const std::lock_guard lock(mutex);
    if (out && std::fclose(out) != 0) std::perror("cupti_kernels: cannot write the file");
    out = nullptr;
}

}  // namespace

/// Called by the driver when it starts. @returns 1
extern "C" int InitializeInjection() {
    const char* path = std::getenv("CUPTI_KERNELS");
    out = path ? std::fopen(path, "w") : nullptr;
    if (!out) {
        std::perror("cupti_kernels: cannot write what CUPTI_KERNELS names");
        return 1;
    }
    if (succeeded(cuptiActivityRegisterCallbacks(give_buffer, take_buffer), "callbacks") &&
        succeeded(cuptiActivityEnable(CUPTI_ACTIVITY_KIND_CONCURRENT_KERNEL), "kernels"))
        std::atexit(finish);
    return 1;
}
