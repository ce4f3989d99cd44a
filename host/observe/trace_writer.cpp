// SPDX-License-Identifier: Apache-2.0
#include "host/observe/trace_writer.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace urgengo::observe {

using abi::TraceHeader;
using abi::TraceKind;
using abi::TraceRecord;

namespace {

constexpr std::size_t kMaxTextBytes = 4096;

}  // namespace

TraceWriter::TraceWriter(int fd, void* memory, std::size_t bytes)
    : fd_(fd),
      header_(new (memory) TraceHeader{}),
      records_(reinterpret_cast<TraceRecord*>(header_ + 1)) {
    header_->magic = abi::kTraceMagic;
    header_->version = abi::kTraceVersion;
    header_->record_bytes = sizeof(TraceRecord);
    header_->chunk_records = abi::kTraceChunkRecords;
    header_->process = static_cast<std::uint32_t>(getpid());
    header_->begin_ns = monotonic_now().count();
    header_->max_chunks =
        (bytes - sizeof(TraceHeader)) / (sizeof(TraceRecord) * abi::kTraceChunkRecords);
}

Result<TraceWriter*> TraceWriter::create(const std::string& path, std::size_t max_bytes) {
    const auto fail = [&] { return Error{path + ": cannot be written: " + std::strerror(errno)}; };
    // A new file: one that another process still maps stays as it is.
    unlink(path.c_str());
    // A file size limit would end the program with SIGXFSZ.
    rlimit limit{};
    if (getrlimit(RLIMIT_FSIZE, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY)
        max_bytes = std::min<std::size_t>(max_bytes, limit.rlim_cur);
    if (max_bytes < sizeof(TraceHeader))
        return Error{path + ": cannot be written: file size limit"};
    const int fd = open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (fd < 0) return fail();
    void* memory = MAP_FAILED;
    if (ftruncate(fd, static_cast<off_t>(max_bytes)) == 0 &&
        posix_fallocate(fd, 0, sizeof(TraceHeader)) == 0)
        memory = mmap(nullptr, max_bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (memory == MAP_FAILED) {
        const Error error = fail();
        ::close(fd);
        unlink(path.c_str());
        return error;
    }
    madvise(memory, max_bytes, MADV_DONTFORK);
    return new TraceWriter(fd, memory, max_bytes);
}

// A page of a sparse file for which the disk has no room, or past its end, is a SIGBUS when it is
// written: so a chunk is real before a thread writes to it.
bool TraceWriter::allocate(std::uint64_t chunk) {
    constexpr std::size_t kBytes = sizeof(TraceRecord) * abi::kTraceChunkRecords;
    const auto offset = static_cast<off_t>(sizeof(TraceHeader) + chunk * kBytes);
    const int error = posix_fallocate(fd_, offset, static_cast<off_t>(kBytes));
    if (error == 0) return true;
    next_chunk_.store(header_->max_chunks);  // full
    return false;
}

TraceRecord* TraceWriter::add(TraceCursor& cursor, nanoseconds time) {
    if (cursor.next == cursor.end) [[unlikely]] {
        if (closed_.load(std::memory_order_relaxed)) return nullptr;
        if (cursor.thread == 0) cursor.thread = static_cast<std::uint32_t>(syscall(SYS_gettid));
        const std::uint64_t chunk = next_chunk_.fetch_add(1);
        if (chunk >= header_->max_chunks || !allocate(chunk)) return nullptr;
        __atomic_fetch_add(&header_->chunks, 1, __ATOMIC_RELAXED);
        cursor.next = records_ + chunk * abi::kTraceChunkRecords;
        cursor.end = cursor.next + abi::kTraceChunkRecords;
    }
    TraceRecord* record = cursor.next++;
    record->task = -1;
    record->thread = cursor.thread;
    record->time_ns = time.count();
    return record;
}

void TraceWriter::add_text(TraceCursor& cursor, std::uint64_t hash, std::string_view text) {
    text = text.substr(0, kMaxTextBytes);
    const nanoseconds now = monotonic_now();
    std::size_t offset = 0;
    do {
        TraceRecord* record = add(cursor, now);
        if (!record) return;
        const auto piece = text.substr(offset, sizeof record->text.bytes);
        record->text.hash = hash;
        record->text.offset = static_cast<std::uint16_t>(offset);
        record->text.length = static_cast<std::uint16_t>(text.size());
        std::memcpy(record->text.bytes, piece.data(), piece.size());
        publish(*record, TraceKind::kText);
        offset += piece.size();
    } while (offset < text.size());
}

void TraceWriter::close() {
    if (closed_.exchange(true)) return;
    // No thread gets a chunk after this.
    const std::uint64_t chunks =
        std::min(next_chunk_.exchange(header_->max_chunks), header_->max_chunks);
    // The mapping stays: a thread that still fills its chunk must not fault.
    const auto bytes = sizeof(TraceHeader) + chunks * sizeof(TraceRecord) * abi::kTraceChunkRecords;
    if (ftruncate(fd_, static_cast<off_t>(bytes)) != 0) return;  // a sparse file is as good
}

std::uint32_t thread_cpu_us() {
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return static_cast<std::uint32_t>(t.tv_sec * 1'000'000 + t.tv_nsec / 1000);
}

}  // namespace urgengo::observe
