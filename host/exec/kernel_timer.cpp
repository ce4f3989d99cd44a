// SPDX-License-Identifier: Apache-2.0
#include "host/exec/kernel_timer.h"

#include <algorithm>

// A mark on an idle stream executes at once, and the kernel behind it comes only when its launch
// does: launching would count as its time, 5 us of an eager network's every kernel. So an idle
// stream is given something to do first, for about as long as a launch takes: then the mark
// executes when the kernel is queued already. Whether it did is seen when the launch has returned;
// if not, the launch is kTraceLoose, and the next delay is longer.
namespace urgengo::exec {
namespace {

constexpr std::uint64_t kShortestDelayNs = 30'000;
constexpr std::uint64_t kLongestDelayNs = 480'000;  // graphs of many nodes
/// As long as the calling thread's launches need it.
__attribute__((tls_model("initial-exec"))) thread_local std::uint64_t t_delay_ns = kShortestDelayNs;

void keep_busy(const DriverApi& driver, CUfunction delay, CUstream stream, StreamFlavor flavor) {
    const auto launch = of_flavor(flavor, driver.cuLaunchKernel, driver.cuLaunchKernel_ptsz);
    if (!delay || !launch) return;
    std::uint64_t delay_ns = t_delay_ns;
    void* parameters[] = {&delay_ns};
    launch(delay, 1, 1, 1, 1, 1, 1, 0, stream, parameters, nullptr);
}

}  // namespace

std::unique_ptr<KernelTimer> KernelTimer::create(const ProgressMarks& marks,
                                                 const MarkContext& context) {
    CUdeviceptr d_lines = 0;
    ug_mark_line* lines = marks.allocate_lines(kEntries, d_lines);
    if (!lines) return nullptr;
    return std::unique_ptr<KernelTimer>(new KernelTimer(marks, context, lines, d_lines));
}

KernelTimer::KernelTimer(const ProgressMarks& marks, const MarkContext& context,
                         ug_mark_line* lines, CUdeviceptr d_lines)
    : marks_(marks), context_(context), lines_(lines), d_lines_(d_lines) {}

// The memory stays: the GPU may still have marks of this thread to execute.
KernelTimer::~KernelTimer() = default;

std::uint32_t KernelTimer::mark(CUstream stream, StreamFlavor flavor) {
    const std::uint32_t sequence = next_;
    ug_mark_line& line = lines_[sequence % kEntries];
    const CUdeviceptr d_line = d_lines_ + sizeof(ug_mark_line) * (sequence % kEntries);
    // Executed when both words carry the tag of this sequence number, which the last user of the
    // entry, kEntries marks ago, did not have.
    __atomic_store_n(&line.word[1], std::uint64_t{static_cast<std::uint16_t>(~sequence)},
                     __ATOMIC_RELEASE);
    if (marks_.launch_at(context_, d_line, ug_mark_word0(0, 0, sequence), sequence, stream,
                         flavor) != CUDA_SUCCESS)
        return kNoEntry;
    ++next_;
    return sequence;
}

std::uint64_t KernelTimer::time_of(std::uint32_t entry) const {
    const ug_mark_line& line = lines_[entry % kEntries];
    const auto tag = static_cast<std::uint16_t>(entry);
    const std::uint64_t word1 = __atomic_load_n(&line.word[1], __ATOMIC_ACQUIRE);
    return static_cast<std::uint16_t>(word1) == tag ? word1 >> 16 : 0;
}

void KernelTimer::before_launch(CUstream stream, StreamFlavor flavor) {
    begin_ = kNoEntry;
    if (pending_.size() >= kEntries / 2 - 1) collect();
    if (pending_.size() >= kEntries / 2 - 1) return;  // the GPU is far behind: not timed
    const bool same_stream =
        last_end_ != kNoEntry && stream == last_stream_ && flavor == last_flavor_;
    // While the last launch's mark is outstanding, this launch begins at that mark.
    if (same_stream && time_of(last_end_) == 0) return;
    keep_busy(marks_.driver(), context_.delay, stream, flavor);
    begin_ = mark(stream, flavor);
}

void KernelTimer::after_launch(abi::TraceRecord* record, CUstream stream, StreamFlavor flavor) {
    if (pending_.size() >= kEntries / 2 - 1) {
        last_end_ = kNoEntry;
        return;
    }
    const bool same_stream = stream == last_stream_ && flavor == last_flavor_;
    const std::uint32_t from = begin_ != kNoEntry ? begin_ : same_stream ? last_end_ : kNoEntry;
    const bool waited = from != kNoEntry && time_of(from) == 0;
    if (!waited && record) record->flags |= abi::kTraceLoose;
    if (begin_ != kNoEntry)
        t_delay_ns = waited ? std::max(kShortestDelayNs, t_delay_ns - t_delay_ns / 16)
                            : std::min(kLongestDelayNs, t_delay_ns * 2);
    const std::uint32_t end = mark(stream, flavor);
    last_stream_ = stream;
    last_flavor_ = flavor;
    last_end_ = end;
    if (record && end != kNoEntry) pending_.push_back({record, begin_, end});
    begin_ = kNoEntry;
}

void KernelTimer::collect() {
    while (!pending_.empty()) {
        const Pending& oldest = pending_.front();
        const std::uint64_t end = time_of(oldest.end);
        if (end == 0) return;  // as are, most likely, all behind it
        oldest.record->launch.gpu_end_ns = end;
        if (oldest.begin != kNoEntry) oldest.record->launch.gpu_begin_ns = time_of(oldest.begin);
        pending_.pop_front();
    }
}

}  // namespace urgengo::exec
