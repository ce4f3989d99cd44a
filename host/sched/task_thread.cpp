// SPDX-License-Identifier: Apache-2.0
#include "host/sched/task_thread.h"

#include "host/base/thread_wait.h"

namespace urgengo::sched {

bool TaskThread::goes_on_by_itself(nanoseconds now) {
    const int thread = thread_.load(kRelaxed);
    if (thread == 0) return false;
    const std::int64_t last = answer_.load(kRelaxed);
    if (now - nanoseconds(last / 2) < kBelieved) return last % 2 != 0;
    const bool answer = urgengo::goes_on_by_itself(thread);
    answer_.store(2 * now.count() + answer, kRelaxed);
    return answer;
}

}  // namespace urgengo::sched
