// SPDX-License-Identifier: Apache-2.0
//
// Whether a call that finds its thread inside a wrapper is in truth the program's own: because it
// has jumped out of a held launch (siglongjmp), and that wrapper never came to its end.
#pragma once

namespace urgengo::interposer {

/// If so, puts right what the jump has left lying; the thread is not inside any more.
/// @returns whether the calling thread has jumped out of a hold
/// @threads any, inside a wrapper
bool has_jumped_out();

}  // namespace urgengo::interposer
