// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/page/page_reader.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>
#include <optional>

#include "host/base/file_descriptor.h"
#include "host/model/slot_view.h"
#include "tools/trace/clean_text.h"
#include "tools/urgengo/page/planned_kernels.h"
#include "tools/urgengo/page/tame_slot.h"

namespace urgengo::cli {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
/// 256 chains of this version take 5 MB.
constexpr std::size_t kMostBytes = std::size_t{64} << 20;
constexpr std::uint32_t kMostChains = 1024, kMostTasks = 4096;
constexpr nanoseconds kMinute = std::chrono::minutes(1);

/// An element of a section as this version knows it: fields that the file lacks are 0.
template <typename T>
std::unique_ptr<T> copy_element(std::span<const std::byte> bytes, const abi::StatusSection& section,
                                std::size_t index) {
    auto element = std::make_unique<T>();
    const std::size_t size = std::min<std::size_t>(section.element_bytes, sizeof(T));
    std::memcpy(static_cast<void*>(element.get()),
                bytes.data() + section.offset + index * section.element_bytes, size);
    return element;
}

bool is_within(const abi::StatusSection& section, std::size_t bytes, std::uint32_t most) {
    return section.count <= most && section.element_bytes > 0 && section.offset <= bytes &&
           std::uint64_t{section.count} * section.element_bytes <= bytes - section.offset;
}

/// @returns how long ago that was, whatever the page says
nanoseconds since(std::int64_t time_ns, nanoseconds now) {
    return nanoseconds(static_cast<std::int64_t>(static_cast<std::uint64_t>(now.count()) -
                                                 static_cast<std::uint64_t>(time_ns)));
}

template <std::size_t N>
std::string to_string(const char (&name)[N]) {
    return trace::clean_text({name, strnlen(name, N)});
}

TaskReading read_task(const abi::TaskStatus& status, abi::TaskSlot& slot, int index,
                      nanoseconds now) {
    TaskReading task;
    task.name = to_string(status.name);
    task.chain = status.chain;
    task.num_kernels = status.num_kernels;
    task.planned_gpu = nanoseconds(status.planned_gpu_ns);
    if (const std::uint32_t ppm = slot.factor_ppm.load(kRelaxed); ppm > 0) task.factor = 1e-6 * ppm;
    const model::SlotView view = model::read_slot(slot, nullptr, index, now);
    if (!view.state.active) return task;
    task.state = slot.state.load(kRelaxed);
    task.waits_for_gpu = slot.waits.load(kRelaxed) != 0;
    task.why = slot.queue_why.load(kRelaxed);
    if (task.why != abi::Why::kNone) {
        task.behind = slot.queue_behind.load(kRelaxed);
        task.held = std::max(since(slot.queue_since_ns.load(kRelaxed), now), nanoseconds{0});
    }
    task.remaining_gpu = view.own_gpu();
    task.launched = view.ahead.launched;
    task.laxity = view.laxity;
    task.deadline = view.deadline;
    return task;
}

void read_rounds(const abi::DispatchSettings& dispatch, PageReading::Dispatcher& told) {
    told.urgent_laxity = nanoseconds(dispatch.gpu_urgent_laxity_ns.load(kRelaxed));
    told.gpu_rounds = dispatch.gpu_rounds.load(kRelaxed);
    if (told.gpu_rounds > 0)
        told.gpu_round = std::chrono::microseconds(dispatch.gpu_round_us.load(kRelaxed)) /
                         std::int64_t{told.gpu_rounds};
}

void add_gates(const abi::TaskSlot& slot, PageReading::Dispatcher& told) {
    const std::uint32_t closed = slot.gates_closed.load(kRelaxed);
    told.gates += closed;
    told.opened_by_gpu += slot.gates_opened_by_gpu.load(kRelaxed);
    // The GPU may have opened some between the two looks.
    const std::uint32_t now = closed - slot.gates_opened.load(kRelaxed);
    if (now < abi::kGateRing) told.closed += now;
}

std::vector<ChainReading::Frame> read_ring(const abi::ChainStatus& status) {
    std::vector<ChainReading::Frame> ring;
    const std::uint64_t frames = status.frames.load(kRelaxed);
    const std::uint64_t in_ring = std::min<std::uint64_t>(frames, abi::kFrameRing);
    ring.reserve(in_ring);
    for (std::uint64_t n = frames - in_ring; n < frames; ++n) {
        const abi::FrameRecord& frame = status.ring[n % abi::kFrameRing];
        ring.push_back({.end = nanoseconds(frame.end_ns.load(kRelaxed)),
                        .latency = std::chrono::microseconds(frame.latency_us.load(kRelaxed)),
                        .missed = frame.cause.load(kRelaxed) != 0});
    }
    return ring;
}

ChainReading::Lately read_lately(const std::vector<ChainReading::Frame>& ring, nanoseconds now) {
    ChainReading::Lately lately;
    std::vector<nanoseconds> latencies;
    for (const ChainReading::Frame& frame : ring) {
        if (since(frame.end.count(), now) > kMinute) continue;
        latencies.push_back(frame.latency);
        lately.missed += frame.missed;
    }
    lately.frames = latencies.size();
    if (latencies.empty()) return lately;
    std::sort(latencies.begin(), latencies.end());
    lately.median = latencies[latencies.size() / 2];
    lately.p99 = latencies[std::min(latencies.size() - 1, latencies.size() * 99 / 100)];
    lately.max = latencies.back();
    return lately;
}

ChainReading read_chain(const abi::ChainStatus& status, std::size_t num_chains, nanoseconds now) {
    ChainReading chain;
    chain.name = to_string(status.name);
    chain.period = nanoseconds(status.period_ns.load(kRelaxed));
    chain.deadline = nanoseconds(status.deadline_ns.load(kRelaxed));
    chain.mode = status.mode.load(kRelaxed);
    if (const std::uint32_t allowed = status.allowed_mode.load(kRelaxed); allowed > 0)
        chain.mode = observe::weaker(chain.mode, static_cast<abi::StatusMode>(allowed - 1));
    chain.guard = status.guard.load(kRelaxed);
    chain.instances = status.instances.load(kRelaxed);
    chain.finished = status.finished.load(kRelaxed);
    chain.missed = status.missed.load(kRelaxed);
    chain.exited = status.exited.load(kRelaxed);
    chain.misses_in_a_row = status.misses_in_a_row.load(kRelaxed);
    chain.most_misses_in_a_row = status.most_misses_in_a_row.load(kRelaxed);
    chain.late_starts = status.late_starts.load(kRelaxed);
    chain.launches = status.launches.load(kRelaxed);
    chain.scheduled = status.scheduled.load(kRelaxed);
    chain.holds = status.holds.load(kRelaxed);
    chain.held = nanoseconds(status.held_ns.load(kRelaxed));
    chain.paced = nanoseconds(status.paced_ns.load(kRelaxed));
    chain.latency_sum = nanoseconds(status.latency_sum_ns.load(kRelaxed));
    chain.latency_max = nanoseconds(status.latency_max_ns.load(kRelaxed));
    chain.would_hold = status.would_hold.load(kRelaxed);
    chain.would_held = nanoseconds(status.would_held_ns.load(kRelaxed));
    chain.would_behind = status.would_behind.load(kRelaxed) - 1;
    if (chain.would_behind < 0 || static_cast<std::size_t>(chain.would_behind) >= num_chains)
        chain.would_behind = -1;
    for (std::size_t i = 0; i < abi::kCauseCounters; ++i)
        chain.causes[i] = status.causes[i].load(kRelaxed);
    chain.last_miss = {.number = status.last_miss.load(kRelaxed),
                       .cause = abi::MissCause{status.last_cause.load(kRelaxed)},
                       .behind = status.last_behind.load(kRelaxed),
                       .late = std::chrono::microseconds(status.last_late_us.load(kRelaxed)),
                       .amount = nanoseconds(status.last_amount_ns.load(kRelaxed)),
                       .detail = status.last_detail.load(kRelaxed)};
    if (chain.last_miss.behind < 0 ||
        static_cast<std::size_t>(chain.last_miss.behind) >= num_chains)
        chain.last_miss.behind = -1;
    chain.ended = status.frames.load(kRelaxed);
    chain.ring = read_ring(status);
    chain.lately = read_lately(chain.ring, now);
    return chain;
}

// Of a chain's tasks that work on an instance, the one with the least laxity speaks for it.
void find_instances(PageReading& page) {
    for (std::size_t i = 0; i < page.tasks.size(); ++i) {
        const TaskReading& task = page.tasks[i];
        page.held_now += task.state == abi::TaskState::kHeld;
        if (task.state == abi::TaskState::kIdle) continue;
        int& at = page.chains[task.chain].at;
        if (at < 0 || task.laxity < page.tasks[static_cast<std::size_t>(at)].laxity)
            at = static_cast<int>(i);
    }
}

/// @returns how many bytes were read: fewer where the file ends
std::size_t read_at(int fd, std::span<std::byte> to, std::size_t at) {
    std::size_t have = 0;
    while (have < to.size()) {
        const ssize_t got =
            pread(fd, to.data() + have, to.size() - have, static_cast<off_t>(at + have));
        if (got <= 0 && !(got < 0 && errno == EINTR)) break;
        if (got > 0) have += static_cast<std::size_t>(got);
    }
    return have;
}

}  // namespace

Result<PageReading> parse_page(std::span<const std::byte> bytes, nanoseconds now,
                               const WordNow& word_now) {
    constexpr std::size_t kLeastHeader = offsetof(abi::StatusHeader, launches);
    if (bytes.size() < kLeastHeader) return Error{"is too short for a page"};
    const auto copied = copy_element<abi::StatusHeader>(
        bytes,
        {0, static_cast<std::uint32_t>(std::min(bytes.size(), sizeof(abi::StatusHeader))), 1}, 0);
    abi::StatusHeader& header = *copied;
    if (header.magic != abi::kStatusMagic) return Error{"is no page of UrgenGo"};
    if (header.header_bytes < kLeastHeader || header.header_bytes > bytes.size())
        return Error{"has a header that does not fit"};
    if (!is_within(header.akb, bytes.size(), 1) ||
        !is_within(header.chains, bytes.size(), kMostChains) ||
        !is_within(header.tasks, bytes.size(), kMostTasks) || header.akb.count != 1)
        return Error{"has a section that does not fit"};
    PageReading page;
    page.version = header.version;
    page.user = header.user;
    page.process = {header.process, header.start_ticks, header.pid_namespace,
                    to_string(header.boot_id)};
    page.program = to_string(header.program);
    page.mode = header.mode.load(kRelaxed);
    page.is_over = header.is_over.load(kRelaxed) != 0;
    page.is_controlled = header.is_controlled.load(kRelaxed) != 0;
    page.control_seen = header.control_seen.load(kRelaxed);
    page.control_refused = header.control_refused.load(kRelaxed);
    page.control_seen_ns = header.control_seen_ns.load(kRelaxed);
    page.holds_left = header.holds_left.load(kRelaxed);
    page.looks = nanoseconds(std::max<std::int64_t>(header.looks_ns.load(kRelaxed), 0));
    page.steers_chains = header.header_bytes >= sizeof(abi::StatusHeader);
    for (std::size_t i = 0; page.steers_chains && i < page.answers.size(); ++i)
        page.answers[i] = {header.answers[i].word.load(std::memory_order_acquire),
                           header.answers[i].result.load(kRelaxed)};
    if (page.steers_chains) {
        page.text_word = header.text_word.load(std::memory_order_acquire);
        page.text = to_string(header.text);
    }
    page.began = nanoseconds(header.begin_ns);

    for (std::uint32_t i = 0; i < header.chains.count; ++i)
        page.chains.push_back(read_chain(*copy_element<abi::ChainStatus>(bytes, header.chains, i),
                                         header.chains.count, now));
    // Slots of a later version are longer, and stand behind what this one knows of the page's head.
    const auto akb = copy_element<abi::SharedPage>(bytes, header.akb, 0);
    const std::size_t first_slot = header.akb.offset + offsetof(abi::SharedPage, tasks);
    const abi::StatusSection slots{first_slot, akb->slot_bytes, header.tasks.count};
    if (akb->magic != abi::kSharedPageMagic || first_slot > bytes.size() ||
        !is_within(slots, bytes.size(), kMostTasks))
        return Error{"has an active kernel buffer that does not fit"};
    const bool knows_rounds =
        akb->version == abi::kSharedPageVersion && header.akb.element_bytes == sizeof *akb;
    if (knows_rounds) read_rounds(akb->dispatch, page.dispatcher);
    PlannedKernels kernels(bytes, header.launches, header.kernel_names);
    for (std::uint32_t i = 0; i < header.tasks.count; ++i) {
        const auto status = copy_element<abi::TaskStatus>(bytes, header.tasks, i);
        if (status->chain >= page.chains.size()) return Error{"has a task of no chain"};
        const auto slot = copy_element<abi::TaskSlot>(bytes, slots, i);
        // The copy's version is that of its begin: what was written while it was copied shows in
        // the file only.
        const std::size_t version_at =
            slots.offset + std::size_t{i} * slots.element_bytes + offsetof(abi::TaskSlot, version);
        if (word_now && word_now(version_at) != slot->version.load(kRelaxed))
            slot->state.store(abi::TaskState::kIdle, kRelaxed);
        tame_slot(*slot);
        TaskReading& task =
            page.tasks.emplace_back(read_task(*status, *slot, static_cast<int>(i), now));
        if (knows_rounds && task.state != abi::TaskState::kIdle)
            task.rank = abi::RankedWord::of(akb->ranked[i].load(kRelaxed)).rank;
        constexpr std::size_t kWithPriority = offsetof(abi::TaskStatus, priority) + 4;
        if (header.tasks.element_bytes >= kWithPriority) task.priority = status->priority;
        kernels.find(*status, task);
        add_gates(*slot, page.dispatcher);
        page.chains[status->chain].tasks.push_back(i);
    }
    for (TaskReading& task : page.tasks)
        if (task.behind < 0 || static_cast<std::size_t>(task.behind) >= page.tasks.size())
            task.behind = -1;
    find_instances(page);
    return page;
}

Result<PageReading> read_page(const std::string& stem, nanoseconds now) {
    const std::string path = stem + observe::kPageSuffix;
    const FileDescriptor file(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
    struct stat status {};
    if (file.get() < 0 || fstat(file.get(), &status) != 0)
        return Error{path + ": " + std::strerror(errno)};
    if (!S_ISREG(status.st_mode) || static_cast<std::uint64_t>(status.st_size) > kMostBytes)
        return Error{path + ": is no page"};
    std::vector<std::byte> bytes(static_cast<std::size_t>(status.st_size));
    bytes.resize(read_at(file.get(), bytes, 0));
    auto page = parse_page(bytes, now, [&](std::size_t at) -> std::optional<std::uint32_t> {
        std::uint32_t word = 0;
        const std::span<std::byte> to = std::as_writable_bytes(std::span(&word, 1));
        if (read_at(file.get(), to, at) != to.size()) return std::nullopt;
        return word;
    });
    if (!page) return Error{path + ": " + page.error()};
    page->stem = stem;
    page->file = {status.st_uid, (status.st_mode & S_IRWXO) != 0};
    page->liveness = observe::liveness_of(page->process, stem, false);
    return page;
}

abi::StatusMode mode_of(const PageReading& page, const ChainReading& chain) {
    if (page.mode == abi::StatusMode::kTripped) return page.mode;
    return observe::weaker(page.mode, chain.mode);
}

const char* to_word(observe::Liveness liveness) {
    switch (liveness) {
        case observe::Liveness::kThere:
            return "there";
        case observe::Liveness::kStopped:
            return "stopped";
        case observe::Liveness::kGone:
            return "gone";
        case observe::Liveness::kElsewhere:
            break;
    }
    return "elsewhere";
}

const char* to_word(abi::Why why) {
    constexpr const char* kWords[] = {"none",      "rank",   "run-ahead", "turn to launch", "drain",
                                      "threshold", "bucket", "group",     "exclusive"};
    const auto index = static_cast<std::size_t>(why);
    return index < std::size(kWords) ? kWords[index] : "unknown";
}

const char* to_word(abi::TaskState state) {
    constexpr const char* kWords[] = {"idle", "cpu", "gpu", "held", "sync"};
    const auto index = static_cast<std::size_t>(state);
    return index < std::size(kWords) ? kWords[index] : "unknown";
}

}  // namespace urgengo::cli
