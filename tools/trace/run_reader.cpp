// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/run_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <optional>
#include <system_error>

#include "tools/trace/clean_text.h"

namespace urgengo::trace {
namespace {

constexpr std::streamoff kLargestFile = std::streamoff{4} << 30;

/// A hundred years of CLOCK_MONOTONIC: a time beyond it is none. Two of them fit into 64 bits.
constexpr std::int64_t kLatest_ns = std::int64_t{100} * 366 * 24 * 3600 * 1'000'000'000;
/// Of the GPU's clock, as records have it.
constexpr std::uint64_t kStampMask = (std::uint64_t{1} << 48) - 1;
constexpr std::uint32_t kMostRingRecords = 1u << 26;
/// That a thread can have written: a record a microsecond, for nine years.
constexpr std::uint64_t kMostWritten = std::uint64_t{1} << 48;
/// Of a file at once; and what part of the time reading it takes, roughly.
constexpr std::size_t kAtOnce = 16u << 20;
constexpr double kPartOfReading = 0.3;
/// Of the fields that version 1 has; later ones may be longer.
constexpr std::uint32_t kLeastHeader = sizeof(abi::RunHeader);

template <std::size_t N>
std::string text_of(const char (&chars)[N]) {
    return clean_text({chars, strnlen(chars, N)});
}

/// @returns the duration, or the longest that can be true
std::int64_t tame(std::int64_t ns) {
    return std::clamp(ns, -kLatest_ns, kLatest_ns);
}

/// @returns whether `count` elements of those bytes lie in the file from there on
bool lies_in(std::uint64_t offset, std::uint64_t element, std::uint64_t count,
             std::uint64_t bytes) {
    return offset <= bytes && (count == 0 || (bytes - offset) / count >= element);
}

template <typename T>
T read_at(std::span<const char> bytes, std::uint64_t offset) {
    T value;
    std::memcpy(&value, bytes.data() + offset, sizeof value);
    return value;
}

/// @returns what is wrong with the header; empty if nothing is
std::string check(const abi::RunHeader& h, std::uint64_t bytes) {
    if (h.magic == 0) return "found a file that was not begun, accepted: a run's records";
    if (h.magic != abi::kRunMagic)
        return fmt::format("found magic {:016x}, accepted: a run's records ({:016x})", h.magic,
                           abi::kRunMagic);
    if (h.version == 0) return "found version 0, accepted: 1 and later";
    if (h.header_bytes < kLeastHeader)
        return fmt::format("found a header of {} bytes, accepted: {} and more", h.header_bytes,
                           kLeastHeader);
    if (h.record_bytes < sizeof(RunRecord) || h.record_bytes % 8 != 0 || h.record_bytes > 4096)
        return fmt::format("found records of {} bytes, accepted: {} to 4096", h.record_bytes,
                           sizeof(RunRecord));
    if (h.ring_records == 0 || h.ring_records > kMostRingRecords)
        return fmt::format("found rings of {} records, accepted: 1 to {}", h.ring_records,
                           kMostRingRecords);
    const auto section = [&](const char* name, const abi::StatusSection& s, std::size_t least,
                             std::uint32_t most) -> std::string {
        if (s.element_bytes < least || s.count > most ||
            !lies_in(s.offset, s.element_bytes, s.count, bytes))
            return fmt::format("found {} {} of {} bytes at {}, accepted: inside the file's {}",
                               s.count, name, s.element_bytes, s.offset, bytes);
        return {};
    };
    if (auto wrong = section("chains", h.chains, sizeof(abi::RunChain), 0x7fff); !wrong.empty())
        return wrong;
    if (auto wrong = section("tasks", h.tasks, sizeof(abi::RunTask), 0x7fff); !wrong.empty())
        return wrong;
    const std::uint64_t ring =
        sizeof(abi::RunRing) + std::uint64_t{h.ring_records} * h.record_bytes;
    if (h.rings.element_bytes < ring)
        return fmt::format("found rings of {} bytes, accepted: {} and more", h.rings.element_bytes,
                           ring);
    return {};
}

bool is_of_chain(RunKind kind) {
    return kind <= RunKind::kMark || kind == RunKind::kChainMode || kind == RunKind::kGuard;
}

class RunParser {
  public:
    RunParser(std::span<const char> bytes, const std::string& file, const ShowPart& show)
        : bytes_(bytes), file_(file), show_(show) {}

    Result<Run> parse() {
        if (bytes_.size() < sizeof(abi::RunHeader))
            return Error{fmt::format("{}: found {} bytes, accepted: a run's records (at least {})",
                                     file_, bytes_.size(), sizeof(abi::RunHeader))};
        header_ = read_at<abi::RunHeader>(bytes_, 0);
        const std::string wrong = check(header_, bytes_.size());
        if (!wrong.empty()) return Error{file_ + ": " + wrong};
        run_.process = header_.process;
        run_.program = text_of(header_.program);
        run_.gpu = text_of(header_.gpu);
        run_.keeps = header_.keeps;
        run_.begin_ns = std::clamp<std::int64_t>(header_.begin_ns, 0, kLatest_ns);
        run_.begin_realtime_ns = header_.begin_realtime_ns;
        run_.copied_ns = header_.copied_ns;
        run_.lost = header_.lost;
        read_names();
        read_conditions();
        read_rings();
        finish();
        return std::move(run_);
    }

  private:
    template <typename... Args>
    void warn(fmt::format_string<Args...> format, Args&&... args) {
        run_.warnings.push_back(file_ + ": " + fmt::format(format, std::forward<Args>(args)...));
    }

    void read_names() {
        for (std::uint32_t i = 0; i < header_.chains.count; ++i) {
            const auto chain = read_at<abi::RunChain>(
                bytes_, header_.chains.offset + std::uint64_t{i} * header_.chains.element_bytes);
            run_.chains.push_back(
                {text_of(chain.name), tame(chain.period_ns), tame(chain.deadline_ns)});
        }
        for (std::uint32_t i = 0; i < header_.tasks.count; ++i) {
            const auto task = read_at<abi::RunTask>(
                bytes_, header_.tasks.offset + std::uint64_t{i} * header_.tasks.element_bytes);
            run_.tasks.push_back({text_of(task.name), task.chain});
            if (task.chain >= header_.chains.count) run_.tasks.back().chain = 0, ++num_wrong_;
        }
    }

    void read_conditions() {
        const abi::StatusSection& text = header_.conditions;
        if (text.element_bytes != 1 || !lies_in(text.offset, 1, text.count, bytes_.size())) {
            if (text.count > 0) ++num_wrong_;
            return;
        }
        run_.conditions.assign(bytes_.data() + text.offset, text.count);
    }

    void read_rings() {
        const abi::StatusSection& rings = header_.rings;
        const std::uint32_t used = std::min(header_.rings_used, rings.count);
        std::uint32_t num_cut = 0;
        for (std::uint32_t i = 0; i < used; ++i) {
            if (show_) show_(static_cast<double>(i) / used);
            const std::uint64_t offset = rings.offset + std::uint64_t{i} * rings.element_bytes;
            if (!lies_in(offset, sizeof(abi::RunRing), 1, bytes_.size())) {
                num_cut += used - i;
                break;
            }
            num_cut += !read_ring(offset);
        }
        if (num_cut > 0) warn("{} of {} rings of records are not whole", num_cut, used);
    }

    /// @returns whether all of it is in the file
    bool read_ring(std::uint64_t offset) {
        const auto ring = read_at<abi::RunRing>(bytes_, offset);
        const std::uint64_t size = header_.ring_records;
        const std::uint64_t first_at = offset + sizeof ring;
        const std::uint64_t in_file = (bytes_.size() - first_at) / header_.record_bytes;
        if (ring.thread != 0) run_.threads[ring.thread] = text_of(ring.thread_name);
        if (ring.written == 0) return true;
        if (ring.written > kMostWritten) {
            ++num_wrong_;
            return true;
        }
        // Of a full ring the oldest may have been half overwritten when the program was killed.
        std::uint64_t first = ring.written < size ? 0 : ring.written + 1 - size;
        if (header_.keeps == abi::RunKeeps::kOldest) first = 0;
        first = std::clamp(ring.first, first, ring.written);
        std::uint64_t last = ring.written;
        if (header_.keeps == abi::RunKeeps::kOldest && last > size) last = size, ++num_wrong_;
        if (last - std::min(first, last) > size) first = last - size;
        if (header_.keeps == abi::RunKeeps::kNewest) run_.overwritten += first;
        bool is_whole = true;
        for (std::uint64_t n = first; n < last; ++n) {
            const std::uint64_t at = n % size;
            if (at >= in_file) {  // nor are those behind it, up to the ring's end
                is_whole = false;
                n += size - at - 1;
                continue;
            }
            take(read_at<RunRecord>(bytes_, first_at + at * header_.record_bytes));
        }
        return is_whole;
    }

    void take(RunRecord record) {
        if (record.kind == RunKind::kNone) return;
        if (record.kind > RunKind::kRound) {
            ++num_unknown_;
            return;
        }
        const auto is_time = [](std::int64_t ns) { return ns >= 0 && ns < kLatest_ns; };
        const auto chains = static_cast<int>(run_.chains.size());
        const auto tasks = static_cast<int>(run_.tasks.size());
        const bool needs_task = record.kind >= RunKind::kTaskBegin && record.kind <= RunKind::kMark;
        const bool needs_chain = is_of_chain(record.kind);
        if (!is_time(record.time_ns) || !is_time(record.begin_ns) || !is_time(record.arrival_ns) ||
            record.chain >= chains || record.task >= tasks || (needs_chain && record.chain < 0) ||
            (needs_task && record.task < 0)) {
            ++num_wrong_;
            return;
        }
        if (record.behind_chain < -1 || record.behind_chain >= chains) record.behind_chain = -1;
        if (record.behind_task < -1 || record.behind_task >= tasks) record.behind_task = -1;
        if (record.why > abi::Why::kExclusive) record.why = abi::Why::kNone;
        if (record.cause > abi::MissCause::kOutside) record.cause = abi::MissCause::kUnknown;
        record.begin_ns = std::min(record.begin_ns, record.time_ns);
        if (record.kind == RunKind::kFrameEnd)
            record.frame = {tame(record.frame.latency_ns), tame(record.frame.amount_ns)};
        if (record.kind == RunKind::kClock)
            record.clock = {record.clock.gpu_ns & kStampMask, tame(record.clock.host_ns)};
        if (record.kind == RunKind::kPark)
            record.park.opening_ns = std::clamp<std::int64_t>(record.park.opening_ns, 0,
                                                              record.time_ns - record.begin_ns);
        if (record.kind == RunKind::kRound)
            record.round.took_ns = std::clamp<std::int64_t>(record.round.took_ns, 0, kLatest_ns);
        run_.records.push_back(record);
    }

    void finish() {
        std::stable_sort(
            run_.records.begin(), run_.records.end(),
            [](const RunRecord& a, const RunRecord& b) { return a.time_ns < b.time_ns; });
        if (run_.lost > 0) warn("{} records found no room and were lost", run_.lost);
        if (num_unknown_ > 0) warn("{} records of a kind that is not known", num_unknown_);
        if (num_wrong_ > 0) warn("{} records or names make no sense", num_wrong_);
    }

    const std::span<const char> bytes_;
    const std::string& file_;
    const ShowPart& show_;
    abi::RunHeader header_;
    Run run_;
    std::uint64_t num_unknown_ = 0, num_wrong_ = 0;
};

}  // namespace

Result<Run> parse_run(std::span<const char> bytes, const std::string& file) {
    return RunParser(bytes, file, nullptr).parse();
}

Result<Run> read_run(const std::string& path, const ShowPart& show) {
    std::error_code unknown;
    if (std::filesystem::exists(path, unknown) && !std::filesystem::is_regular_file(path, unknown))
        return Error{path + ": is no file, accepted: records of a run"};
    std::ifstream stream(path, std::ios::binary | std::ios::ate);
    const auto end = stream ? stream.tellg() : std::ifstream::pos_type(-1);
    if (end < 0)
        return Error{
            path + ": cannot be read: " + std::generic_category().message(errno ? errno : EISDIR)};
    if (end > kLargestFile)
        return Error{path + ": is larger than 4 GiB, accepted: records of a run"};
    std::string bytes(static_cast<std::size_t>(end), '\0');
    stream.seekg(0);
    std::size_t read = 0;
    while (stream && read < bytes.size()) {
        stream.read(bytes.data() + read,
                    static_cast<std::streamsize>(std::min(kAtOnce, bytes.size() - read)));
        read += static_cast<std::size_t>(std::max<std::streamsize>(stream.gcount(), 0));
        if (show) show(kPartOfReading * static_cast<double>(read) / static_cast<double>(end));
    }
    bytes.resize(read);
    const ShowPart show_parsed = [&](double part) {
        if (show) show(kPartOfReading + (1 - kPartOfReading) * part);
    };
    return RunParser(bytes, path, show_parsed).parse();
}

void mark_overwritten(std::span<char> bytes,
                      const std::function<std::uint64_t(std::uint64_t offset)>& written_now) {
    if (bytes.size() < sizeof(abi::RunHeader)) return;
    const auto header = read_at<abi::RunHeader>(bytes, 0);
    if (!check(header, bytes.size()).empty() || header.keeps != abi::RunKeeps::kNewest) return;
    const std::uint32_t used = std::min(header.rings_used, header.rings.count);
    for (std::uint32_t i = 0; i < used; ++i) {
        const std::uint64_t offset =
            header.rings.offset + std::uint64_t{i} * header.rings.element_bytes;
        if (!lies_in(offset, sizeof(abi::RunRing), 1, bytes.size())) return;
        const std::uint64_t written = written_now(offset + offsetof(abi::RunRing, written));
        if (written + abi::kRunMargin <= header.ring_records) continue;
        const std::uint64_t first = written + abi::kRunMargin - header.ring_records;
        std::memcpy(bytes.data() + offset + offsetof(abi::RunRing, first), &first, sizeof first);
    }
}

}  // namespace urgengo::trace
