// SPDX-License-Identifier: Apache-2.0
//
// The few lines that UrgenGo says inside the user's program: on stderr, one line each, with
// the prefix "urgengo:". Never stdout, never on a launch path.
//
// Nothing is said rather than the program harmed. A line that stderr does not take now is dropped,
// and so is one that would go anywhere but to the stderr that the program was started with. No
// signal, cancellation or errno of ours reaches the calling thread, and no lock is taken, which a
// forked child might find taken for ever.
#pragma once

#include <string_view>

namespace urgengo {

/// Remembers which file stderr is. To be called before the program itself may put another file in
/// its place; else the first line does it.
void remember_stderr();

/// Says one line; what is longer than PIPE_BUF is cut.
void log_line(std::string_view message);

/// Says every line of the text as it is, without a prefix.
void log_text(std::string_view lines);

}  // namespace urgengo
