// SPDX-License-Identifier: Apache-2.0
//
// Waiting for a stream's progress without a lock on the engine's path.
#include "tools/simgpu/engine/stream_queue.h"

namespace urgengo::simgpu {

// No wake-up is lost: the waiter counts itself before it reads `completed_`, the engine writes
// `completed_` before it reads the count, and both orders are sequentially consistent; so either
// the waiter sees the new ticket, or the engine sees the waiter and takes the mutex, which it gets
// only once the waiter sleeps.
void Progress::publish(std::uint64_t ticket) {
    completed_.store(ticket, std::memory_order_seq_cst);
    if (num_waiters_.load(std::memory_order_seq_cst) == 0) return;
    { std::lock_guard lock(mutex_); }
    advanced_.notify_all();
}

void Progress::wait_for(std::uint64_t ticket) {
    if (reached(ticket)) return;
    std::unique_lock lock(mutex_);
    num_waiters_.fetch_add(1, std::memory_order_seq_cst);
    advanced_.wait(lock, [&] { return reached(ticket); });
    num_waiters_.fetch_sub(1, std::memory_order_seq_cst);
}

bool Fence::passed() const {
    return !queue || queue->progress.reached(ticket);
}

void Fence::wait() const {
    if (queue) queue->progress.wait_for(ticket);
}

}  // namespace urgengo::simgpu
