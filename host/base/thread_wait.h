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
        kMutex,    ///< another thread has it
    };
    For what = For::kUnknown;
    pid_t owner =
        0;  ///< the thread that has the mutex, if it is one of the C library's; 0: unknown
};

/// As /proc has it: the system call in which it waits (proc_pid_syscall(5)). A mutex is waited for
/// by FUTEX_WAIT or FUTEX_LOCK_PI, a condition or a semaphore by FUTEX_WAIT_BITSET; which thread
/// has it is read out of it. Takes 6 us.
/// @param thread  of this process (gettid), not the one that asks
/// @returns kUnknown as well if that cannot be told: it has ended, or there is no such /proc
/// @threads any; leaves errno alone
ThreadWait what_waits_for(pid_t thread);

}  // namespace urgengo
