// SPDX-License-Identifier: Apache-2.0
#include "tests/support/lockstep_gpu.h"

#include <memory>
#include <utility>

namespace urgengo::testing {
namespace {

using simgpu::Fence;

constexpr nanoseconds kMark{830};
/// What a call of the driver's takes; without it, who asks again and again takes no time.
constexpr nanoseconds kQuery{20'000};

std::size_t index_of(CUevent event) {
    return reinterpret_cast<std::size_t>(event) - 1;
}

}  // namespace

LockstepGpu::LockstepGpu() : engine(part(), {}), threads(engine) {
    current_ = this;
    exec::DriverApi& api = driver.api;
    api.cuLaunchKernelEx = [](const CUlaunchConfig* config, CUfunction, void** parameters, void**) {
        return current_->launch_mark(*config, parameters);
    };
    api.cuLaunchKernelEx_ptsz = api.cuLaunchKernelEx;
    api.cuEventCreate = [](CUevent* event, unsigned) {
        *event = current_->create_event();
        return CUDA_SUCCESS;
    };
    api.cuEventRecord = [](CUevent event, CUstream stream) {
        current_->record(event, stream);
        return CUDA_SUCCESS;
    };
    api.cuEventRecord_ptsz = api.cuEventRecord;
    api.cuEventQuery = [](CUevent event) { return current_->query(event); };
}

simgpu::Part LockstepGpu::part() {
    simgpu::Part part;
    part.num_sms = kNumSms;
    part.launch_overhead = nanoseconds{1'500};
    return part;
}

simgpu::Engine::QueuePtr& LockstepGpu::queue(CUstream stream) {
    auto& queue = queues_[stream];
    if (!queue)
        queue = std::make_shared<simgpu::StreamQueue>(queues_.size(),
                                                      simgpu::StreamQueue::Kind::kNonBlocking, 1);
    return queue;
}

void LockstepGpu::submit(CUstream stream, simgpu::Work work, std::vector<Fence> fences) {
    auto& its = queue(stream);
    engine.submit(its, {std::move(work), std::move(fences), ++its->submitted});
    engine.advance_to(threads.now());
}

void LockstepGpu::launch(CUstream stream, const Kernel& kernel, int priority) {
    simgpu::KernelWork work;
    work.num_blocks = kernel.grid;
    work.blocks_per_sm = kBlocksPerSm;
    work.block_time = kernel.block_time;
    work.priority = priority;
    submit(stream, std::move(work));
}

CUresult LockstepGpu::launch_mark(const CUlaunchConfig& config, void** parameters) {
    const auto line = *static_cast<ug_mark_line**>(parameters[0]);
    const auto word0 = *static_cast<std::uint64_t*>(parameters[1]);
    const auto tag = static_cast<std::uint32_t>(*static_cast<std::uint64_t*>(parameters[2]));
    simgpu::KernelWork work;
    work.blocks_per_sm = simgpu::SmArray::kMaxBlocksPerSm;
    work.block_time = kMark;
    work.priority = config.attrs[0].value.priority;
    work.overlaps_launch = true;
    work.run = [=](nanoseconds time) {
        line->word[0] = word0;
        line->word[1] = ug_mark_word1(static_cast<std::uint64_t>(time.count()), tag);
    };
    on_mark(config.hStream, word0);
    submit(config.hStream, std::move(work));
    return CUDA_SUCCESS;
}

CUevent LockstepGpu::create_event() {
    events_.emplace_back();
    return reinterpret_cast<CUevent>(events_.size());
}

void LockstepGpu::record(CUevent event, CUstream stream) {
    events_[index_of(event)] = {queue(stream), queue(stream)->submitted};
}

void LockstepGpu::wait_event(CUstream stream, CUevent event) {
    submit(stream, simgpu::TimedWork{nanoseconds{1}, {}, {}}, {events_[index_of(event)]});
}

void LockstepGpu::synchronize(CUstream stream) {
    const auto its = queue(stream);
    threads.wait_for([its, all = its->submitted] { return its->progress.reached(all); });
}

CUresult LockstepGpu::query(CUevent event) {
    const Fence& fence = events_[index_of(event)];
    if (!fence.passed()) threads.wait_for([&fence] { return fence.passed(); }, kQuery);
    return fence.passed() ? CUDA_SUCCESS : CUDA_ERROR_NOT_READY;
}

}  // namespace urgengo::testing
