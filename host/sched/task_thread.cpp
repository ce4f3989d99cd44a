// SPDX-License-Identifier: Apache-2.0
#include "host/sched/task_thread.h"

namespace urgengo::sched {

// Of threads that ask at once, the owner of one may stay with the answer of another for as long as
// that is believed.
ThreadWait TaskThread::wait(nanoseconds now, nanoseconds believed) {
    const int thread = id();
    if (thread == 0) return {};
    const std::int64_t last = answer_.load(std::memory_order_acquire);
    if (now - nanoseconds(last / kAnswers) < believed)
        return {static_cast<ThreadWait::For>(last % kAnswers), owner_.load(kRelaxed)};
    const ThreadWait wait = what_waits_for(thread);
    owner_.store(wait.owner, kRelaxed);
    if (wait.what == ThreadWait::For::kMutex) waits_for_mutexes_.store(true, kRelaxed);
    answer_.store(kAnswers * now.count() + static_cast<std::int64_t>(wait.what),
                  std::memory_order_release);
    return wait;
}

}  // namespace urgengo::sched
