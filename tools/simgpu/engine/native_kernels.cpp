// SPDX-License-Identifier: Apache-2.0
//
// The native kernels. They run on the engine's thread and must not block or call the driver.
#include "tools/simgpu/engine/native_kernels.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>

#include "host/sched/dispatch_round.h"
#include "tools/simgpu/simgpu.h"
#include "urgengo/abi/dispatcher.h"

namespace urgengo::simgpu {
namespace {

struct MarkParams {
    std::uint64_t* line;
    std::uint64_t word0;
    std::uint64_t tag;
};
constexpr std::array kMarkParamBytes = {sizeof(std::uint64_t*), sizeof(std::uint64_t),
                                        sizeof(std::uint64_t)};

std::uint64_t globaltimer_ns(Time end) {
    return static_cast<std::uint64_t>(end.count() + SIMGPU_GLOBALTIMER_OFFSET_NS);
}

/// The progress mark: a pair of words whose second carries the time and the sequence tag.
void run_mark(std::span<const std::byte> params, Time end) {
    MarkParams mark{};
    std::memcpy(&mark, params.data(), sizeof mark);
    // Two stores of eight bytes each, in this order, as the reader on the host expects of the
    // device.
    __atomic_store_n(&mark.line[0], mark.word0, __ATOMIC_RELEASE);
    __atomic_store_n(&mark.line[1], (globaltimer_ns(end) << 16) | (mark.tag & 0xffff),
                     __ATOMIC_RELEASE);
}

void run_round(abi::SharedPage& page, const abi::DispatchState& state, Time end) {
    sched::HostRounds rounds(page);
    rounds.run(sched::host_time(page.dispatch, globaltimer_ns(end)), &state);
    page.dispatch.gpu_rounds.fetch_add(1);
}

struct DispatchMarkParams {
    MarkParams mark;
    abi::SharedPage* page;
    abi::DispatchState* state;
    abi::DispatchLease* arms;
    std::uint32_t num_tasks, task, gate;
    abi::MarkRanks ranks;
};
constexpr std::array kDispatchMarkParamBytes = {
    sizeof(std::uint64_t*),   sizeof(std::uint64_t),       sizeof(std::uint64_t),
    sizeof(abi::SharedPage*), sizeof(abi::DispatchState*), sizeof(abi::DispatchLease*),
    sizeof(std::uint32_t),    sizeof(std::uint32_t),       sizeof(std::uint32_t),
    sizeof(abi::MarkRanks)};

bool is_closed(const abi::DispatchState& state, std::uint32_t task) {
    return state.reached[task] != state.opened[task];
}

/// The arm after the last one that has begun.
void wake(abi::DispatchState& state, abi::DispatchLease& arms) {
    state.again = 1;
    const std::uint32_t next = state.started + 1;
    __atomic_store_n(&arms.ticks[next % abi::kArmRing], next, __ATOMIC_RELEASE);
}

/// A progress mark, as the dispatcher knows of it.
DispatchMarkParams run_known_mark(std::span<const std::byte> params, Time end) {
    DispatchMarkParams its{};
    std::memcpy(&its, params.data(), std::min(sizeof its, params.size()));
    run_mark(params, end);
    its.state->done[its.task] = static_cast<std::uint32_t>(its.mark.tag);
    its.state->reached[its.task] = its.gate;
    its.state->marked[its.task] = 1;
    return its;
}

/// One that may wake an arm.
void run_gate_mark(std::span<const std::byte> params, Time end) {
    const DispatchMarkParams its = run_known_mark(params, end);
    if (!its.arms || its.ranks == abi::MarkRanks::kNever) return;
    bool is_due = is_closed(*its.state, its.task);
    for (std::uint32_t i = 0; its.ranks == abi::MarkRanks::kForAll && i < its.num_tasks; ++i)
        is_due |= is_closed(*its.state, i);
    if (is_due) wake(*its.state, *its.arms);
}

/// One that opens gates, as device/dispatcher.cu does it: the same round.
void run_dispatch_mark(std::span<const std::byte> params, Time end) {
    const DispatchMarkParams its = run_known_mark(params, end);
    if (its.ranks == abi::MarkRanks::kNever ||
        (its.ranks == abi::MarkRanks::kForItself &&
         its.page->tasks[its.task].gates_opened.load() == its.gate))
        return;
    run_round(*its.page, *its.state, end);
}

struct DispatchLeaseParams {
    abi::DispatchArgs args;
    std::uint32_t sequence;
    std::uint64_t lease_ns;
};
constexpr std::array kDispatchLeaseParamBytes = {sizeof(abi::DispatchArgs), sizeof(std::uint32_t),
                                                 sizeof(std::uint64_t)};

/// A resident dispatcher whose leases last for one round each: it ends as soon as it can. One
/// without a length has no time for a round.
void run_dispatch_lease(std::span<const std::byte> params, Time end) {
    DispatchLeaseParams its{};
    std::memcpy(&its, params.data(), std::min(sizeof its, params.size()));
    abi::SharedPage& page = *its.args.page;
    if (its.lease_ns > 0 && page.dispatch.clock_base_ns.load() != 0 &&
        __atomic_load_n(&its.args.lease->stop, __ATOMIC_ACQUIRE) == 0) {
        run_round(page, *its.args.state, end);
    }
    __atomic_store_n(&its.args.lease->ended, its.sequence, __ATOMIC_RELEASE);
}

struct DispatchArmedParams {
    abi::DispatchArgs args;
    std::uint32_t number;
};
constexpr std::array kDispatchArmedParamBytes = {sizeof(abi::DispatchArgs), sizeof(std::uint32_t)};

/// What a mark has woken, or the host has ticked.
void run_dispatch_armed(std::span<const std::byte> params, Time end) {
    DispatchArmedParams its{};
    std::memcpy(&its, params.data(), std::min(sizeof its, params.size()));
    abi::SharedPage& page = *its.args.page;
    abi::DispatchState& state = *its.args.state;
    state.started = its.number;
    if (state.again != 0 && __atomic_load_n(&its.args.lease->stop, __ATOMIC_ACQUIRE) == 0 &&
        page.dispatch.clock_base_ns.load() != 0) {
        state.again = 0;
        run_round(page, state, end);
        for (std::uint32_t i = 0; i < its.args.num_tasks; ++i)
            state.opened[i] = page.tasks[i].gates_opened.load();
    }
    __atomic_store_n(&its.args.lease->ended, its.number, __ATOMIC_RELEASE);
}

/// UrgenGo's delay takes as many nanoseconds as it is told to.
constexpr std::array kDelayParamBytes = {sizeof(std::uint64_t)};
void run_delay(std::span<const std::byte>, Time) {}

struct MixParams {
    std::uint64_t* word;
    std::uint64_t value;
};
constexpr std::array kMixParamBytes = {sizeof(std::uint64_t*), sizeof(std::uint64_t)};

/// For tests: a word from which one can tell which of these ran, how often and in which order.
void run_mix(std::span<const std::byte> params, Time) {
    MixParams mix{};
    std::memcpy(&mix, params.data(), sizeof mix);
    *mix.word = 31 * *mix.word + mix.value;
}

constexpr std::array kNativeKernels = {
    NativeKernel{"urgengo_mark", kMarkParamBytes, Time{1500}, run_mark},
    NativeKernel{abi::kGateMarkKernel, kDispatchMarkParamBytes, Time{1500}, run_gate_mark},
    NativeKernel{abi::kDispatchMarkKernel, kDispatchMarkParamBytes, Time{2500}, run_dispatch_mark},
    NativeKernel{abi::kDispatchLeaseKernel, kDispatchLeaseParamBytes, Time{30'000},
                 run_dispatch_lease},
    NativeKernel{abi::kDispatchArmedKernel, kDispatchArmedParamBytes, Time{3000},
                 run_dispatch_armed},
    NativeKernel{"urgengo_delay", kDelayParamBytes, Time{0}, run_delay, 1.0},
    NativeKernel{"simgpu_mix", kMixParamBytes, Time{1500}, run_mix},
    // The same for programs that must not be taken for UrgenGo (SIMGPU_FAIL).
    NativeKernel{"simgpu_store", kMarkParamBytes, Time{1500}, run_mark},
};

}  // namespace

const NativeKernel* find_native_kernel(std::string_view name) {
    for (const NativeKernel& kernel : kNativeKernels) {
        if (kernel.name == name) return &kernel;
    }
    return nullptr;
}

}  // namespace urgengo::simgpu
