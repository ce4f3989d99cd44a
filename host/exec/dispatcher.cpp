// SPDX-License-Identifier: Apache-2.0
#include "host/exec/dispatcher.h"

#include <sched.h>
#include <sys/mman.h>

#include "device/device_image.h"
#include "host/base/log.h"
#include "host/base/roomy_stack.h"
#include "host/exec/context_id.h"
#include "host/exec/progress_marks.h"
#include "host/exec/relaxed_capture_mode.h"

namespace urgengo::exec {
namespace {

/// Has the flag for as long as the object lives, however that ends: the thread may be cancelled in
/// the driver.
class Extending {
  public:
    explicit Extending(std::atomic_flag& flag)
        : flag_(flag), is_ours_(!flag.test_and_set(std::memory_order_acquire)) {}
    ~Extending() {
        if (is_ours_) flag_.clear(std::memory_order_release);
    }
    Extending(const Extending&) = delete;
    Extending& operator=(const Extending&) = delete;
    bool is_ours() const { return is_ours_; }

  private:
    std::atomic_flag& flag_;
    const bool is_ours_;
};

}  // namespace

const DispatchContext* Dispatcher::prepare(const MarkContext& marks) {
    const DispatchContext* known = known_.load(std::memory_order_acquire);
    if (known) return known->id == marks.id ? known : nullptr;
    const std::lock_guard lock(mutex_);
    if (tried_) return nullptr;
    tried_ = true;
    // Loading a module takes 20 KB of stack, in whichever thread of the program launches first.
    struct Its {
        Dispatcher& dispatcher;
        const MarkContext& marks;
        bool is_set_up;
    } its{*this, marks, false};
    on_roomy_stack(
        [](void* argument) noexcept {
            auto& call = *static_cast<Its*>(argument);
            call.is_set_up = call.dispatcher.set_up(call.dispatcher.context_, call.marks);
        },
        &its);
    if (!its.is_set_up) {
        log_line("dispatch: the driver refuses what gates need: launches wait in their threads");
        return nullptr;
    }
    known_.store(&context_, std::memory_order_release);
    return &context_;
}

bool Dispatcher::set_up(DispatchContext& context, const MarkContext& marks) {
    if (!driver_.cuStreamWaitValue32_v2 || !driver_.cuMemAlloc_v2 || !driver_.cuMemsetD8Async)
        return false;
    const RelaxedCaptureMode relaxed(driver_);
    context.id = marks.id;
    context.handle = marks.handle;
    context.device = marks.device;
    CUmodule module = nullptr;
    CUdeviceptr d_state = 0, d_lease = 0;
    void* memory = mmap(nullptr, sizeof(abi::DispatchLease), PROT_READ | PROT_WRITE,
                        MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) return false;
    context.lease_page = static_cast<abi::DispatchLease*>(memory);
    const auto map = [&](void* address, std::size_t bytes, CUdeviceptr& d_address) {
        return driver_.cuMemHostRegister_v2(address, bytes, CU_MEMHOSTREGISTER_DEVICEMAP) ==
                   CUDA_SUCCESS &&
               driver_.cuMemHostGetDevicePointer_v2(&d_address, address, 0) == CUDA_SUCCESS;
    };
    if (!map(&page_, sizeof page_, context.d_page) ||
        !map(context.lease_page, sizeof(abi::DispatchLease), d_lease) ||
        driver_.cuMemAlloc_v2(&d_state, sizeof(abi::DispatchState)) != CUDA_SUCCESS ||
        // On a stream of ours: marks on the program's do not wait for the legacy one.
        driver_.cuStreamCreateWithPriority(&context.stream, CU_STREAM_NON_BLOCKING,
                                           marks.greatest_priority) != CUDA_SUCCESS ||
        driver_.cuMemsetD8Async(d_state, 0, sizeof(abi::DispatchState), context.stream) !=
            CUDA_SUCCESS ||
        driver_.cuStreamSynchronize(context.stream) != CUDA_SUCCESS ||
        driver_.cuModuleLoadData(&module, device::dispatcher_image()) != CUDA_SUCCESS)
        return false;
    const auto find = [&](CUfunction& function, const char* name) {
        return driver_.cuModuleGetFunction(&function, module, name) == CUDA_SUCCESS;
    };
    if (!find(context.mark, abi::kDispatchMarkKernel) ||
        !find(context.lease, abi::kDispatchLeaseKernel))
        return false;
    // Of the code that was loaded (progress_marks.h): only from 9.0 on it has the wait.
    constexpr int kFirstWithWait = 90;
    int code = 0;
    context.overlaps = driver_.cuFuncGetAttribute &&
                       driver_.cuFuncGetAttribute(&code, CU_FUNC_ATTRIBUTE_PTX_VERSION,
                                                  context.mark) == CUDA_SUCCESS &&
                       code >= kFirstWithWait;
    context.args = {.page = reinterpret_cast<abi::SharedPage*>(context.d_page),
                    .state = reinterpret_cast<abi::DispatchState*>(d_state),
                    .lease = reinterpret_cast<abi::DispatchLease*>(d_lease),
                    .num_tasks = static_cast<std::uint32_t>(num_tasks_),
                    .reserved = 0};
    return true;
}

CUresult Dispatcher::close(const DispatchContext& context, int task, std::uint32_t gate,
                           CUstream stream, StreamFlavor flavor) const {
    const auto wait =
        of_flavor(flavor, driver_.cuStreamWaitValue32_v2, driver_.cuStreamWaitValue32_v2_ptsz);
    const CUdeviceptr word = context.d_page + offsetof(abi::SharedPage, tasks) +
                             sizeof(abi::TaskSlot) * static_cast<std::size_t>(task) +
                             offsetof(abi::TaskSlot, gates_opened);
    return wait(stream, word, gate, CU_STREAM_WAIT_VALUE_GEQ);
}

CUresult Dispatcher::launch_mark(const DispatchContext& context, CUdeviceptr d_line,
                                 const Mark& mark, int priority, bool overlaps) const {
    constexpr unsigned kThreads = 32;
    std::uint64_t word0 = mark.word0, tag = mark.sequence;
    abi::DispatchArgs args = context.args;
    auto task = static_cast<std::uint32_t>(mark.task);
    std::uint32_t gate = mark.gate;
    using abi::MarkRanks;
    MarkRanks ranks = device_ == config::DeviceDispatch::kLeased ? MarkRanks::kNever
                      : mark.ends_segment                        ? MarkRanks::kForAll
                      : mark.is_before_gate                      ? MarkRanks::kForItself
                                                                 : MarkRanks::kNever;
    void* parameters[] = {&d_line,         &word0, &tag,  &args.page, &args.state,
                          &args.num_tasks, &task,  &gate, &ranks};
    CUlaunchAttribute attributes[2] = {};
    attributes[0].id = CU_LAUNCH_ATTRIBUTE_PRIORITY;
    attributes[0].value.priority = priority;
    attributes[1].id = CU_LAUNCH_ATTRIBUTE_PROGRAMMATIC_STREAM_SERIALIZATION;
    attributes[1].value.programmaticStreamSerializationAllowed = 1;
    CUlaunchConfig config{};
    config.gridDimX = config.gridDimY = config.gridDimZ = 1;
    config.blockDimX = kThreads;
    config.blockDimY = config.blockDimZ = 1;
    config.hStream = mark.stream;
    config.attrs = attributes;
    config.numAttrs = overlaps && context.overlaps ? 2 : 1;
    const auto launch =
        of_flavor(mark.flavor, driver_.cuLaunchKernelEx, driver_.cuLaunchKernelEx_ptsz);
    return launch(&config, context.mark, parameters, nullptr);
}

// A thread that ends the context waits for the one that has the flag.
void Dispatcher::extend_lease(nanoseconds lease) {
    if (const Extending extending(extends_); extending.is_ours()) launch_leases(lease);
}

bool Dispatcher::extend_lease_from_outside(nanoseconds lease) {
    const Extending extending(extends_);
    if (!extending.is_ours()) return true;
    if (!make_current()) return false;
    launch_leases(lease);
    return true;
}

void Dispatcher::launch_leases(nanoseconds lease) {
    const DispatchContext* const context = known_.load(std::memory_order_acquire);
    if (!context || !context->stream) return;
    abi::DispatchLease& page = *context->lease_page;
    const auto is_due = [&] {
        return may_launch() && __atomic_load_n(&page.stop, __ATOMIC_SEQ_CST) == 0 &&
               leases_.load(std::memory_order_relaxed) -
                       __atomic_load_n(&page.ended, __ATOMIC_ACQUIRE) <
                   kLeasesAhead;
    };
    while (is_due() && launch_lease(*context, lease)) {
    }
}

bool Dispatcher::make_current() const {
    const DispatchContext* const context = known_.load(std::memory_order_acquire);
    return context && may_launch() && driver_.cuCtxSetCurrent(context->handle) == CUDA_SUCCESS;
}

bool Dispatcher::launch_lease(const DispatchContext& context, nanoseconds lease) {
    abi::DispatchArgs args = context.args;
    std::uint32_t sequence = leases_.fetch_add(1, std::memory_order_relaxed) + 1;
    auto lease_ns = static_cast<std::uint64_t>(lease.count());
    void* parameters[] = {&args, &sequence, &lease_ns};
    CUlaunchConfig config{};
    config.gridDimX = config.gridDimY = config.gridDimZ = 1;
    config.blockDimX = 32;
    config.blockDimY = config.blockDimZ = 1;
    config.hStream = context.stream;
    if (driver_.cuLaunchKernelEx(&config, context.lease, parameters, nullptr) == CUDA_SUCCESS)
        return true;
    leases_.fetch_sub(1, std::memory_order_relaxed);
    return false;
}

void Dispatcher::end_lease() {
    const DispatchContext* const context = known_.load(std::memory_order_acquire);
    if (!context) return;
    __atomic_store_n(&context->lease_page->stop, 1, __ATOMIC_SEQ_CST);
    // A thread that has asked before may be launching one: it holds no lock of the program's.
    constexpr int kLongest = 2000;
    for (int i = 0; extends_.test(std::memory_order_acquire) && i < kLongest; ++i) sched_yield();
}

bool Dispatcher::has_ended() const {
    const DispatchContext* const context = known_.load(std::memory_order_acquire);
    return !context || __atomic_load_n(&context->lease_page->ended, __ATOMIC_ACQUIRE) ==
                           leases_.load(std::memory_order_relaxed);
}

void Dispatcher::never_again() {
    may_reside_.store(false);
    end_lease();
}

const DispatchContext* Dispatcher::known_as(const EndingContext& ending) const {
    const DispatchContext* const context = known_.load(std::memory_order_acquire);
    return context && ending.may_be(context->handle, context->device) ? context : nullptr;
}

void Dispatcher::context_ends(const EndingContext& ending) {
    if (!known_as(ending)) return;
    may_end_.store(true);
    end_lease();
}

void Dispatcher::context_ended(const EndingContext& ending) {
    const DispatchContext* const context = known_as(ending);
    if (!context) return;
    if (ContextId{context->handle, context->id}.has_ended(driver_)) never_again();
    may_end_.store(false);
    go_on();  // it lives on: that release of a primary context was not the last, say
}

void Dispatcher::go_on() {
    const DispatchContext* const context = known_.load(std::memory_order_acquire);
    if (!context || !may_launch()) return;
    __atomic_store_n(&context->lease_page->stop, 0, __ATOMIC_SEQ_CST);
    if (page_.dispatch.parked.load() > 0 || !may_launch()) end_lease();
}

}  // namespace urgengo::exec
