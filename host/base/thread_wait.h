// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

namespace urgengo {

/// Whether a thread goes on whatever other threads do: it runs, waits for a core, or sleeps until a
/// time; it waits for no lock and no event. As /proc has it, which takes 6 us.
/// @param thread  of this process (gettid), not the one that asks
/// @returns false as well if that cannot be told: it has ended, or there is no such /proc
/// @threads any; leaves errno alone
bool goes_on_by_itself(pid_t thread);

}  // namespace urgengo
