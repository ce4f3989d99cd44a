// SPDX-License-Identifier: Apache-2.0
#include "host/sched/copies.h"

#include <algorithm>

#include "host/sched/policy.h"

namespace urgengo::sched {
namespace {

/// Slices begin where copies are as fast as they can be.
constexpr std::size_t kAlignment = 4096;
/// @source host/README.md, What a launch is held for
constexpr nanoseconds kOverdueMore{1'000'000};
constexpr nanoseconds kFinestSleep{10'000};

bool is_inside(const CopyEnd& end, std::size_t bytes) {
    return end.begin >= end.allocation && end.begin - end.allocation <= end.bytes &&
           bytes <= end.bytes - (end.begin - end.allocation);
}

bool overlap(const CopyEnd& a, const CopyEnd& b, std::size_t bytes) {
    return a.begin < b.begin ? b.begin - a.begin < bytes : a.begin - b.begin < bytes;
}

}  // namespace

std::size_t cut_copy(std::size_t bytes, std::size_t slice_bytes, const CopyEnd& to,
                     const CopyEnd& from) {
    const bool on_device = !to.on_host && !from.on_host;
    const std::size_t slice = on_device ? slice_bytes * kOnDeviceFactor : slice_bytes;
    if (slice == 0 || bytes <= slice) return 0;
    if (to.on_host && from.on_host) return 0;             // by the CPU, or so it may be
    if (on_device && to.device != from.device) return 0;  // between peers, perhaps in two steps
    if (to.is_managed || from.is_managed) return 0;
    if (!is_inside(to, bytes) || !is_inside(from, bytes) || overlap(to, from, bytes)) return 0;
    const std::size_t num_slices = (bytes + slice - 1) / slice;
    const std::size_t even = (bytes + num_slices - 1) / num_slices;
    return std::min(slice, (even + kAlignment - 1) / kAlignment * kAlignment);
}

nanoseconds copy_time(std::size_t bytes, double gbps) {
    return nanoseconds(static_cast<std::int64_t>(static_cast<double>(bytes) / gbps));
}

bool CopyPace::copied(std::size_t bytes, std::size_t slice_bytes) {
    unmarked_ += bytes;
    return unmarked_ >= slice_bytes / 2;
}

void CopyPace::marked(nanoseconds now) {
    pieces_[next()] = {unmarked_, now};
    unmarked_ = 0;
    ++num_;
}

nanoseconds CopyPace::begin_of_oldest() const {
    return std::max(pieces_[first_].issued, last_end_);
}

std::optional<double> CopyPace::finished(nanoseconds now, bool watched) {
    const Piece done = pieces_[first_];
    const bool was_next = done.issued <= last_end_ && end_is_exact_ && watched;
    const nanoseconds time = now - last_end_;
    first_ = (first_ + 1) % kMaxUnderWay;
    --num_;
    last_end_ = now;
    end_is_exact_ = watched;
    if (!was_next || time.count() <= 0) return std::nullopt;
    return static_cast<double>(done.bytes) / static_cast<double>(time.count());
}

bool CopyPace::is_overdue(nanoseconds now) const {
    return now - begin_of_oldest() > 2 * copy_time(pieces_[first_].bytes, kSlowGbps) + kOverdueMore;
}

nanoseconds CopyPace::sleep(nanoseconds now, double gbps, nanoseconds longest) const {
    const nanoseconds time = copy_time(pieces_[first_].bytes, gbps);
    const nanoseconds left = begin_of_oldest() + time - now;
    const nanoseconds finest = std::min(std::max(kFinestSleep, time / 8), longest);
    return std::clamp(left, finest, longest);
}

std::size_t CopyPace::bytes_under_way() const {
    std::size_t sum = unmarked_;
    for (std::size_t i = 0; i < num_; ++i) sum += pieces_[(first_ + i) % kMaxUnderWay].bytes;
    return sum;
}

bool copy_must_wait(const config::Scheduler& scheduler, const Snapshot& snapshot,
                    std::span<const bool> unfinished) {
    const Order order(scheduler, snapshot);
    for (std::size_t i = 1; i < snapshot.tasks.size(); ++i)
        if (unfinished[i] && order.is_before_self(i)) return true;
    return false;
}

}  // namespace urgengo::sched
