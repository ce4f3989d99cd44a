// SPDX-License-Identifier: Apache-2.0
#include "host/sched/lateness_windows.h"

#include <algorithm>

namespace urgengo::sched {
namespace {

/// Of (the median of the squared steps from one window's lateness to the next's) / (their mean).
/// It is about 1 where frames are late one by one.
constexpr double kUneven = 4;

}  // namespace

void LatenessWindows::next(nanoseconds now, nanoseconds length) {
    if (length_.count() > 0) last_[count_++ % kKept] = sum_;
    begin_ = now;
    length_ = length;
    sum_ = 0;
}

// From one window to the next, and by the median: a program that has just become another is none.
bool LatenessWindows::are_uneven() const {
    const std::size_t n = std::min(count_, kKept), first = count_ - n;
    if (n < kFew) return false;
    double all = last_[first % kKept];
    std::array<double, kKept> squares{};
    for (std::size_t i = 1; i < n; ++i) {
        const double its = last_[(first + i) % kKept];
        const double step = its - last_[(first + i - 1) % kKept];
        squares[i - 1] = step * step;
        all += its;
    }
    const auto end = squares.begin() + static_cast<std::ptrdiff_t>(n - 1);
    const auto median = squares.begin() + static_cast<std::ptrdiff_t>((n - 1) / 2);
    std::nth_element(squares.begin(), median, end);
    return *median > kUneven * all / static_cast<double>(n);
}

double LatenessWindows::worst(std::size_t in_a_row) const {
    const std::size_t n = std::min(count_, kKept), oldest = count_ - n;
    double most = 0;
    for (std::size_t first = 0; first < n; ++first) {
        double all = 0;
        for (std::size_t i = first; i < std::min(first + in_a_row, n); ++i)
            all += last_[(oldest + i) % kKept];
        most = std::max(most, all);
    }
    return most;
}

}  // namespace urgengo::sched
