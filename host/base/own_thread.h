// SPDX-License-Identifier: Apache-2.0
//
// Threads of ours inside the program. Such a thread is no part of the program: it takes no signals,
// runs at no real-time priority whatever its creator's, and where the process' first thread may
// run. It is never joined. A forked child has none.
#pragma once

#include <vector>

namespace urgengo {

/// @param run  never returns; told where it is by ps as "urgengo"
/// @returns whether there is such a thread now; errno is what the C library leaves
bool start_own_thread(void (*run)(void*), void* argument);

/// @param tell  called with the number of each such thread that starts from here on, in that thread
void tell_of_own_threads(void (*tell)(unsigned id));
/// @returns the numbers of those that run now, as far as /proc says
std::vector<unsigned> own_threads();

}  // namespace urgengo
