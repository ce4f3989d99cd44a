// SPDX-License-Identifier: Apache-2.0
//
// What kernel launches and graph launches have in common.
#pragma once

#include <optional>

#include "interposer/boundary.h"

namespace urgengo::interposer {

/// The stream has the priority for as long as the object lives (a cancelled thread's, too).
class LentPriority {
  public:
    LentPriority(const runtime::Launch& launch, int priority) : launch_(launch) {
        protect([&] {
            lent_ =
                the_runtime().streams().priorities().lend(launch.stream, launch.flavor, priority);
        });
    }
    ~LentPriority() {
        if (lent_)
            protect([&] {
                the_runtime().streams().priorities().give_back(launch_.stream, launch_.flavor);
            });
    }
    LentPriority(const LentPriority&) = delete;
    LentPriority& operator=(const LentPriority&) = delete;

  private:
    const runtime::Launch& launch_;
    bool lent_ = false;
};

/// A stream of ours stands in for the launch's for as long as the object lives; then the program's
/// own goes on behind it.
class PooledStream {
  public:
    PooledStream(const runtime::Launch& launch, const runtime::Grant& grant) : launch_(launch) {
        protect([&] { lane_ = the_runtime().launches().enter_pool(launch, grant); });
    }
    ~PooledStream() {
        if (lane_)
            protect([&] {
                the_runtime().streams().pool().join(*lane_, launch_.stream, launch_.flavor);
            });
    }
    PooledStream(const PooledStream&) = delete;
    PooledStream& operator=(const PooledStream&) = delete;

    CUstream get() const { return lane_ ? lane_->stream : launch_.stream; }

  private:
    const runtime::Launch& launch_;
    const exec::PriorityPool::Lane* lane_ = nullptr;
};

/// No gate is closed for as long as the object lives, however that ends.
class ParkedToLoad {
  public:
    ParkedToLoad() {
        protect([this] {
            the_runtime().gate_keeper().park();
            parked_ = true;
        });
    }
    ~ParkedToLoad() {
        if (parked_) protect([] { the_runtime().gate_keeper().unpark(); });
    }
    ParkedToLoad(const ParkedToLoad&) = delete;
    ParkedToLoad& operator=(const ParkedToLoad&) = delete;

  private:
    bool parked_ = false;
};

/// Asks the runtime about the launch, forwards it once, and tells the runtime.
/// @param plain        () -> CUresult: the program's own call, unchanged
/// @param prioritized  (const Grant&) -> CUresult: the same at a priority of ours
template <typename Plain, typename Prioritized>
CUresult scheduled_launch(const runtime::Launch& launch, Plain&& plain, Prioritized&& prioritized) {
    runtime::Grant grant;
    runtime::ThreadState* thread = nullptr;
    const Inside inside;
    protect([&] {
        thread = this_thread();
        if (thread) grant = the_runtime().launches().before(*thread, launch);
    });
    std::optional<ParkedToLoad> parked;
    if (grant.may_load) [[unlikely]]
        parked.emplace();
    const CUresult result = grant.set_priority ? prioritized(grant) : plain();
    parked.reset();
    if (grant.task || grant.traced)
        protect([&] {
            the_runtime().launches().after(*thread, launch, grant, result == CUDA_SUCCESS);
        });
    return result;
}

/// Makes a granted launch without giving it a priority itself: its stream is lent one, or a stream
/// of that priority stands in, as the config says.
/// @param on_stream  (CUstream) -> CUresult: the program's own call, on that stream
template <typename OnStream>
CUresult launch_by_stream(const runtime::Launch& launch, const runtime::Grant& grant,
                          OnStream&& on_stream) {
    if (the_runtime().launches().priority_via() == config::PriorityVia::kStreamPool) {
        const PooledStream pooled(launch, grant);
        return on_stream(pooled.get());
    }
    const LentPriority lent(launch, grant.priority);
    return on_stream(launch.stream);
}

/// A launch that cannot carry a priority.
template <typename OnStream>
CUresult scheduled_on_stream(const runtime::Launch& launch, OnStream&& on_stream) {
    return scheduled_launch(
        launch, [&] { return on_stream(launch.stream); },
        [&](const runtime::Grant& grant) { return launch_by_stream(launch, grant, on_stream); });
}

}  // namespace urgengo::interposer
