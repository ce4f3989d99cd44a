// SPDX-License-Identifier: Apache-2.0
//
// The calling thread's stack of contexts. Plain data without a destructor, so that it may be used
// at any time, from other libraries' thread-exit and process-exit handlers too.
#pragma once

#include <array>
#include <cstddef>

namespace urgengo::simgpu {

struct Context;

class ContextStack {
  public:
    static constexpr std::size_t kMaxDepth = 64;

    static ContextStack& of_this_thread() {
        thread_local ContextStack stack;
        return stack;
    }

    Context* top() const { return depth_ == 0 ? nullptr : contexts_[depth_ - 1]; }

    /// @returns false if the stack is full
    bool push(Context* context) {
        if (depth_ == kMaxDepth) return false;
        contexts_[depth_++] = context;
        return true;
    }

    /// @returns what was on top; null if there was nothing
    Context* pop() { return depth_ == 0 ? nullptr : contexts_[--depth_]; }

    /// Replaces the top; null empties that place.
    void set_top(Context* context) {
        pop();
        if (context != nullptr) push(context);
    }

  private:
    std::array<Context*, kMaxDepth> contexts_{};
    std::size_t depth_ = 0;
};

}  // namespace urgengo::simgpu
