// SPDX-License-Identifier: Apache-2.0
//
// Times every kernel of a program for `urgengo profile --source marks` and `discover`: a mark right
// behind each launch, and one before it where the stream was idle, each with a timestamp of the
// GPU's. The mark before it stands behind a short delay on the GPU: on an idle one it would run at
// once, the kernel only when its launch arrives, and launching would count as GPU time. One that
// ran before the launch's call had ended is marked as loose.
//
// A mark adds about 1.7 us of GPU time and 2.6 us of CPU time to a kernel (measured, H200), so this
// is for learning, not for running. What marks add on the GPU is measured (exec/mark_cost.h) so
// that readers can take it off.
//
// One KernelTimer a thread and context; one thread at a time touches it.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>

#include "host/exec/progress_marks.h"
#include "urgengo/abi/trace_record.h"

namespace urgengo::exec {

using std::chrono::nanoseconds;

class KernelTimer {
  public:
    /// @returns a timer for the calling thread in the current context, or null if it cannot be
    static std::unique_ptr<KernelTimer> create(const ProgressMarks& marks,
                                               const MarkContext& context);
    ~KernelTimer();

    const MarkContext& context() const { return context_; }

    /// Before a launch on `stream`: a mark, if all that this timer has seen there has executed.
    void before_launch(CUstream stream, StreamFlavor flavor);
    /// Behind it: a mark, and the launch's times go into `record` once they are known.
    void after_launch(abi::TraceRecord* record, CUstream stream, StreamFlavor flavor);
    /// Forgets the mark before a launch that failed.
    void launch_failed() { begin_ = kNoEntry; }

    /// Writes the times that have come in since into their records.
    void collect();

  private:
    static constexpr std::uint32_t kEntries = 8192;
    static constexpr std::uint32_t kNoEntry = ~0u;

    struct Pending {
        abi::TraceRecord* record = nullptr;
        std::uint32_t begin = kNoEntry;
        std::uint32_t end = kNoEntry;
    };

    KernelTimer(const ProgressMarks& marks, const MarkContext& context, ug_mark_line* lines,
                CUdeviceptr d_lines);
    std::uint32_t mark(CUstream stream, StreamFlavor flavor);
    std::uint64_t time_of(std::uint32_t entry) const;  // 0: not executed yet

    const ProgressMarks& marks_;
    const MarkContext& context_;
    ug_mark_line* const lines_;
    const CUdeviceptr d_lines_;
    std::uint32_t next_ = 0;  // counts marks; the entry is next_ % kEntries
    std::uint32_t begin_ = kNoEntry;
    CUstream last_stream_ = nullptr;
    StreamFlavor last_flavor_ = StreamFlavor::kLegacy;
    std::uint32_t last_end_ = kNoEntry;
    std::deque<Pending> pending_;
};

}  // namespace urgengo::exec
