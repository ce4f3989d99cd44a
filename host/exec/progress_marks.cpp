// SPDX-License-Identifier: Apache-2.0
#include "host/exec/progress_marks.h"

#include <fmt/format.h>
#include <sys/mman.h>

#include <algorithm>
#include <memory>
#include <utility>

#include "device/device_image.h"
#include "host/base/log.h"
#include "host/base/roomy_stack.h"
#include "host/config/progress_choice.h"
#include "host/exec/context_id.h"

namespace urgengo::exec {

const MarkContext* ProgressMarks::find(unsigned long long id) const {
    for (const auto& place : contexts_) {
        const MarkContext* const context = place.load(std::memory_order_acquire);
        if (context && context->id == id) return context;
    }
    return nullptr;
}

const MarkContext* ProgressMarks::prepare() {
    CUcontext current = nullptr;
    unsigned long long id = 0;
    if (!driver_.cuCtxGetId || !driver_.cuLaunchKernelEx) return nullptr;  // before CUDA 12
    if (driver_.cuCtxGetCurrent(&current) != CUDA_SUCCESS || !current) return nullptr;
    if (driver_.cuCtxGetId(current, &id) != CUDA_SUCCESS) return nullptr;
    const MarkContext* context = find(id);
    if (!context) context = load(id, current);
    return context && context->kernel ? context : nullptr;
}

const MarkContext* ProgressMarks::load(unsigned long long id, CUcontext handle) {
    const std::lock_guard lock(mutex_);
    if (const MarkContext* context = find(id)) return context;
    const auto place = std::find(contexts_.begin(), contexts_.end(), nullptr);
    if (place == contexts_.end()) {
        if (!std::exchange(told_, true))
            log_line(fmt::format(
                "there are more than {} contexts: launches in the others are not scheduled",
                kMaxContexts));
        return nullptr;
    }
    MarkContext& context = new_context();
    context.id = id;
    context.handle = handle;
    set_up_on_roomy_stack(context);
    place->store(&context, std::memory_order_release);
    return &context;
}

// Of those that have ended, the mailbox stays mapped, and what it says stays: its new users begin
// with what it says when they come.
MarkContext& ProgressMarks::new_context() {
    MarkContext& context = all_.emplace_back();
    if (ended_.size() <= kKeptEnded) return context;
    context.lines = ended_.front()->lines;
    ended_.pop_front();
    return context;
}

// The driver takes 20 KB to load a module (measured, 580.159.04), in whichever thread of the
// program launches first.
void ProgressMarks::set_up_on_roomy_stack(MarkContext& context) {
    on_roomy_stack([&] {
        bool is_set_up = false;
        try {
            is_set_up = set_up(context);
        } catch (...) {  // no memory
        }
        if (!is_set_up) context.kernel = nullptr;
    });
}

bool ProgressMarks::set_up(MarkContext& context) {
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
    for (std::size_t task = 0; context.lines && task < num_lines_; ++task)
        context.lines[task].clock = UG_MARK_CLOCK_GPU;
    if (!context.lines || !share_lines(context.lines, num_lines_, context.d_lines))
        context.lines = allocate_lines(num_lines_, context.d_lines);
    if (!context.lines ||
        driver_.cuModuleLoadData(&module, device::marks_image()) != CUDA_SUCCESS ||
        driver_.cuModuleGetFunction(&context.kernel, module, UG_MARK_KERNEL_NAME) != CUDA_SUCCESS)
        return false;
    if (driver_.cuModuleGetFunction(&context.delay, module, UG_DELAY_KERNEL_NAME) != CUDA_SUCCESS)
        context.delay = nullptr;
    context.overlaps = may_overlap(context);
    choose_source(context);
    return true;
}

bool ProgressMarks::may_overlap(const MarkContext& context) const {
    // Of the code that was loaded: machine code, or PTX that it was compiled from just now.
    constexpr int kFirstWithWait = 90;
    int major = 0, code = 0;
    return driver_.cuFuncGetAttribute &&
           driver_.cuDeviceGetAttribute(&major, CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR,
                                        context.device) == CUDA_SUCCESS &&
           config::marks_overlap(major) &&
           driver_.cuFuncGetAttribute(&code, CU_FUNC_ATTRIBUTE_PTX_VERSION, context.kernel) ==
               CUDA_SUCCESS &&
           code >= kFirstWithWait;
}

void ProgressMarks::choose_source(MarkContext& context) {
    using config::ProgressSource;
    if (source_ == ProgressSource::kMemop) {
        int can = 0;
        if (driver_.cuStreamBatchMemOp_v2 && driver_.cuStreamBatchMemOp_v2_ptsz &&
            driver_.cuDeviceGetAttribute(&can, CU_DEVICE_ATTRIBUTE_CAN_USE_64_BIT_STREAM_MEM_OPS,
                                         context.device) == CUDA_SUCCESS &&
            can != 0)
            context.source = source_;
    } else if (source_ == ProgressSource::kEvent) {
        EventMarks* events = events_.load(std::memory_order_relaxed);
        if (!events) {
            // Not destroyed: its thread runs until the process ends.
            if (!poller_) poller_ = new PollerThread(!at_once_);
            events = new EventMarks(driver_, *poller_);
            events_.store(events, std::memory_order_release);
        }
        context.events = events->add(context.handle, context.device, context.lines);
        if (!context.events) return;
        for (std::size_t task = 0; task < num_lines_; ++task)
            context.lines[task].clock = UG_MARK_CLOCK_HOST;
        context.source = source_;
    }
}

ug_mark_line* ProgressMarks::allocate_lines(std::size_t count, CUdeviceptr& d_lines) const {
    const std::size_t bytes = sizeof(ug_mark_line) * count;
    void* memory = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) return nullptr;
    // A forked child's copy-on-write must not move the pages away from under the GPU.
    madvise(memory, bytes, MADV_DONTFORK);
    auto* const lines = static_cast<ug_mark_line*>(memory);
    return share_lines(lines, count, d_lines) ? lines : nullptr;
}

bool ProgressMarks::share_lines(ug_mark_line* lines, std::size_t count,
                                CUdeviceptr& d_lines) const {
    const RelaxedCaptureMode relaxed(driver_);
    return driver_.cuMemHostRegister_v2(lines, sizeof(ug_mark_line) * count,
                                        CU_MEMHOSTREGISTER_DEVICEMAP) == CUDA_SUCCESS &&
           driver_.cuMemHostGetDevicePointer_v2(&d_lines, lines, 0) == CUDA_SUCCESS;
}

CUresult ProgressMarks::emit(const MarkContext& context, const Mark& mark) {
    using config::ProgressSource;
    const auto d_line =
        context.d_lines + sizeof(ug_mark_line) * static_cast<std::size_t>(mark.task);
    const auto launch = [&] {
        const DispatchContext* const dispatch = context.dispatch.load(std::memory_order_acquire);
        if (dispatch) [[unlikely]]
            return dispatcher_->launch_mark(
                *dispatch, d_line, mark, context.greatest_priority,
                mark.may_overlap && context.overlaps.load(std::memory_order_relaxed));
        return launch_at(context, d_line, mark.word0, mark.sequence, mark.stream, mark.flavor,
                         mark.may_overlap, mark.threads);
    };
    const ProgressSource source = context.source.load(std::memory_order_relaxed);
    if (source == ProgressSource::kMemop) {
        if (write_words(context, mark) == CUDA_SUCCESS) return CUDA_SUCCESS;
    } else if (source == ProgressSource::kEvent) {
        EventMarks* events = events_.load(std::memory_order_acquire);
        const CUresult result = events->record(*context.events, mark);
        if (result == CUDA_SUCCESS || result == CUDA_ERROR_NOT_READY) return result;
        for (std::size_t task = 0; task < num_lines_; ++task)
            __atomic_store_n(&context.lines[task].clock, UG_MARK_CLOCK_GPU, __ATOMIC_RELEASE);
    } else {
        return launch();
    }
    // Half a mark may have been written, or an older one may still be published: the kernel writes
    // both words, and a reader never goes back.
    context.source.store(ProgressSource::kKernel, std::memory_order_relaxed);
    return launch();
}

// In this order, each whole: a reader between the two finds two tags.
CUresult ProgressMarks::write_words(const MarkContext& context, const Mark& mark) const {
    const auto d_line =
        context.d_lines + sizeof(ug_mark_line) * static_cast<std::size_t>(mark.task);
    CUstreamBatchMemOpParams writes[2] = {};
    for (CUstreamBatchMemOpParams& write : writes) {
        write.writeValue.operation = CU_STREAM_MEM_OP_WRITE_VALUE_64;
        write.writeValue.flags = CU_STREAM_WRITE_VALUE_DEFAULT;
    }
    writes[0].writeValue.address = d_line;
    writes[0].writeValue.value64 = mark.word0;
    writes[1].writeValue.address = d_line + sizeof(std::uint64_t);
    writes[1].writeValue.value64 = ug_mark_word1(UG_MARK_NO_TIME, mark.sequence);
    const auto batch =
        of_flavor(mark.flavor, driver_.cuStreamBatchMemOp_v2, driver_.cuStreamBatchMemOp_v2_ptsz);
    return batch(mark.stream, 2, writes, 0);
}

CUresult ProgressMarks::launch_at(const MarkContext& context, CUdeviceptr d_line,
                                  std::uint64_t word0, std::uint32_t sequence, CUstream stream,
                                  StreamFlavor flavor, bool may_overlap, unsigned threads) const {
    std::uint64_t tag = sequence;
    void* parameters[] = {&d_line, &word0, &tag};
    CUlaunchAttribute attributes[2] = {};
    attributes[0].id = CU_LAUNCH_ATTRIBUTE_PRIORITY;
    attributes[0].value.priority = context.greatest_priority;
    attributes[1].id = CU_LAUNCH_ATTRIBUTE_PROGRAMMATIC_STREAM_SERIALIZATION;
    attributes[1].value.programmaticStreamSerializationAllowed = 1;
    CUlaunchConfig config{};
    config.gridDimX = config.gridDimY = config.gridDimZ = 1;
    config.blockDimX = threads;
    config.blockDimY = config.blockDimZ = 1;
    config.hStream = stream;
    config.attrs = attributes;
    const bool overlaps = may_overlap && context.overlaps.load(std::memory_order_relaxed);
    config.numAttrs = overlaps ? 2 : 1;
    const auto launch_ex =
        of_flavor(flavor, driver_.cuLaunchKernelEx, driver_.cuLaunchKernelEx_ptsz);
    const CUresult result = launch_ex(&config, context.kernel, parameters, nullptr);
    if (!overlaps || (result != CUDA_ERROR_NOT_SUPPORTED && result != CUDA_ERROR_INVALID_VALUE))
        return result;
    context.overlaps.store(false, std::memory_order_relaxed);
    config.numAttrs = 1;
    return launch_ex(&config, context.kernel, parameters, nullptr);
}

void ProgressMarks::context_ends(const EndingContext& ending) {
    if (EventMarks* events = events_.load(std::memory_order_acquire)) events->drop(ending);
}

void ProgressMarks::context_ended(const EndingContext& ending,
                                  const std::function<void(unsigned long long)>& forget) {
    const std::lock_guard lock(mutex_);
    for (auto& place : contexts_) {
        const MarkContext* const context = place.load(std::memory_order_relaxed);
        if (!context || !ending.may_be(context->handle, context->device) ||
            !ContextId{context->handle, context->id}.has_ended(driver_))
            continue;
        place.store(nullptr, std::memory_order_release);
        ended_.push_back(const_cast<MarkContext*>(context));  // of all_
        if (context->events) events_.load(std::memory_order_relaxed)->make_free(*context->events);
        // Its lines stay as they are: a late look at them sees the last mark that came.
        forget(context->id);
    }
}

}  // namespace urgengo::exec
