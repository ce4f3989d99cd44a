// SPDX-License-Identifier: Apache-2.0
//
// The ring is Vyukov's bounded queue (2010): a line's `sequence` is n while it is free for line
// number n, n + 1 once that is written. A thread that is stopped between the two delays the thread
// that writes the file, and no other.
#include "host/base/own_log.h"

#include <fcntl.h>
#include <linux/futex.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <cstdlib>
#include <cstring>
#include <new>
#include <system_error>

#include "host/base/file_descriptor.h"
#include "host/base/own_thread.h"

namespace urgengo {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
constexpr long kBetweenWrites_ns = 50'000'000, kLongestEnd_ns = 200'000'000;

/// Sleeps until the word is not `value`, or for so long.
void wait_while(std::atomic<std::uint32_t>& word, std::uint32_t value, long longest_ns) {
    const timespec longest{0, longest_ns};
    syscall(SYS_futex, &word, FUTEX_WAIT_PRIVATE, value, &longest, nullptr, 0);
}

void set(std::atomic<std::uint32_t>& word) {
    word.store(1, std::memory_order_release);
    syscall(SYS_futex, &word, FUTEX_WAKE_PRIVATE, INT_MAX, nullptr, nullptr, 0);
}

const char* to_word(LogDetail detail) {
    return detail == LogDetail::kDebug ? "debug" : "info";
}

std::string stamp(const timespec& time) {
    std::tm parts{};
    gmtime_r(&time.tv_sec, &parts);
    char text[32];
    const std::size_t length = std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &parts);
    return fmt::format("{}.{:06}Z", std::string_view(text, length), time.tv_nsec / 1000);
}

int open_regular(const char* path, int flags) {
    // O_NONBLOCK: a FIFO in the file's place has no reader, perhaps.
    const int fd = open(path, flags | O_WRONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0644);
    struct stat status {};
    if (fd < 0 || (fstat(fd, &status) == 0 && S_ISREG(status.st_mode))) return fd;
    close(fd);
    errno = EINVAL;
    return -1;
}

}  // namespace

struct OwnLog::Line {
    std::atomic<std::uint64_t> sequence;
    timespec time;
    std::int32_t thread;
    LogDetail detail;
    std::uint8_t length;
    char text[kMostText];
};

OwnLog& own_log() {
    constinit static OwnLog log;
    return log;
}

std::string OwnLog::start(LogDetail detail, const std::string& path) {
    static_assert(sizeof(Line) == 256 && kMostText <= UINT8_MAX);
    if (detail == LogDetail::kOff || ring_) return {};
    std::string absolute = path;  // the program may go to another folder
    if (char folder[PATH_MAX]; path[0] != '/' && getcwd(folder, sizeof folder))
        absolute = std::string(folder) + "/" + path;
    const FileDescriptor file(open_regular(absolute.c_str(), O_CREAT | O_TRUNC));
    if (file.get() < 0)
        return path + ": cannot be written: " + std::generic_category().message(errno);
    path_ = strdup(absolute.c_str());
    ring_ = new (std::nothrow) Line[kLines];
    if (!path_ || !ring_) return path + ": no memory";
    for (std::size_t i = 0; i < kLines; ++i) ring_[i].sequence.store(i, kRelaxed);
    if (!start_own_thread(run, this)) return path + ": no thread could be started";
    detail_.store(detail, std::memory_order_release);
    return {};
}

void OwnLog::note(LogDetail detail, std::string_view text) {
    if (detail_.load(std::memory_order_acquire) < detail) return;
    std::uint64_t number = tail_.load(kRelaxed);
    Line* line = nullptr;
    for (;;) {
        line = &ring_[number % kLines];
        const std::uint64_t sequence = line->sequence.load(std::memory_order_acquire);
        if (sequence < number) {
            dropped_.fetch_add(1, kRelaxed);
            return;
        }
        if (sequence > number)
            number = tail_.load(kRelaxed);
        else if (tail_.compare_exchange_weak(number, number + 1, kRelaxed))
            break;
    }
    clock_gettime(CLOCK_REALTIME, &line->time);
    line->thread = static_cast<std::int32_t>(syscall(SYS_gettid));
    line->detail = detail;
    line->length = static_cast<std::uint8_t>(std::min(text.size(), kMostText));
    std::memcpy(line->text, text.data(), line->length);
    line->sequence.store(number + 1, std::memory_order_release);
}

void OwnLog::finish() {
    if (!ring_ || !tells(LogDetail::kInfo)) return;
    const int saved_errno = errno;
    detail_.store(LogDetail::kOff, std::memory_order_release);
    set(ends_);
    if (has_ended_.load(std::memory_order_acquire) == 0) wait_while(has_ended_, 0, kLongestEnd_ns);
    errno = saved_errno;
}

void OwnLog::run(void* log) {
    auto& self = *static_cast<OwnLog*>(log);
    bool ends = false;
    while (!ends) {
        wait_while(self.ends_, 0, kBetweenWrites_ns);
        ends = self.ends_.load(std::memory_order_acquire) != 0;
        try {
            if (!self.write_lines()) break;
        } catch (...) {  // no memory: the next time, perhaps
        }
    }
    self.forked();
    set(self.has_ended_);
}

std::string OwnLog::take_lines() {
    std::string lines;
    for (;; ++head_) {
        Line& line = ring_[head_ % kLines];
        if (line.sequence.load(std::memory_order_acquire) != head_ + 1) break;
        std::string text(line.text, line.length);
        std::replace_if(
            text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < ' '; },
            '?');
        lines +=
            fmt::format("{} {} {} {}\n", stamp(line.time), to_word(line.detail), line.thread, text);
        line.sequence.store(head_ + kLines, std::memory_order_release);
    }
    if (const std::uint64_t dropped = dropped_.load(kRelaxed); dropped > told_dropped_) {
        lines += fmt::format("({} lines were dropped)\n", dropped - told_dropped_);
        told_dropped_ = dropped;
    }
    return lines;
}

/// @returns whether there is to be more
bool OwnLog::write_lines() {
    const std::string lines = take_lines();
    if (lines.empty()) return true;
    const FileDescriptor file(open_regular(path_, O_APPEND));
    for (std::string_view left = lines; file.get() >= 0 && !left.empty();) {
        const ssize_t written = write(file.get(), left.data(), left.size());
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) break;
        left.remove_prefix(static_cast<std::size_t>(written));
    }
    written_bytes_ += lines.size();
    return written_bytes_ < kMostBytes;
}

}  // namespace urgengo
