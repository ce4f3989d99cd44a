// SPDX-License-Identifier: Apache-2.0
#include "host/observe/shared_file.h"

#include <fcntl.h>
#include <grp.h>
#include <linux/magic.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstring>

namespace urgengo::observe {
namespace {

constexpr int kTries = 16;

/// @returns an errno; 0: the bytes are the file's, and have their memory
int give_memory(int fd, std::size_t offset, std::size_t bytes) {
    // Beyond it the program would be ended by SIGXFSZ.
    rlimit limit{};
    if (getrlimit(RLIMIT_FSIZE, &limit) == 0 && limit.rlim_cur < offset + bytes) return EFBIG;
    // A signal that waits for the thread ends it, as often as one comes.
    int error = EINTR;
    for (int tries = 0; tries < kTries && error == EINTR; ++tries)
        error = posix_fallocate(fd, static_cast<off_t>(offset), static_cast<off_t>(bytes));
    return error;
}

/// A file that is not there yet, open, of that size and with all of its memory.
/// @returns -1: errno says why not
int make_file(const std::string& path, std::size_t bytes, mode_t mode,
              std::optional<unsigned> group) {
    struct stat there {};
    if (lstat(path.c_str(), &there) == 0 && !S_ISREG(there.st_mode)) {
        errno = EEXIST;  // a device, say
        return -1;
    }
    unlink(path.c_str());  // of a process with our number that ended while it made its own
    const int fd = open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (fd < 0) return -1;
    const int error = give_memory(fd, 0, bytes);
    if (error == 0 &&
        (!group || (fchown(fd, static_cast<uid_t>(-1), *group) == 0 && fchmod(fd, mode) == 0)))
        return fd;
    if (error != 0) errno = error;
    const int why = errno;
    unlink(path.c_str());
    close(fd);
    errno = why;
    return -1;
}

}  // namespace

bool leaves_enough(const std::string& path, std::size_t bytes) {
    struct statvfs system {};
    if (statvfs(path.c_str(), &system) != 0) return false;
    if (system.f_blocks == 0) return true;
    return leaves_enough(std::uint64_t{system.f_blocks} * system.f_frsize,
                         std::uint64_t{system.f_bavail} * system.f_frsize, bytes);
}

std::string why_not_in_memory(const std::string& folder) {
    struct statfs system {};
    if (statfs(folder.c_str(), &system) != 0) return std::strerror(errno);
    if (system.f_type == TMPFS_MAGIC || system.f_type == RAMFS_MAGIC) return {};
    return "is on a disk, accepted: in memory (tmpfs)";
}

void copy_name(char* to, std::size_t size, const std::string& name) {
    constexpr std::size_t kLongestTail = 3;
    std::size_t length = std::min(name.size(), size - 1);
    for (std::size_t i = 0; i < kLongestTail && length < name.size(); ++i, --length)
        if ((static_cast<unsigned char>(name[length]) & 0xc0) != 0x80) break;
    std::memcpy(to, name.data(), length);
    std::memset(to + length, 0, size - length);
}

std::string program_name() {
    char path[4096];
    const ssize_t length = readlink("/proc/self/exe", path, sizeof path);
    const std::string name(path, length > 0 ? static_cast<std::size_t>(length) : 0);
    return name.substr(name.rfind('/') + 1);
}

std::optional<unsigned> find_group(const std::string& group) {
    unsigned number = 0;
    const char* const end = group.data() + group.size();
    if (const auto [last, error] = std::from_chars(group.data(), end, number);
        error == std::errc{} && last == end)
        return number;
    FILE* const file = std::fopen("/etc/group", "re");
    if (!file) return std::nullopt;
    std::optional<unsigned> found;
    ::group entry{}, *read = nullptr;
    char buffer[16384];
    while (!found && fgetgrent_r(file, &entry, buffer, sizeof buffer, &read) == 0)
        if (group == entry.gr_name) found = entry.gr_gid;
    std::fclose(file);
    return found;
}

int open_again(const std::string& path, const MappedFile& file, int access) {
    const int fd = open(path.c_str(), access | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    struct stat status {};
    if (fd < 0 ||
        (fstat(fd, &status) == 0 && status.st_dev == file.device && status.st_ino == file.inode))
        return fd;
    close(fd);
    return -1;
}

MappedFile map_file(const std::string& path, std::size_t bytes, mode_t mode,
                    std::optional<unsigned> group) {
    MappedFile file;
    const int fd = make_file(path, bytes, mode, group);
    if (fd < 0) return file;
    struct stat status {};
    if (fstat(fd, &status) == 0) file.device = status.st_dev, file.inode = status.st_ino;
    void* const memory = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    close(fd);
    if (memory != MAP_FAILED)
        file.memory = memory;
    else
        unlink(path.c_str());
    return file;
}

void* map_more(const std::string& path, const MappedFile& file, std::size_t offset,
               std::size_t bytes) {
    const int fd = open_again(path, file, O_RDWR);
    if (fd < 0) return nullptr;
    void* memory = MAP_FAILED;
    if (give_memory(fd, offset, bytes) == 0)
        memory = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd,
                      static_cast<off_t>(offset));
    close(fd);
    return memory == MAP_FAILED ? nullptr : memory;
}

}  // namespace urgengo::observe
