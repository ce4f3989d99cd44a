// SPDX-License-Identifier: Apache-2.0
//
// 1 The program writes record n at [n % kFrameRing], then publishes n + 1. So at a time at which it
//   has published F, the records from F on may be half written, where those from F - kFrameRing on
//   were. Threads that end frames of one chain at a time write a few of them.
// 2 Records are copied first; what has been published is read again then. Those of the copy that
//   may have been written over meanwhile are unread, kMargin of them for the threads of 1.
#include "tools/urgengo/page/frame_follower.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <numeric>

#include "host/observe/page_folder.h"

namespace urgengo::cli {
namespace {

using namespace std::chrono_literals;

constexpr std::uint64_t kMargin = 64;
constexpr std::uint32_t kMostFollowed = 1024;

constexpr std::array<nanoseconds, 24> kLatencies = {
    1ms,   2ms,   5ms,   10ms,  15ms,  20ms,  25ms,  30ms,  40ms,  50ms, 60ms, 80ms,
    100ms, 125ms, 150ms, 200ms, 250ms, 300ms, 400ms, 500ms, 750ms, 1s,   2s,   5s};
constexpr std::array<nanoseconds, 12> kLatenesses = {0ms,  1ms,   2ms,   5ms,   10ms, 20ms,
                                                     50ms, 100ms, 200ms, 500ms, 1s,   5s};

/// FrameRecord, as it is copied from the file.
struct Record {
    std::int64_t end_ns;
    std::uint32_t latency_us;
    std::uint16_t cause;
    std::int16_t behind;
};
static_assert(sizeof(Record) == sizeof(abi::FrameRecord));

/// @returns whether all of it is there
bool read_at(int fd, void* to, std::size_t bytes, std::uint64_t at) {
    ssize_t got;
    do got = pread(fd, to, bytes, static_cast<off_t>(at));
    while (got < 0 && errno == EINTR);
    return got == static_cast<ssize_t>(bytes);
}

bool fits(const abi::StatusSection& section, std::uint64_t file_bytes) {
    return section.count <= kMostFollowed && section.element_bytes >= sizeof(abi::ChainStatus) &&
           section.offset <= file_bytes &&
           std::uint64_t{section.count} * section.element_bytes <= file_bytes - section.offset;
}

}  // namespace

void TimeHistogram::add(nanoseconds time) {
    const auto bound = std::lower_bound(bounds_.begin(), bounds_.end(), time);
    ++counts_[static_cast<std::size_t>(bound - bounds_.begin())];
    sum_ += time;
}

std::uint64_t TimeHistogram::total() const {
    return std::accumulate(counts_.begin(), counts_.end(), std::uint64_t{0});
}

FollowedFrames::FollowedFrames() : latency(kLatencies), lateness(kLatenesses) {}

std::unique_ptr<FrameFollower> FrameFollower::open(const std::string& stem) {
    const std::string path = stem + observe::kPageSuffix;
    const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (fd < 0) return nullptr;
    std::unique_ptr<FrameFollower> follower(new FrameFollower(fd, {}));
    struct stat status {};
    std::uint64_t magic = 0;
    abi::StatusSection section{};
    if (fstat(fd, &status) != 0 || !S_ISREG(status.st_mode) ||
        !read_at(fd, &magic, sizeof magic, 0) || magic != abi::kStatusMagic ||
        !read_at(fd, &section, sizeof section, offsetof(abi::StatusHeader, chains)) ||
        !fits(section, static_cast<std::uint64_t>(status.st_size)))
        return nullptr;
    follower->section_ = section;
    follower->chains_.resize(section.count);
    for (std::size_t i = 0; i < section.count; ++i) {
        std::int64_t deadline_ns = 0;
        const std::uint64_t at = section.offset + i * section.element_bytes;
        if (read_at(fd, &deadline_ns, sizeof deadline_ns,
                    at + offsetof(abi::ChainStatus, deadline_ns)))
            follower->chains_[i].deadline = nanoseconds(std::max<std::int64_t>(deadline_ns, 0));
    }
    return follower;
}

FrameFollower::FrameFollower(int fd, const abi::StatusSection& section)
    : file_(fd), section_(section) {}

bool FrameFollower::is_of(const std::string& stem) const {
    struct stat own {
    }, now{};
    return fstat(file_.get(), &own) == 0 &&
           lstat((stem + observe::kPageSuffix).c_str(), &now) == 0 && own.st_dev == now.st_dev &&
           own.st_ino == now.st_ino;
}

void FrameFollower::follow() {
    for (std::size_t i = 0; i < chains_.size(); ++i) follow(i);
}

void FrameFollower::follow(std::size_t index) {
    FollowedFrames& chain = chains_[index];
    const std::uint64_t at = section_.offset + index * section_.element_bytes;
    const auto published = [&](std::uint64_t& frames) {
        return read_at(file_.get(), &frames, sizeof frames,
                       at + offsetof(abi::ChainStatus, frames));
    };
    std::uint64_t end = 0, after = 0;
    if (!published(end) || end <= chain.next) return;
    std::array<Record, abi::kFrameRing> ring;
    if (!read_at(file_.get(), ring.data(), sizeof ring, at + offsetof(abi::ChainStatus, ring)) ||
        !published(after))
        return;
    constexpr std::uint64_t kReadable = abi::kFrameRing - kMargin;
    const std::uint64_t oldest = after > kReadable ? after - kReadable : 0;
    const std::uint64_t first = std::min(std::max(chain.next, oldest), end);
    chain.unread += first - chain.next;
    for (std::uint64_t n = first; n < end; ++n) {
        const Record& record = ring[n % abi::kFrameRing];
        const nanoseconds latency = std::chrono::microseconds(record.latency_us);
        chain.latency.add(latency);
        // Latencies are cut to microseconds: whether a frame was late its cause says.
        chain.lateness.add(record.cause == 0
                               ? nanoseconds{0}
                               : std::max<nanoseconds>(latency - chain.deadline, 1us));
    }
    chain.next = end;
}

}  // namespace urgengo::cli
