// SPDX-License-Identifier: Apache-2.0
#include "host/exec/progress_marks.h"

#include <sys/mman.h>

#include "device/device_image.h"

namespace urgengo::exec {

const MarkContext* ProgressMarks::find(unsigned long long id) const {
    const int n = num_contexts_.load(std::memory_order_acquire);
    for (int i = 0; i < n; ++i)
        if (contexts_[i].id == id) return &contexts_[i];
    return nullptr;
}

const MarkContext* ProgressMarks::prepare() {
    CUcontext current = nullptr;
    unsigned long long id = 0;
    if (!driver_.cuCtxGetId || !driver_.cuLaunchKernelEx) return nullptr;  // before CUDA 12
    if (driver_.cuCtxGetCurrent(&current) != CUDA_SUCCESS || !current) return nullptr;
    if (driver_.cuCtxGetId(current, &id) != CUDA_SUCCESS) return nullptr;
    const MarkContext* context = find(id);
    if (!context) context = load(id);
    return context && context->kernel ? context : nullptr;
}

const MarkContext* ProgressMarks::load(unsigned long long id) {
    if (num_contexts_.load(std::memory_order_relaxed) == kMaxContexts) return nullptr;
    const std::lock_guard lock(mutex_);
    if (const MarkContext* context = find(id)) return context;
    const int n = num_contexts_.load(std::memory_order_relaxed);
    if (n == kMaxContexts) return nullptr;
    MarkContext& context = contexts_[n];
    context.id = id;
    if (!set_up(context)) context.kernel = nullptr;
    num_contexts_.store(n + 1, std::memory_order_release);
    return &context;
}

bool ProgressMarks::set_up(MarkContext& context) const {
    const RelaxedCaptureMode relaxed(driver_);
    if (driver_.cuCtxGetStreamPriorityRange(&context.least_priority, &context.greatest_priority) !=
        CUDA_SUCCESS)
        return false;

    int threads_per_sm = 0;
    if (driver_.cuCtxGetDevice(&context.device) != CUDA_SUCCESS ||
        driver_.cuDeviceGetAttribute(&context.num_sms, CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT,
                                     context.device) != CUDA_SUCCESS ||
        driver_.cuDeviceGetAttribute(&threads_per_sm,
                                     CU_DEVICE_ATTRIBUTE_MAX_THREADS_PER_MULTIPROCESSOR,
                                     context.device) != CUDA_SUCCESS)
        return false;
    context.resident_threads = static_cast<double>(context.num_sms) * threads_per_sm;

    // Readers may look at the lines for as long as the process lives.
    CUmodule module = nullptr;
    context.lines = allocate_lines(abi::kMaxTasks, context.d_lines);
    if (!context.lines ||
        driver_.cuModuleLoadData(&module, device::marks_image()) != CUDA_SUCCESS ||
        driver_.cuModuleGetFunction(&context.kernel, module, UG_MARK_KERNEL_NAME) != CUDA_SUCCESS)
        return false;
    if (driver_.cuModuleGetFunction(&context.delay, module, UG_DELAY_KERNEL_NAME) != CUDA_SUCCESS)
        context.delay = nullptr;
    return true;
}

ug_mark_line* ProgressMarks::allocate_lines(std::size_t count, CUdeviceptr& d_lines) const {
    const std::size_t bytes = sizeof(ug_mark_line) * count;
    void* memory = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) return nullptr;
    // A forked child's copy-on-write must not move the pages away from under the GPU.
    madvise(memory, bytes, MADV_DONTFORK);
    const RelaxedCaptureMode relaxed(driver_);
    if (driver_.cuMemHostRegister_v2(memory, bytes, CU_MEMHOSTREGISTER_DEVICEMAP) != CUDA_SUCCESS ||
        driver_.cuMemHostGetDevicePointer_v2(&d_lines, memory, 0) != CUDA_SUCCESS)
        return nullptr;
    return static_cast<ug_mark_line*>(memory);
}

CUresult ProgressMarks::launch_at(const MarkContext& context, CUdeviceptr d_line,
                                  std::uint64_t word0, std::uint32_t sequence, CUstream stream,
                                  StreamFlavor flavor) const {
    std::uint64_t tag = sequence;
    void* parameters[] = {&d_line, &word0, &tag};
    CUlaunchAttribute priority{};
    priority.id = CU_LAUNCH_ATTRIBUTE_PRIORITY;
    priority.value.priority = context.greatest_priority;
    CUlaunchConfig config{};
    config.gridDimX = config.gridDimY = config.gridDimZ = 1;
    config.blockDimX = config.blockDimY = config.blockDimZ = 1;
    config.hStream = stream;
    config.attrs = &priority;
    config.numAttrs = 1;
    const auto launch_ex =
        of_flavor(flavor, driver_.cuLaunchKernelEx, driver_.cuLaunchKernelEx_ptsz);
    return launch_ex(&config, context.kernel, parameters, nullptr);
}

}  // namespace urgengo::exec
