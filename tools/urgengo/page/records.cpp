// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/page/records.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstring>
#include <ctime>

#include "host/base/clock.h"
#include "host/base/file_descriptor.h"
#include "tools/trace/run_reader.h"

namespace urgengo::cli {
namespace {

constexpr std::size_t kMostRecordBytes = std::size_t{4} << 30;

/// @returns how many bytes were read
std::size_t read_whole(int fd, char* to, std::size_t size, std::uint64_t offset) {
    std::size_t done = 0;
    while (done < size) {
        const ssize_t got = pread(fd, to + done, size - done, static_cast<off_t>(offset + done));
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) break;
        done += static_cast<std::size_t>(got);
    }
    return done;
}

template <typename T>
void store(std::string& bytes, std::size_t offset, T value) {
    if (bytes.size() >= offset + sizeof value)
        std::memcpy(bytes.data() + offset, &value, sizeof value);
}

}  // namespace

Result<std::string> copy_records(const PageReading& page) {
    const std::string path = page.stem + observe::kRecordsSuffix;
    const FileDescriptor file(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
    if (file.get() < 0 && errno == ENOENT)
        return Error{fmt::format(
            "process {} ({}) has no flight recorder: URGENGO_FLIGHT_RECORDS is 0 there, there was "
            "no room for one, or it writes a trace instead (urgengo run --trace)",
            page.process.process, page.program)};
    struct stat status {};
    if (file.get() < 0 || fstat(file.get(), &status) != 0)
        return Error{path + ": " + std::strerror(errno)};
    if (!S_ISREG(status.st_mode) || status.st_uid != page.file.user ||
        static_cast<std::uint64_t>(status.st_size) > kMostRecordBytes)
        return Error{path + ": is not that process' flight recorder"};
    std::string bytes(static_cast<std::size_t>(status.st_size), '\0');
    bytes.resize(read_whole(file.get(), bytes.data(), bytes.size(), 0));
    trace::mark_overwritten(bytes, [&](std::uint64_t offset) {
        std::uint64_t written = 0;
        const std::size_t got =
            read_whole(file.get(), reinterpret_cast<char*>(&written), sizeof written, offset);
        return got == sizeof written ? written : ~std::uint64_t{0} - abi::kRunMargin;
    });
    timespec real{};
    clock_gettime(CLOCK_REALTIME, &real);
    store(bytes, offsetof(abi::RunHeader, copied_ns), std::int64_t{monotonic_now().count()});
    store(bytes, offsetof(abi::RunHeader, copied_realtime_ns),
          std::int64_t{real.tv_sec} * 1'000'000'000 + real.tv_nsec);
    return bytes;
}

}  // namespace urgengo::cli
