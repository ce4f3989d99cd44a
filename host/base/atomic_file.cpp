// SPDX-License-Identifier: Apache-2.0
#include "host/base/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>

namespace urgengo {
namespace {

Error failure(const char* step, const std::string& path) {
    return {path + ": cannot " + step + ": " + std::strerror(errno)};
}

bool write_all(int fd, std::string_view content) {
    while (!content.empty()) {
        const ssize_t n = write(fd, content.data(), content.size());
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return false;
        content.remove_prefix(static_cast<std::size_t>(n));
    }
    return true;
}

}  // namespace

Result<bool> write_file_atomically(const std::string& path, std::string_view content) {
    // Not mkstemp: a result is an ordinary file, as the process' umask wants it.
    const std::string temporary = path + "." + std::to_string(getpid());
    const int fd =
        open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0666);
    if (fd < 0) return failure("create a temporary file beside it", path);
    const bool written = write_all(fd, content);
    const Error error = failure("write", path);
    if (close(fd) == 0 && written) {
        if (rename(temporary.c_str(), path.c_str()) == 0) return true;
        const Error rename_error = failure("rename a temporary file to it", path);
        unlink(temporary.c_str());
        return rename_error;
    }
    unlink(temporary.c_str());
    return error;
}

}  // namespace urgengo
