// SPDX-License-Identifier: Apache-2.0
//
// The thread of ours that waits for words of `urgengo ctl` (abi/status_page.h): in the kernel, by a
// futex, so that it costs nothing until one comes, and comes even while all threads of the program
// hang.
#pragma once

#include "host/runtime/runtime.h"

namespace urgengo::interposer {

/// @param runtime  is never destroyed
void listen_to_control(runtime::Runtime& runtime);

}  // namespace urgengo::interposer
