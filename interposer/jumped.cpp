// SPDX-License-Identifier: Apache-2.0
//
// Stacks grow downwards. What is called from within a hold, a signal's handler say, has its frame
// below the hold's. So a wrapper whose frame is above it was called after that hold's frame had
// gone. That holds on one stack only: both must be on the thread's own; with others (fibers,
// sigaltstack) nothing is concluded, and the thread's calls pass through, as before.
//
// A program that launches from deeper than the frame it jumped out of is not told apart until it
// calls from above once; its waits do, mostly.
#include "interposer/jumped.h"

#include <pthread.h>

#include "interposer/boundary.h"

namespace urgengo::interposer {
namespace {

class OwnStack {
  public:
    OwnStack() {
        pthread_attr_t attributes;
        if (pthread_getattr_np(pthread_self(), &attributes) != 0) return;
        void* begin = nullptr;
        if (pthread_attr_getstack(&attributes, &begin, &bytes_) != 0) bytes_ = 0;
        begin_ = static_cast<const char*>(begin);
        pthread_attr_destroy(&attributes);
    }
    bool has(const void* frame) const {
        const auto* address = static_cast<const char*>(frame);
        return begin_ && address >= begin_ && address < begin_ + bytes_;
    }

  private:
    const char* begin_ = nullptr;
    std::size_t bytes_ = 0;
};

}  // namespace

bool has_jumped_out() {
    const void* const frame = __builtin_frame_address(0);  // little below its wrapper's
    runtime::ThreadState* const thread = t_this.state;
    if (!is_armed() || !thread || !thread->at_task) return false;
    const void* const held = thread->at_task->taking.held_frame;
    if (!held || frame <= held) return false;
    bool jumped = false;
    protect([&] {
        const OwnStack stack;
        if (!stack.has(held) || !stack.has(frame)) return;
        the_runtime().jumped_out_of_hold(*thread);
        jumped = true;
    });
    if (jumped) t_this.line.inside = false;
    return jumped;
}

}  // namespace urgengo::interposer
