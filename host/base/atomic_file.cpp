// SPDX-License-Identifier: Apache-2.0
#include "host/base/atomic_file.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
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

// mkstemp creates files that only the owner can read; a result is an ordinary file.
mode_t ordinary_mode() {
    const mode_t mask = umask(0);
    umask(mask);
    return 0666 & ~mask;
}

}  // namespace

Result<bool> write_file_atomically(const std::string& path, std::string_view content) {
    std::string temporary = path + ".XXXXXX";
    const int fd = mkstemp(temporary.data());
    if (fd < 0) return failure("create a temporary file beside it", path);
    const bool written = write_all(fd, content) && fchmod(fd, ordinary_mode()) == 0;
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
