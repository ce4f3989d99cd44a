// SPDX-License-Identifier: Apache-2.0
#include "host/exec/dispatcher.h"

#include <sched.h>
#include <sys/mman.h>

#include <algorithm>

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

/// A kernel of one warp on our stream.
CUresult launch_one(const DriverApi& driver, const DispatchContext& context, void** parameters) {
    CUlaunchConfig config{};
    config.gridDimX = config.gridDimY = config.gridDimZ = 1;
    config.blockDimX = 32;
    config.blockDimY = config.blockDimZ = 1;
    config.hStream = context.stream;
    return driver.cuLaunchKernelEx(&config, context.lease, parameters, nullptr);
}

/// Counts one on for good, unless it goes before it is kept: the thread may be cancelled, or the
/// driver refuse. What was put there under that number goes through.
class Numbered {
  public:
    Numbered(std::atomic<std::uint32_t>& last, abi::DispatchLease& page)
        : last_(last), page_(page), number_(last.fetch_add(1) + 1) {
        tell(number_);
    }
    ~Numbered() {
        if (is_kept_) return;
        tell(number_ - 1);
        __atomic_store_n(&page_.ticks[number_ % abi::kArmRing], number_, __ATOMIC_SEQ_CST);
        last_.fetch_sub(1);
    }
    Numbered(const Numbered&) = delete;
    Numbered& operator=(const Numbered&) = delete;
    std::uint32_t number() const { return number_; }
    bool keep_if(bool is_kept) { return is_kept_ = is_kept; }

  private:
    void tell(std::uint32_t last) { __atomic_store_n(&page_.launched, last, __ATOMIC_RELEASE); }

    std::atomic<std::uint32_t>& last_;
    abi::DispatchLease& page_;
    const std::uint32_t number_;
    bool is_kept_ = false;
};

}  // namespace

const DispatchContext* Dispatcher::prepare(const MarkContext& marks) {
    const DispatchContext* known = known_.load(std::memory_order_acquire);
    if (known) {
        if (known->id == marks.id) return known;
        say_that_another_has_gates();
        return nullptr;
    }
    const std::lock_guard lock(mutex_);
    if (tried_) return nullptr;
    tried_ = true;
    const bool one_was_ending = one_is_ending_.load();
    const unsigned endings = endings_.load();
    // Loading a module takes 20 KB of stack, in whichever thread of the program launches first.
    bool is_set_up = false;
    on_roomy_stack([&] { is_set_up = set_up(context_, marks); });
    const bool one_ends = one_was_ending || endings_.load() != endings;
    const bool has_ended =
        (one_ends || !is_set_up) && ContextId{marks.handle, marks.id}.has_ended(driver_);
    if (has_ended || (one_ends && !is_set_up)) {
        tried_ = false;
        return nullptr;
    }
    if (!is_set_up) {
        log_line("dispatch: the driver refuses what gates need: launches wait in their threads");
        return nullptr;
    }
    known_.store(&context_, std::memory_order_release);
    return &context_;
}

void Dispatcher::say_that_another_has_gates() {
    if (told_of_other_context_.load(std::memory_order_relaxed) ||
        told_of_other_context_.exchange(true))
        return;
    log_line(
        "dispatch: gates are for the context whose launch was the first to wait: launches in "
        "another one wait in their threads");
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
    if (!context.lease_page) {
        void* memory = mmap(nullptr, sizeof(abi::DispatchLease), PROT_READ | PROT_WRITE,
                            MAP_SHARED | MAP_ANONYMOUS, -1, 0);
        if (memory == MAP_FAILED) return false;
        context.lease_page = static_cast<abi::DispatchLease*>(memory);
    }
    const auto map = [&](void* address, std::size_t bytes, CUdeviceptr& d_address) {
        return driver_.cuMemHostRegister_v2(address, bytes, CU_MEMHOSTREGISTER_DEVICEMAP) ==
                   CUDA_SUCCESS &&
               driver_.cuMemHostGetDevicePointer_v2(&d_address, address, 0) == CUDA_SUCCESS;
    };
    if (driver_.cuDeviceGetAttribute(&context.shared_bytes_of_sm,
                                     CU_DEVICE_ATTRIBUTE_MAX_SHARED_MEMORY_PER_MULTIPROCESSOR,
                                     marks.device) != CUDA_SUCCESS ||
        !map(&page_, sizeof page_, context.d_page) ||
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
    const bool marks_rank = settings_.device == config::DeviceDispatch::kPiggyback;
    if (!find(context.mark, marks_rank ? abi::kDispatchMarkKernel : abi::kGateMarkKernel) ||
        !find(context.lease, is_armed() ? abi::kDispatchArmedKernel : abi::kDispatchLeaseKernel))
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
    if (settings_.device != config::DeviceDispatch::kPiggyback) warm_up(context);
    return true;
}

// The first launch of a kernel may load it, which waits for all work, and so for gates that are
// closed: it is made before any is. The kernel has nothing to do, and is not waited for: the GPU
// may be full for long.
void Dispatcher::warm_up(const DispatchContext& context) const {
    abi::DispatchArgs args = context.args;
    std::uint32_t number = 0;
    std::uint64_t lease_ns = 0, idle_ns = 0;
    void* parameters[] = {&args, &number, &lease_ns, &idle_ns};
    launch_one(driver_, context, parameters);
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
    constexpr unsigned kWarp = 32;  // a round is run by one
    std::uint64_t word0 = mark.word0, tag = mark.sequence;
    abi::DispatchArgs args = context.args;
    auto task = static_cast<std::uint32_t>(mark.task);
    std::uint32_t gate = mark.gate;
    using abi::MarkRanks;
    MarkRanks ranks = settings_.device == config::DeviceDispatch::kLeased ? MarkRanks::kNever
                      : mark.ends_segment                                 ? MarkRanks::kForAll
                      : mark.is_before_gate                               ? MarkRanks::kForItself
                                                                          : MarkRanks::kNever;
    abi::DispatchLease* arms = is_armed() ? args.lease : nullptr;
    void* parameters[] = {&d_line, &word0,          &tag,  &args.page, &args.state,
                          &arms,   &args.num_tasks, &task, &gate,      &ranks};
    CUlaunchAttribute attributes[2] = {};
    attributes[0].id = CU_LAUNCH_ATTRIBUTE_PRIORITY;
    attributes[0].value.priority = priority;
    attributes[1].id = CU_LAUNCH_ATTRIBUTE_PROGRAMMATIC_STREAM_SERIALIZATION;
    attributes[1].value.programmaticStreamSerializationAllowed = 1;
    CUlaunchConfig config{};
    config.gridDimX = config.gridDimY = config.gridDimZ = 1;
    config.blockDimX = settings_.device == config::DeviceDispatch::kPiggyback
                           ? kWarp
                           : std::max(mark.threads, kWarp);
    config.blockDimY = config.blockDimZ = 1;
    config.hStream = mark.stream;
    config.attrs = attributes;
    config.numAttrs = overlaps && context.overlaps ? 2 : 1;
    const auto launch =
        of_flavor(mark.flavor, driver_.cuLaunchKernelEx, driver_.cuLaunchKernelEx_ptsz);
    return launch(&config, context.mark, parameters, nullptr);
}

// A thread that ends the context waits for the one that has the flag.
void Dispatcher::extend_lease(nanoseconds lease, nanoseconds now) {
    if (const Extending extending(extends_); extending.is_ours()) launch_leases(lease, now, false);
}

bool Dispatcher::extend_lease_from_outside(nanoseconds lease, nanoseconds now) {
    const Extending extending(extends_);
    if (!extending.is_ours()) return true;
    if (!make_current()) return false;
    launch_leases(lease, now, true);
    return true;
}

bool Dispatcher::is_away(nanoseconds now) {
    std::int64_t until = away_until_ns_.load();
    if (until == 0) return false;
    if (now.count() < until || !away_until_ns_.compare_exchange_strong(until, 0)) return true;
    go_on();
    return false;
}

// Without MPS processes have the GPU in turn, each for whole slices as long as it has something to
// run: a kernel that stays would take most of the others' time, and opens no gate in theirs.
bool Dispatcher::is_time_sliced(const abi::DispatchLease& page) {
    if (__atomic_load_n(&page.gaps, __ATOMIC_RELAXED) < kMostGaps) return false;
    if (may_reside_.exchange(false))
        log_line(
            "dispatch: another process has the GPU now and then: the host opens gates from here "
            "on");
    return true;
}

void Dispatcher::launch_leases(nanoseconds lease, nanoseconds now, bool from_outside) {
    const DispatchContext* const context = known_.load(std::memory_order_acquire);
    if (!context || !context->stream) return;
    const abi::DispatchLease& page = *context->lease_page;
    if (is_time_sliced(page) || is_away(now)) return;
    const auto last = [this] { return leases_.load(std::memory_order_relaxed); };
    const std::uint32_t ahead =
        is_armed() && from_outside ? arms_.wanted(page, last()) : kLeasesAhead;
    const auto has_room = [&] {
        if (is_armed()) return arms_.is_due(page, last(), ahead);
        return static_cast<std::int32_t>(last() - __atomic_load_n(&page.ended, __ATOMIC_ACQUIRE)) <
               static_cast<std::int32_t>(ahead);
    };
    const auto must_end = [&] {
        return !may_launch() || __atomic_load_n(&page.stop, __ATOMIC_SEQ_CST) != 0;
    };
    while (!must_end() && has_room() && launch_lease(*context, lease)) {
    }
    // Either this thread sees that they must end, or the one that says so sees the last number.
    if (must_end()) tick_arms(*context);
}

bool Dispatcher::make_current() const {
    const DispatchContext* const context = known_.load(std::memory_order_acquire);
    return context && may_launch() && driver_.cuCtxSetCurrent(context->handle) == CUDA_SUCCESS;
}

bool Dispatcher::launch_lease(const DispatchContext& context, nanoseconds lease) {
    Numbered one(leases_, *context.lease_page);
    abi::DispatchArgs args = context.args;
    std::uint32_t number = one.number();
    auto lease_ns = static_cast<std::uint64_t>(lease.count());
    auto idle_ns = static_cast<std::uint64_t>(settings_.idle.count());
    void* parameters[] = {&args, &number, &lease_ns, &idle_ns};  // an arm's are the first two
    if (is_armed()) {
        const CUdeviceptr tick = reinterpret_cast<CUdeviceptr>(args.lease) +
                                 offsetof(abi::DispatchLease, ticks) +
                                 sizeof(std::uint32_t) * (number % abi::kArmRing);
        if (driver_.cuStreamWaitValue32_v2(context.stream, tick, number,
                                           CU_STREAM_WAIT_VALUE_GEQ) != CUDA_SUCCESS)
            return false;
    }
    return one.keep_if(launch_one(driver_, context, parameters) == CUDA_SUCCESS);
}

void Dispatcher::end_lease() {
    const DispatchContext* const context = known_.load(std::memory_order_acquire);
    if (!context) return;
    __atomic_store_n(&context->lease_page->stop, 1, __ATOMIC_SEQ_CST);
    tick_arms(*context);
    // A thread that has asked before may be launching one: it holds no lock of the program's.
    constexpr int kLongest = 2000;
    for (int i = 0; extends_.test(std::memory_order_acquire) && i < kLongest; ++i) sched_yield();
    tick_arms(*context);
}

void Dispatcher::leave_until(nanoseconds time) {
    std::int64_t known = away_until_ns_.load();
    while (known < time.count() && !away_until_ns_.compare_exchange_weak(known, time.count())) {
    }
    if (known == 0) end_lease();
}

std::uint32_t Dispatcher::forsaken() const {
    const DispatchContext* const context = known_.load(std::memory_order_acquire);
    return context ? __atomic_load_n(&context->lease_page->forsaken, __ATOMIC_RELAXED) : 0;
}

// One whose launching thread was cancelled may end without being counted.
bool Dispatcher::has_ended() const {
    const DispatchContext* const context = known_.load(std::memory_order_acquire);
    return !context || static_cast<std::int32_t>(
                           __atomic_load_n(&context->lease_page->ended, __ATOMIC_ACQUIRE) -
                           leases_.load(std::memory_order_relaxed)) >= 0;
}

bool Dispatcher::look_at_arms(nanoseconds now, nanoseconds lease) {
    const DispatchContext* const context = known_.load(std::memory_order_acquire);
    return context && is_armed() &&
           arms_.look(*context->lease_page, leases_.load(std::memory_order_relaxed), now, lease);
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
    ++endings_;
    one_is_ending_.store(true);
    if (!known_as(ending)) return;
    may_end_.store(true);
    end_lease();
}

void Dispatcher::context_ended(const EndingContext& ending) {
    ++endings_;
    one_is_ending_.store(false);
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
    if (page_.dispatch.parked.load() > 0 || !may_launch() || away_until_ns_.load() != 0)
        end_lease();
}

}  // namespace urgengo::exec
