// SPDX-License-Identifier: Apache-2.0
//
// Pages of tasks drawn at random, for programs that compare what host and GPU decide about them.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>
#include <random>

#include "device/dispatcher.cu"

namespace {

constexpr std::int64_t kNow_ns = 5'000'000'000;

void must(cudaError_t error, const char* what) {
    if (error == cudaSuccess) return;
    std::fprintf(stderr, "%s: %s\n", what, cudaGetErrorString(error));
    std::exit(error == cudaErrorNoDevice || error == cudaErrorInsufficientDriver ? 77 : 1);
}

/// Zeroed memory of the host, which the GPU sees at the same address.
template <typename T>
T* mapped(std::size_t count = 1) {
    void* memory = nullptr;
    must(cudaHostAlloc(&memory, count * sizeof(T), cudaHostAllocMapped), "memory");
    std::memset(memory, 0, count * sizeof(T));
    return static_cast<T*>(memory);
}

class Draw {
  public:
    explicit Draw(std::uint64_t seed) : engine_(seed) {}
    std::int64_t upto(std::int64_t most) {
        return std::uniform_int_distribution<std::int64_t>(0, most)(engine_);
    }
    bool one_in(int n) { return upto(n - 1) == 0; }
    std::int64_t around_now(std::int64_t far) { return kNow_ns - far + upto(2 * far); }

  private:
    std::mt19937_64 engine_;
};

void draw_slot(abi::TaskSlot& s, Draw& draw, int task) {
    constexpr std::int64_t kMs = 1'000'000;
    s.version = draw.one_in(20) ? 1 : 2;
    s.state = static_cast<abi::TaskState>(draw.upto(4));
    s.deadline_ns = draw.around_now(100 * kMs);
    s.later_gpu_ns = draw.upto(20 * kMs);
    s.later_cpu_ns = draw.upto(10 * kMs);
    s.later_idle_ns = draw.one_in(3) ? draw.upto(5 * kMs) : 0;
    s.cpu_until_ns = draw.around_now(5 * kMs);
    s.period_ns = 10 * kMs + draw.upto(100 * kMs);
    s.criticality = static_cast<std::uint16_t>(draw.upto(3));
    s.demotes = draw.one_in(8);
    s.head_utilization_ppm = static_cast<std::uint32_t>(draw.upto(1'000'000));
    s.head_remaining_ns = draw.one_in(4) ? 0 : draw.upto(20 * kMs);
    s.head_idle_ns = draw.one_in(2) ? draw.upto(10 * kMs) : 0;
    s.launched_ns = draw.upto(50 * kMs);
    s.launch_ns = draw.around_now(kMs);
    s.look_ns = draw.around_now(kMs);
    s.sync_until_ns = draw.around_now(5 * kMs);
    s.started = draw.one_in(2);
    s.launch_speed_pm = static_cast<std::uint16_t>(draw.one_in(2) ? 0 : draw.upto(1'000));
    s.progress_ns = draw.around_now(3 * kMs);
    s.cleared_until_ns = draw.one_in(8) ? draw.around_now(kMs) : 0;
    s.turn_until_ns = draw.one_in(16) ? draw.around_now(kMs) : 0;
    s.relative_deadline_ns = 20 * kMs + draw.upto(100 * kMs);
    s.chain_gpu_ns = draw.upto(30 * kMs);
    s.chain_cpu_ns = draw.upto(30 * kMs);
    s.static_rank = static_cast<std::uint32_t>(draw.upto(16));
    s.mean_utilization_ppm = static_cast<std::uint32_t>(draw.upto(1'000'000));
    s.factor_ppm = draw.one_in(2) ? 0 : 500'000 + static_cast<std::uint32_t>(draw.upto(1'000'000));
    s.is_supported = draw.one_in(2);
    s.launching = static_cast<abi::Launching>(draw.upto(2));
    s.lent_until_ns = draw.one_in(6) ? draw.upto(60 * kMs) : 0;
    s.lent_deadline_ns = draw.around_now(50 * kMs);
    s.lent_static_rank = static_cast<std::uint32_t>(draw.upto(16));
    s.lent_criticality = static_cast<std::uint16_t>(draw.upto(3));
    s.waits = draw.one_in(3);
    s.queue_why = draw.one_in(3) ? abi::Why::kTurnToLaunch : abi::Why::kRank;
    const auto done = static_cast<std::uint32_t>(draw.upto(1'000));
    s.marks_done = done;
    s.marks_issued = done + static_cast<std::uint32_t>(draw.upto(70));
    model::UnmarkedWork unmarked;
    unmarked.launched(nanoseconds(draw.around_now(5 * kMs)), nanoseconds(0), nanoseconds(0), true,
                      done + static_cast<std::uint32_t>(draw.upto(1)));
    s.unmarked_until = draw.one_in(4) ? unmarked.word() : 0;
    for (auto& at : s.launched_at_mark_ns) at = draw.upto(50 * kMs);
    const auto opened = static_cast<std::uint32_t>(draw.upto(1'000));
    s.gates_opened = opened;
    s.gates_closed =
        opened + (draw.one_in(2) ? 0 : static_cast<std::uint32_t>(draw.upto(abi::kGateRing - 1)));
    s.gate_by_ns = kNow_ns + (draw.one_in(16) ? 0 : draw.upto(100 * kMs));
    s.gate_opened_ns = draw.around_now(3 * kMs);
    s.run_ahead_ns = draw.upto(5 * kMs);
    for (std::uint32_t i = 0; i < abi::kGateRing; ++i) {
        s.group_begin_ns[i] = draw.upto(50 * kMs);
        s.group_time_ns[i] = draw.upto(kMs);
        s.group_utilization_ppm[i] = static_cast<std::uint32_t>(draw.upto(1'000'000));
    }
    (void)task;
}

void draw_page(abi::SharedPage& page, Draw& draw, int num_tasks) {
    for (auto& word : page.active) word = 0;
    abi::DispatchSettings& d = page.dispatch;
    d.policy = static_cast<std::uint32_t>(draw.upto(10));
    d.parked = draw.one_in(30);
    d.lambda = draw.one_in(2) ? 1 : -1;
    d.pack_limit_ppm = 1'050'000;
    d.share_limit_ppm = draw.one_in(4) ? 2'000'000 : 1'600'000;
    d.share_slack_ns = 10'000'000;
    d.plan_slack_ns = draw.one_in(16) ? INT64_MAX : draw.upto(20'000'000);
    for (int i = 0; i < abi::kTaskWords; ++i) {
        const auto bits = [&] {
            return static_cast<std::uint64_t>(draw.upto(INT64_MAX) & draw.upto(INT64_MAX));
        };
        d.given_up[i] = bits();
        d.late_first[i] = bits();
        d.may_share[i] = bits();
    }
    for (int task = 0; task < num_tasks; ++task) {
        draw_slot(page.tasks[task], draw, task);
        if (!draw.one_in(5)) page.active[task / 64] |= std::uint64_t{1} << (task % 64);
    }
}

}  // namespace
