// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

namespace urgengo {

/// What a thread waits for.
struct ThreadWait {
    enum class For {
        kUnknown,  ///< or for something other than the two below: an event, a condition, data
        kNothing,  ///< whatever other threads do it goes on: it runs, waits for a core, or sleeps
                   ///< until a time
        kMutex,    ///< of the C library, which another thread has
    };
    For what = For::kUnknown;
    pid_t owner = 0;  ///< the thread that has the mutex
};

/// As /proc has it: the system call in which it waits (proc_pid_syscall(5)), and, if that is
/// FUTEX_WAIT or FUTEX_LOCK_PI of a pthread_mutex_t, which thread has that. Takes 6 us, and as much
/// again of one that waits for a mutex.
/// @param thread  of this process (gettid), not the one that asks
/// @returns kUnknown as well if that cannot be told: it has ended, /proc is not there or does not
///          say, the mutex is of another library, robust, shared between processes, or waited for
///          until a time
/// @threads any; leaves errno alone, is no cancellation point
ThreadWait what_waits_for(pid_t thread);

}  // namespace urgengo
