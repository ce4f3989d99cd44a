// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/page/control.h"

#include <fcntl.h>
#include <linux/futex.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <cstring>
#include <thread>

#include "host/base/clock.h"
#include "host/base/file_descriptor.h"

namespace urgengo::cli {
namespace {

constexpr off_t kWordAt = offsetof(abi::ControlPage, word);
/// What there is of it in every version.
constexpr ssize_t kLeastPage = offsetof(abi::ControlPage, requests);
/// A process that writes the word holds the lock for microseconds.
constexpr std::chrono::milliseconds kLongestLock{50};

// The word is written by pwrite(): a file that is cut short is an error then, not a signal. The
// mapping is only the futex' address.
bool wake(int fd) {
    const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
    void* const memory = mmap(nullptr, page, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (memory == MAP_FAILED) return false;
    const long woken = syscall(SYS_futex, static_cast<char*>(memory) + kWordAt, FUTEX_WAKE, INT_MAX,
                               nullptr, nullptr, 0);
    munmap(memory, page);
    return woken >= 0;
}

// Of two processes that write at a time, each gets a number of its own by the lock. A user who may
// open the file may hold it for ever: that keeps no word from being written.
void lock(int fd) {
    const nanoseconds end = monotonic_now() + kLongestLock;
    while (flock(fd, LOCK_EX | LOCK_NB) != 0 && (errno == EWOULDBLOCK || errno == EINTR) &&
           monotonic_now() < end)
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

bool is_past(std::uint32_t seen, std::uint32_t word) {
    const std::uint32_t ahead = (seen >> 8) - (word >> 8);
    return seen != 0 && (ahead & 0xffffff) < 0x800000;
}

}  // namespace

Result<std::uint32_t> send_command(const std::string& stem, abi::ControlCommand command,
                                   std::uint32_t chain, const std::string& config_path) {
    if (config_path.size() >= abi::kControlPathBytes)
        return Error{config_path + ": is too long a path"};
    const std::string path = stem + observe::kControlSuffix;
    const auto fail = [&] { return Error{path + ": " + std::strerror(errno)}; };
    const FileDescriptor file(open(path.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
    if (file.get() < 0) return fail();
    struct stat status {};
    if (fstat(file.get(), &status) != 0) return fail();
    struct stat page_status {};
    if (lstat((stem + observe::kPageSuffix).c_str(), &page_status) != 0) return fail();
    if (status.st_uid != page_status.st_uid)
        return Error{path + ": belongs to another user than the page"};
    abi::ControlPage page{};
    if (!S_ISREG(status.st_mode) ||
        pread(file.get(), static_cast<void*>(&page), kLeastPage, 0) != kLeastPage ||
        page.magic != abi::kControlMagic)
        return Error{path + ": is no control file of UrgenGo"};
    lock(file.get());
    if (!config_path.empty()) {
        const auto bytes = static_cast<ssize_t>(config_path.size() + 1);
        if (pwrite(file.get(), config_path.c_str(), config_path.size() + 1,
                   offsetof(abi::ControlPage, path)) != bytes)
            return fail();
    }
    std::uint32_t word = 0;
    if (pread(file.get(), &word, sizeof word, kWordAt) != sizeof word) return fail();
    word = abi::next_control_word(word, command);
    const std::uint32_t request[] = {word, chain};
    static_assert(sizeof request == sizeof(abi::ControlRequest));
    const std::size_t request_at = offsetof(abi::ControlPage, requests) +
                                   abi::number_of(word) % abi::kControlRing * sizeof request;
    if (pwrite(file.get(), request, sizeof request, static_cast<off_t>(request_at)) !=
        sizeof request)
        return fail();
    if (pwrite(file.get(), &word, sizeof word, kWordAt) != sizeof word || !wake(file.get()))
        return fail();
    return word;
}

Answer wait_for_answer(const std::string& stem, std::uint32_t word,
                       std::chrono::milliseconds longest) {
    const nanoseconds end = monotonic_now() + longest;
    for (;;) {
        const nanoseconds now = monotonic_now();
        const auto page = read_page(stem, now);
        if (!page) return Answer::kGone;
        if (is_past(page->control_seen, word)) return Answer::kDone;
        if (page->liveness == observe::Liveness::kGone || page->is_over) return Answer::kGone;
        if (page->liveness == observe::Liveness::kStopped) return Answer::kStopped;
        if (now >= end) return page->is_controlled ? Answer::kLate : Answer::kDeaf;
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
}

std::string told(const PageReading& page, std::uint32_t word) {
    return page.text_word == word ? page.text : std::string();
}

std::string refusal(const PageReading& page, std::uint32_t word) {
    const PageReading::Answer& answer = page.answers[abi::number_of(word) % abi::kControlRing];
    if (answer.word != word) return {};
    switch (answer.result) {
        case abi::ControlResult::kNone:
        case abi::ControlResult::kDone:
            return {};
        case abi::ControlResult::kMeansNothing:
            return "refused: it does not know this command";
        case abi::ControlResult::kNoChain:
            return "refused: it has no such chain";
        case abi::ControlResult::kRefused:
            return "refused: " + told(page, word);
        case abi::ControlResult::kOffForGood:
            return "UrgenGo has switched itself off there, for good";
    }
    return "refused";
}

}  // namespace urgengo::cli
