// SPDX-License-Identifier: Apache-2.0
#include "host/sched/expected_frames.h"

#include <algorithm>

#include "host/base/memory_orders.h"
#include "host/model/urgency.h"
#include "host/sched/criticality.h"

namespace urgengo::sched {
namespace {

constexpr nanoseconds kHorizon{60'000'000};
constexpr int kStopped = 2;

}  // namespace

std::optional<SlotView> expected_frame(const GovernedChain& chain, const Tasks& tasks,
                                       nanoseconds now) {
    const nanoseconds last(chain.last_arrival_ns.load(kRelaxed));
    const nanoseconds arrival = last + chain.period();
    if (last.count() == 0 || arrival > now + kHorizon || now > last + kStopped * chain.period())
        return std::nullopt;
    const GovernedTask& first = tasks[chain.tasks.front()];
    const abi::TaskSlot& slot = *first.slot;
    const nanoseconds cpu(first.estimated.cpu_ns.load(kRelaxed)),
        gpu(first.estimated.gpu_ns.load(kRelaxed));
    const nanoseconds idle(first.estimated.idle_ns.load(kRelaxed));
    SlotView view;
    view.task = SlotView::kExpected;
    view.of_chain = static_cast<int>(chain.index);
    view.deadline = std::max(arrival, now) + chain.deadline();
    view.period = chain.period();
    view.release = std::max(arrival, now) + cpu;
    view.remaining.gpu = nanoseconds(slot.chain_gpu_ns.load(kRelaxed));
    view.later.gpu = view.remaining.gpu - gpu;
    view.remaining.idle = nanoseconds(slot.chain_idle_ns.load(kRelaxed));
    view.later.idle = view.remaining.idle - idle;
    view.later.cpu = nanoseconds(slot.chain_cpu_ns.load(kRelaxed)) - cpu;
    view.remaining.cpu = view.later.cpu + cpu;
    view.is_supported = slot.is_supported.load(kRelaxed) != 0;
    view.launching.slowed = static_cast<model::Launching>(slot.launching.load(kRelaxed));
    view.launching.share = tasks.launch_share(view.launching.slowed);
    view.laxity =
        model::laxity({view.deadline, view.remaining.gpu + view.remaining.idle, view.remaining.cpu},
                      std::max(arrival, now));
    view.chain.criticality = criticality(chain);
    return view;
}

}  // namespace urgengo::sched
