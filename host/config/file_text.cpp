// SPDX-License-Identifier: Apache-2.0
#include "host/config/file_text.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

#include "host/base/file_descriptor.h"

namespace urgengo::config {
namespace {

constexpr off_t kMaxFileBytes = 64 << 20;

Error cannot_read(const std::string& path, const std::string& why) {
    return Error{path + ": cannot be read: " + why};
}

std::string errno_text() {
    return std::generic_category().message(errno);
}

Result<std::string> read(const std::string& path, int flags, bool must_be_own) {
    // O_NONBLOCK: a FIFO in the file's place must not stop the program that loads us.
    const FileDescriptor file(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | flags));
    struct stat info {};
    if (file.get() < 0 || fstat(file.get(), &info) != 0) return cannot_read(path, errno_text());
    if (!S_ISREG(info.st_mode)) return cannot_read(path, "not a regular file");
    if (must_be_own && info.st_uid != geteuid()) return cannot_read(path, "another user's file");
    if (info.st_size > kMaxFileBytes) return cannot_read(path, "larger than 64 MiB");

    std::string text;
    char buffer[16384];
    for (;;) {
        const ssize_t count = ::read(file.get(), buffer, sizeof buffer);
        if (count == 0) return text;
        if (count < 0 && errno == EINTR) continue;
        if (count < 0) return cannot_read(path, errno_text());
        text.append(buffer, static_cast<std::size_t>(count));
    }
}

}  // namespace

Result<std::string> read_file(const std::string& path) {
    return read(path, 0, false);
}

Result<std::string> read_own_file(const std::string& path) {
    return read(path, O_NOFOLLOW, true);
}

}  // namespace urgengo::config
