// SPDX-License-Identifier: Apache-2.0
#include "host/sched/expected_frames.h"

#include <algorithm>

#include "host/model/urgency.h"
#include "host/sched/criticality.h"

namespace urgengo::sched {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
constexpr nanoseconds kHorizon{60'000'000};
constexpr int kStopped = 2;

}  // namespace

std::optional<SlotView> expected_frame(const GovernedChain& chain, const Tasks& tasks,
                                       nanoseconds now) {
    const nanoseconds last(chain.last_arrival_ns.load(kRelaxed));
    const nanoseconds arrival = last + chain.config.period;
    if (last.count() == 0 || arrival > now + kHorizon ||
        now > last + kStopped * chain.config.period)
        return std::nullopt;
    const GovernedTask& first = tasks[chain.tasks.front()];
    const abi::TaskSlot& slot = *first.slot;
    const nanoseconds cpu(first.cpu_time_ns.load(kRelaxed)), gpu(first.gpu_time_ns.load(kRelaxed));
    const nanoseconds idle(first.idle_time_ns.load(kRelaxed));
    SlotView view;
    view.task = SlotView::kExpected;
    view.deadline = std::max(arrival, now) + chain.config.deadline;
    view.period = chain.config.period;
    view.release = std::max(arrival, now) + cpu;
    view.remaining_gpu = nanoseconds(slot.chain_gpu_ns.load(kRelaxed));
    view.later_gpu = view.remaining_gpu - gpu;
    view.remaining_idle = nanoseconds(slot.chain_idle_ns.load(kRelaxed));
    view.later_idle = view.remaining_idle - idle;
    view.later_cpu = nanoseconds(slot.chain_cpu_ns.load(kRelaxed)) - cpu;
    view.remaining_cpu = view.later_cpu + cpu;
    view.is_supported = slot.is_supported.load(kRelaxed) != 0;
    view.launching = static_cast<model::Launching>(slot.launching.load(kRelaxed));
    view.launch_share = tasks.launch_share(view.launching);
    view.laxity =
        model::laxity({view.deadline, view.remaining_gpu + view.remaining_idle, view.remaining_cpu},
                      std::max(arrival, now));
    view.criticality = criticality(chain);
    return view;
}

}  // namespace urgengo::sched
