// SPDX-License-Identifier: Apache-2.0
//
// Hands frames from one task's thread to the next. One producer, one consumer.
#pragma once

#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>

namespace urgengo::chains {

template <typename Frame>
class FrameQueue {
  public:
    /// @param keep_latest  hold only the newest frame, as a keep-last-1 subscriber does
    explicit FrameQueue(bool keep_latest) : keep_latest_(keep_latest) {}

    /// @returns the frame that had to go to make room, if any
    std::optional<Frame> push(Frame frame) {
        std::optional<Frame> overtaken;
        {
            std::lock_guard lock(mutex_);
            if (keep_latest_ && !frames_.empty()) {
                overtaken = std::move(frames_.front());
                frames_.pop_front();
            }
            frames_.push_back(std::move(frame));
        }
        changed_.notify_one();
        return overtaken;
    }

    /// No frame will follow.
    void close() {
        {
            std::lock_guard lock(mutex_);
            closed_ = true;
        }
        changed_.notify_one();
    }

    /// Waits for a frame.
    /// @returns nothing once the queue is closed and empty
    std::optional<Frame> pop() {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [this] { return closed_ || !frames_.empty(); });
        if (frames_.empty()) return std::nullopt;
        Frame frame = std::move(frames_.front());
        frames_.pop_front();
        return frame;
    }

  private:
    const bool keep_latest_;
    std::mutex mutex_;
    std::condition_variable changed_;
    std::deque<Frame> frames_;  // guarded by mutex_
    bool closed_ = false;       // guarded by mutex_
};

}  // namespace urgengo::chains
