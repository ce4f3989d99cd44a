// SPDX-License-Identifier: Apache-2.0
//
// Progress source `kernel`: launches one-thread mark kernels behind the program's own kernels, on
// the program's stream, at the highest priority, and holds the mapped memory that they write.
//
// Marks run at the highest priority because a mark waits for a free block slot: at the lowest it is
// 3.5 ms late behind a kernel that fills the GPU, at the highest 126 us (measured, H200, driver
// 580.159.04, 2026-11-21).
//
// Every context has its own mailbox, in memory of ours that is registered there: it outlives the
// context, so a reader never faults, and no GPU ever writes through another context's registration.
// Contexts are told apart by id, because their handles are reused.
//
// Calls the driver in the program's thread and its current context, and changes neither. Set-up
// runs in relaxed capture mode: in a global-mode capture a module load of ours in any thread would
// invalidate the program's capture.
#pragma once

#include <array>
#include <atomic>
#include <mutex>

#include "host/exec/driver_api.h"
#include "urgengo/abi/device_mailbox.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::exec {

/// What marks need in one context.
struct MarkContext {
    unsigned long long id = 0;
    CUdevice device = 0;
    CUfunction kernel = nullptr;    ///< null: this context gets no marks
    CUfunction delay = nullptr;     ///< keeps a stream busy for a time in ns; may be null
    ug_mark_line* lines = nullptr;  ///< shape [abi::kMaxTasks], host address
    CUdeviceptr d_lines = 0;        ///< the same, as the GPU sees it
    int least_priority = 0;
    int greatest_priority = 0;
    int num_sms = 0;
    double resident_threads = 1;  ///< threads that the GPU can hold at once
};

class ProgressMarks {
  public:
    explicit ProgressMarks(const DriverApi& driver) : driver_(driver) {}

    /// Makes marks possible in the calling thread's current context.
    /// @returns null if it gets none: none is current, the driver refused, or there are too many
    /// @threads any; takes a lock only for a context that it has not seen
    const MarkContext* prepare();

    /// Launches the mark with this sequence number behind what is on `stream`.
    /// @param context  as prepare() answered, and still current
    CUresult launch(const MarkContext& context, int task, std::uint64_t word0,
                    std::uint32_t sequence, CUstream stream, StreamFlavor flavor) const {
        return launch_at(context, context.d_lines + sizeof(ug_mark_line) * std::size_t(task), word0,
                         sequence, stream, flavor);
    }
    /// The same to a line anywhere in mapped memory.
    CUresult launch_at(const MarkContext& context, CUdeviceptr d_line, std::uint64_t word0,
                       std::uint32_t sequence, CUstream stream, StreamFlavor flavor) const;

    /// @returns `count` lines, mapped into the current context as `d_lines`; null if refused. They
    ///          are never unmapped: the GPU may write to them for as long as it runs.
    ug_mark_line* allocate_lines(std::size_t count, CUdeviceptr& d_lines) const;

    const DriverApi& driver() const { return driver_; }

  private:
    static constexpr int kMaxContexts = 64;

    const MarkContext* find(unsigned long long id) const;
    const MarkContext* load(unsigned long long id);
    bool set_up(MarkContext& context) const;

    const DriverApi& driver_;
    std::mutex mutex_;
    std::array<MarkContext, kMaxContexts> contexts_;
    std::atomic<int> num_contexts_{0};  // entries below are complete and never change again
};

/// Relaxed capture mode for as long as the object lives.
class RelaxedCaptureMode {
  public:
    explicit RelaxedCaptureMode(const DriverApi& driver) : driver_(driver) {
        if (driver_.cuThreadExchangeStreamCaptureMode)
            exchanged_ = driver_.cuThreadExchangeStreamCaptureMode(&mode_) == CUDA_SUCCESS;
    }
    ~RelaxedCaptureMode() {
        if (exchanged_) driver_.cuThreadExchangeStreamCaptureMode(&mode_);
    }
    RelaxedCaptureMode(const RelaxedCaptureMode&) = delete;
    RelaxedCaptureMode& operator=(const RelaxedCaptureMode&) = delete;

  private:
    const DriverApi& driver_;
    CUstreamCaptureMode mode_ = CU_STREAM_CAPTURE_MODE_RELAXED;
    bool exchanged_ = false;
};

}  // namespace urgengo::exec
