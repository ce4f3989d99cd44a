// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/trace_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <system_error>

#include "host/config/config.h"

namespace urgengo::trace {
namespace {

constexpr std::size_t kMaxTextBytes = 4096;
constexpr std::size_t kChunkBytes = sizeof(TraceRecord) * abi::kTraceChunkRecords;

std::string from_chars(const char* chars, std::size_t size) {
    return std::string(chars, strnlen(chars, size));
}

/// @returns what is wrong with the header; empty if nothing is
std::string check(const abi::TraceHeader& header) {
    if (header.magic != abi::kTraceMagic) {
        return fmt::format("found magic {:016x}, accepted: a trace ({:016x})", header.magic,
                           abi::kTraceMagic);
    }
    if (header.version != abi::kTraceVersion) {
        return fmt::format("found trace version {}, accepted: {}", header.version,
                           abi::kTraceVersion);
    }
    if (header.record_bytes != sizeof(TraceRecord)) {
        return fmt::format("found records of {} bytes, accepted: {}", header.record_bytes,
                           sizeof(TraceRecord));
    }
    if (header.chunk_records != abi::kTraceChunkRecords) {
        return fmt::format("found chunks of {} records, accepted: {}", header.chunk_records,
                           abi::kTraceChunkRecords);
    }
    return {};
}

/// A text of which some parts may never have been written.
struct PartialText {
    std::string bytes;
    std::size_t received = 0;
};

}  // namespace

/// Takes a trace apart: header, records, texts, threads.
class TraceParser {
  public:
    explicit TraceParser(std::string file) : file_(std::move(file)) {}

    /// @returns how many bytes of the file are worth reading, header included
    Result<std::size_t> parse_header(std::string_view bytes, std::size_t file_bytes) {
        if (bytes.size() < sizeof(abi::TraceHeader)) {
            return Error{fmt::format("{}: found {} bytes, accepted: a trace (at least {})", file_,
                                     bytes.size(), sizeof(abi::TraceHeader))};
        }
        abi::TraceHeader& header = trace_.header_;
        std::memcpy(&header, bytes.data(), sizeof header);
        const std::string wrong = check(header);
        if (!wrong.empty()) return Error{file_ + ": " + wrong};

        const std::uint64_t used = std::min(header.chunks, header.max_chunks);
        const std::uint64_t in_file = (file_bytes - sizeof header) / kChunkBytes;
        if (header.chunks > header.max_chunks) {
            warn("{} of {} chunks of events did not fit and were lost",
                 header.chunks - header.max_chunks, header.chunks);
        }
        if (in_file < used) {
            warn("found {} chunks of events, accepted: {}, as its header says; the rest is missing",
                 in_file, used);
        }
        return std::min(file_bytes, sizeof header + static_cast<std::size_t>(used) * kChunkBytes);
    }

    /// @param bytes  what follows the header
    Trace parse_records(std::string_view bytes) {
        trace_.records_.resize(bytes.size() / sizeof(TraceRecord));
        if (!trace_.records_.empty()) {
            std::memcpy(trace_.records_.data(), bytes.data(),
                        trace_.records_.size() * sizeof(TraceRecord));
        }
        for (const TraceRecord& record : trace_.records_) take(record);
        finish();
        return std::move(trace_);
    }

  private:
    template <typename... Args>
    void warn(fmt::format_string<Args...> format, Args&&... args) {
        trace_.warnings_.push_back(file_ + ": " + fmt::format(format, std::forward<Args>(args)...));
    }

    void take(const TraceRecord& record) {
        switch (record.kind) {
            case TraceKind::kNone:
                return;
            case TraceKind::kText:
                return take_text(record.text);
            case TraceKind::kThread:
                thread(record.thread)
                    .names.push_back({record.time_ns, from_chars(record.name, sizeof record.name)});
                return;
            case TraceKind::kKernelTime:
                return trace_.kernel_times_.push_back(&record);
            case TraceKind::kClockPair:
                return trace_.clock_pairs_.push_back(&record);
            default:
                break;
        }
        if (record.kind > TraceKind::kInstanceEnd) {
            ++num_unknown_;
            return;
        }
        ThreadTrace& its = thread(record.thread);
        // The name is read during the launch that it is first true for, which came in before.
        if (its.names.size() > named_[record.thread]) {
            named_[record.thread] = its.names.size();
            ThreadName& name = its.names.back();
            name.since_ns = std::min(name.since_ns, record.time_ns);
        }
        its.events.push_back(&record);
    }

    void take_text(const abi::TraceText& text) {
        PartialText& partial = texts_[text.hash];
        const std::size_t length = std::min<std::size_t>(text.length, kMaxTextBytes);
        if (partial.bytes.size() < length) partial.bytes.resize(length, '?');
        if (text.offset >= length) return;
        const std::size_t count = std::min(sizeof text.bytes, length - text.offset);
        std::memcpy(partial.bytes.data() + text.offset, text.bytes, count);
        partial.received += count;
    }

    ThreadTrace& thread(std::uint32_t id) {
        const auto [it, is_new] = index_.try_emplace(id, trace_.threads_.size());
        if (is_new) trace_.threads_.push_back({id, {}, {}});
        return trace_.threads_[it->second];
    }

    void finish() {
        std::size_t num_partial = 0;
        for (auto& [hash, partial] : texts_) {
            if (partial.received < partial.bytes.size()) ++num_partial;
            trace_.texts_.emplace(hash, std::move(partial.bytes));
        }
        const auto earlier = [](const auto* a, const auto* b) { return a->time_ns < b->time_ns; };
        for (ThreadTrace& thread : trace_.threads_) {
            if (!std::is_sorted(thread.events.begin(), thread.events.end(), earlier)) {
                std::stable_sort(thread.events.begin(), thread.events.end(), earlier);
            }
        }
        if (num_partial > 0) warn("{} names are incomplete", num_partial);
        if (num_unknown_ > 0) warn("{} events of a kind that is not known", num_unknown_);
    }

    std::string file_;
    Trace trace_;
    std::unordered_map<std::uint32_t, std::size_t> index_;
    std::unordered_map<std::uint32_t, std::size_t> named_;  // names that an event has followed
    std::unordered_map<std::uint64_t, PartialText> texts_;
    std::size_t num_unknown_ = 0;
};

std::string_view ThreadTrace::name_at(std::int64_t time_ns) const {
    if (names.empty()) return {};
    const auto after = std::upper_bound(
        names.begin(), names.end(), time_ns,
        [](std::int64_t time, const ThreadName& name) { return time < name.since_ns; });
    return after == names.begin() ? names.front().name : std::prev(after)->name;
}

std::string_view Trace::text(std::uint64_t hash) const {
    const auto it = texts_.find(hash);
    return it == texts_.end() ? std::string_view{} : std::string_view{it->second};
}

std::string Trace::gpu() const {
    return from_chars(header_.gpu, sizeof header_.gpu);
}

std::string Trace::driver() const {
    const std::uint32_t version = header_.driver_version;
    return version == 0 ? "" : fmt::format("{}.{}", version / 1000, version % 1000 / 10);
}

Result<Trace> parse_trace(std::string_view bytes, const std::string& file) {
    TraceParser parser(file);
    const auto worth = parser.parse_header(bytes, bytes.size());
    if (!worth) return Error{worth.error()};
    return parser.parse_records(
        bytes.substr(sizeof(abi::TraceHeader), *worth - sizeof(abi::TraceHeader)));
}

Result<Trace> read_trace(const std::string& path) {
    std::ifstream stream(path, std::ios::binary | std::ios::ate);
    const auto end = stream ? stream.tellg() : std::ifstream::pos_type(-1);
    if (end < 0) {
        return Error{
            path + ": cannot be read: " + std::generic_category().message(errno ? errno : EISDIR)};
    }
    const auto file_bytes = static_cast<std::size_t>(end);
    // The file has room for more events than there are; only what was used is read.
    const auto read_from = [&stream](std::size_t offset, std::size_t count) {
        std::string bytes(count, '\0');
        stream.clear();
        stream.seekg(static_cast<std::streamoff>(offset));
        stream.read(bytes.data(), static_cast<std::streamsize>(count));
        bytes.resize(static_cast<std::size_t>(std::max<std::streamsize>(stream.gcount(), 0)));
        return bytes;
    };
    TraceParser parser(path);
    const auto worth = parser.parse_header(
        read_from(0, std::min(file_bytes, sizeof(abi::TraceHeader))), file_bytes);
    if (!worth) return Error{worth.error()};
    return parser.parse_records(
        read_from(sizeof(abi::TraceHeader), *worth - sizeof(abi::TraceHeader)));
}

std::string launch_name(const Trace& trace, const TraceRecord& record) {
    const std::uint64_t hash = record.launch.name_hash;
    const std::string_view text = trace.text(hash);
    if (text.empty() && (record.flags & abi::kTraceGraph)) return config::kGraphName;
    return text.empty() ? fmt::format("(kernel {:016x})", hash) : std::string(text);
}

}  // namespace urgengo::trace
