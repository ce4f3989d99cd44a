// SPDX-License-Identifier: Apache-2.0
//
// Room for what happens once and needs much stack, such as reading a config: the program's thread
// in which it happens may have been given 16 KiB.
#pragma once

namespace urgengo {

/// Calls `function(argument)` in the calling thread, on a stack of 256 KiB that is given back
/// afterwards; without memory for it, on the thread's own. Not to be cancelled meanwhile.
/// @param function  throws nothing
void on_roomy_stack(void (*function)(void*), void* argument);

}  // namespace urgengo
