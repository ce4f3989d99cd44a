// SPDX-License-Identifier: Apache-2.0
//
// The simulated GPU's engine in virtual time, for its tests.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tools/simgpu/engine/engine.h"

namespace urgengo::simgpu {

using Kind = StreamQueue::Kind;

inline Part small_part() {
    Part part;
    part.num_sms = 2;
    part.launch_overhead = Time{1};  // the least there is
    return part;
}

/// An engine, and what happened on it by name.
class VirtualGpu {
  public:
    struct Run {
        std::int64_t start;
        std::int64_t end;
        bool operator==(const Run&) const = default;
    };

    explicit VirtualGpu(Part part = small_part())
        : engine(part, {.host_call =
                            [this](Engine::QueuePtr queue, std::function<void()> run) {
                                host_calls.emplace_back(std::move(queue), std::move(run));
                            },
                        .kernel_done =
                            [this](const KernelRecord& record) {
                                runs[*record.name] = {record.start.count(), record.end.count()};
                                order += *record.name;
                            }}) {}

    Engine::QueuePtr stream(Kind kind = Kind::kNonBlocking, std::uint64_t context = 1,
                            int device = 0) {
        return std::make_shared<StreamQueue>(next_id_++, kind, context, device);
    }

    Fence submit(const Engine::QueuePtr& queue, Work work, std::vector<Fence> fences = {}) {
        const std::uint64_t ticket = ++queue->submitted;
        engine.submit(queue, {std::move(work), std::move(fences), ticket});
        return {queue, ticket};
    }

    Fence kernel(const Engine::QueuePtr& queue, const std::string& name, std::uint64_t num_blocks,
                 std::int64_t block_ns, int priority = 0, int blocks_per_sm = 1) {
        KernelWork work;
        work.name = std::make_shared<const std::string>(name);
        work.num_blocks = num_blocks;
        work.block_time = Time{block_ns};
        work.priority = priority;
        work.blocks_per_sm = blocks_per_sm;
        return submit(queue, std::move(work));
    }

    void advance(std::int64_t ns) { engine.advance_to(Time{ns}); }

    Engine engine;
    std::map<std::string, Run> runs;
    std::string order;  ///< the kernels' names as they completed
    std::vector<std::pair<Engine::QueuePtr, std::function<void()>>> host_calls;

  private:
    std::uint64_t next_id_ = 1;
};

inline constexpr std::int64_t kLong = 1'000'000;

}  // namespace urgengo::simgpu
