// SPDX-License-Identifier: Apache-2.0
//
// No logging library: one would write through stdio or block, and bring locks and buffers of its
// own, for lines that are whole when they come here.
#include "host/base/log.h"

#include <poll.h>
#include <pthread.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <csignal>

#include "host/base/own_log.h"
#include "host/base/uncancelled.h"

namespace urgengo {
namespace {

constexpr std::string_view kPrefix = "urgengo: ";

/// Which file a descriptor is.
struct File {
    bool is_open;
    bool is_pipe;  ///< or a socket
    dev_t device;
    ino_t inode;
};

File file_of_stderr() {
    struct stat status;
    if (fstat(STDERR_FILENO, &status) != 0) return {};
    const bool is_pipe = S_ISFIFO(status.st_mode) || S_ISSOCK(status.st_mode);
    return {true, is_pipe, status.st_dev, status.st_ino};
}

const File& first_stderr() {
    static const File file = file_of_stderr();
    return file;
}

/// @returns whether stderr is what it was first, and takes PIPE_BUF bytes now
bool takes_a_line() {
    const File& first = first_stderr();
    const File now = file_of_stderr();
    if (!first.is_open || !now.is_open || now.device != first.device || now.inode != first.inode)
        return false;
    pollfd to{STDERR_FILENO, POLLOUT, 0};
    return poll(&to, 1, 0) == 1 && (to.revents & POLLOUT);
}

// Since it was asked, another process may have filled a pipe. (Files must not be asked not to
// wait: some then refuse what they would take at once.)
ssize_t write_at_once(const iovec* parts, int num_parts) {
    if (first_stderr().is_pipe) {
        const ssize_t written = pwritev2(STDERR_FILENO, parts, num_parts, -1, RWF_NOWAIT);
        if (written >= 0 || errno != EOPNOTSUPP) return written;
    }
    return writev(STDERR_FILENO, parts, num_parts);
}

iovec part(std::string_view text) {
    return {const_cast<char*>(text.data()), text.size()};
}

/// One write, so that a line stays whole among those of other threads and processes. What it raises
/// (the pipe has no reader; the file is as large as it may be; a background job may not write) is
/// blocked, and taken back if it came.
void write_line(std::string_view prefix, std::string_view line) {
    line = line.substr(0, PIPE_BUF - prefix.size() - 1);
    const iovec parts[] = {part(prefix), part(line), part("\n")};

    sigset_t raised, pending, mask;
    sigpending(&pending);
    sigemptyset(&raised);
    for (const int signal : {SIGPIPE, SIGXFSZ, SIGTTOU})
        if (!sigismember(&pending, signal)) sigaddset(&raised, signal);  // else it is the program's
    pthread_sigmask(SIG_BLOCK, &raised, &mask);
    if (takes_a_line() && write_at_once(parts, std::size(parts)) < 0 &&
        (errno == EPIPE || errno == EFBIG)) {
        const timespec at_once{};
        sigtimedwait(&raised, nullptr, &at_once);
    }
    pthread_sigmask(SIG_SETMASK, &mask, nullptr);
}

/// @param say  is left alone by a cancellation of the thread: most of what it calls are points of
/// it
template <typename Say>
void undisturbed(Say&& say) {
    const int saved_errno = errno;
    {
        const Uncancelled uncancelled;
        say();
    }
    errno = saved_errno;
}

}  // namespace

void remember_stderr() {
    const int saved_errno = errno;
    first_stderr();
    errno = saved_errno;
}

void log_line(std::string_view message) {
    own_log().note(LogDetail::kInfo, message);
    undisturbed([&] { write_line(kPrefix, message); });
}

void log_text(std::string_view lines) {
    undisturbed([&] {
        while (!lines.empty()) {
            const std::size_t length = std::min(lines.find('\n'), lines.size());
            write_line({}, lines.substr(0, length));
            lines.remove_prefix(std::min(length + 1, lines.size()));
        }
    });
}

}  // namespace urgengo
