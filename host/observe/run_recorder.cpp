// SPDX-License-Identifier: Apache-2.0
#include "host/observe/run_recorder.h"

#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <memory>
#include <optional>
#include <system_error>

#include "host/base/clock.h"
#include "host/base/memory_orders.h"
#include "host/base/uncancelled.h"
#include "host/config/task_count.h"

namespace urgengo::observe {
namespace {

constexpr std::uint32_t kFewestRecords = 64;

/// Where a thread's next record goes.
struct Cursor {
    std::uint64_t recorder = 0;    ///< whose ring it is; 0: none's
    abi::RunRing* ring = nullptr;  ///< null: there was no room
    std::uint32_t thread = 0;
};
__attribute__((tls_model("initial-exec"))) constinit thread_local Cursor t_cursor;

std::int64_t realtime_ns() {
    timespec t{};
    clock_gettime(CLOCK_REALTIME, &t);
    return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

abi::RunRecord* records_of(abi::RunRing& ring) {
    return reinterpret_cast<abi::RunRecord*>(&ring + 1);
}

}  // namespace

RunRecorder::~RunRecorder() {
    if (!file_.memory) return;
    munmap(file_.memory, bytes_);
    for (const auto& ring : rings_)
        if (abi::RunRing* const its = ring.load()) munmap(its, ring_bytes_);
}

std::string RunRecorder::start(const std::string& path, abi::RunKeeps keeps,
                               std::uint32_t ring_records, std::uint32_t most_rings,
                               const std::string& group, const config::Config& config,
                               const std::string& conditions) {
    std::optional<unsigned> its_group;
    if (!group.empty() && !(its_group = find_group(group))) return "no group '" + group + "'";
    const std::uint32_t records = std::bit_ceil(std::max(ring_records, kFewestRecords));
    // Rings are mapped one by one, in whole pages.
    const std::size_t page = std::max<std::size_t>(sysconf(_SC_PAGESIZE), abi::kSectionAlignment);
    const auto in_pages = [&](std::size_t bytes) { return (bytes + page - 1) / page * page; };
    ring_bytes_ = in_pages(sizeof(abi::RunRing) + std::size_t{records} * sizeof(abi::RunRecord));
    bytes_ = in_pages(aligned(sizeof(abi::RunHeader)) +
                      aligned(sizeof(abi::RunChain) * config.chains.size()) +
                      aligned(sizeof(abi::RunTask) * config::num_tasks(config.chains)) +
                      aligned(conditions.size()));
    file_ = map_file(path, bytes_, 0640, its_group);
    if (!file_.memory) return path + ": " + std::strerror(errno);
    rings_ = std::vector<std::atomic<abi::RunRing*>>(most_rings);
    // It is opened again by its name, and the program may change its folder.
    std::error_code no_folder;
    path_ = std::filesystem::absolute(path, no_folder).string();
    mask_ = records - 1;
    auto* const header = new (file_.memory) abi::RunHeader{};
    header->ring_records = records;
    header->keeps = keeps;
    header_ = header;
    lay_out(config, conditions);
    static std::atomic<std::uint64_t> last_id{0};
    id_ = last_id.fetch_add(1) + 1;
    return {};
}

void RunRecorder::lay_out(const config::Config& config, const std::string& conditions) {
    abi::RunHeader& header = *header_;
    const ProcessKey process = own_process();
    header.version = abi::kRunVersion;
    header.header_bytes = sizeof header;
    header.record_bytes = sizeof(abi::RunRecord);
    header.process = process.process;
    header.start_ticks = process.start_ticks;
    header.pid_namespace = process.pid_namespace;
    copy_name(header.boot_id, process.boot_id);
    copy_name(header.program, program_name());
    header.begin_ns = monotonic_now().count();
    header.begin_realtime_ns = realtime_ns();
    std::size_t at = aligned(sizeof header);
    char* const base = static_cast<char*>(file_.memory);
    const auto place = [&]<typename T>(abi::StatusSection& section, T*& first, std::size_t count) {
        section = {at, sizeof(T), static_cast<std::uint32_t>(count)};
        first = reinterpret_cast<T*>(base + at);
        std::uninitialized_value_construct_n(first, count);
        at += aligned(sizeof(T) * count);
    };
    abi::RunChain* chains = nullptr;
    abi::RunTask* tasks = nullptr;
    place(header.chains, chains, config.chains.size());
    place(header.tasks, tasks, config::num_tasks(config.chains));
    char* text = nullptr;
    place(header.conditions, text, conditions.size());
    conditions.copy(text, conditions.size());
    header.rings = {bytes_, static_cast<std::uint32_t>(ring_bytes_),
                    static_cast<std::uint32_t>(rings_.size())};
    std::uint32_t next_task = 0;
    for (std::size_t i = 0; i < config.chains.size(); ++i) {
        const config::Chain& from = config.chains[i];
        copy_name(chains[i].name, from.name);
        chains[i].period_ns = from.period.count();
        chains[i].deadline_ns = from.deadline.count();
        chains[i].first_task = next_task;
        chains[i].num_tasks = static_cast<std::uint32_t>(from.tasks.size());
        for (std::size_t stage = 0; stage < from.tasks.size(); ++stage) {
            abi::RunTask& task = tasks[next_task++];
            copy_name(task.name, from.tasks[stage].name);
            task.chain = static_cast<std::uint32_t>(i);
            task.stage = static_cast<std::uint32_t>(stage);
        }
    }
    std::atomic_ref(header.magic).store(abi::kRunMagic, std::memory_order_release);
}

/// @returns a ring that no thread writes any more, and that is this thread's now
abi::RunRing* RunRecorder::find_left(std::uint32_t thread) {
    const bool keeps_oldest = header_->keeps == abi::RunKeeps::kOldest;
    const std::uint64_t used = std::min<std::uint64_t>(next_.load(), rings_.size());
    for (std::uint64_t i = 0; i < used; ++i) {
        abi::RunRing* const left = rings_[i].load(kAcquire);
        if (!left) continue;
        std::uint32_t none = 0;
        if (!std::atomic_ref(left->owner).compare_exchange_strong(none, thread, kAcquire)) continue;
        if (!keeps_oldest || left->written <= mask_) return left;  // else it is full: let it be
    }
    return nullptr;
}

abi::RunRing* RunRecorder::take_new(std::uint32_t thread) {
    const std::uint64_t index = next_.fetch_add(1);
    const std::size_t offset = bytes_ + index * ring_bytes_;
    // A trace was asked for; the flight recorder was not.
    const bool has_room = index < rings_.size() && (header_->keeps == abi::RunKeeps::kOldest ||
                                                    leaves_enough(path_, ring_bytes_));
    void* const memory = has_room ? map_more(path_, file_, offset, ring_bytes_) : nullptr;
    if (!memory) {
        next_.store(rings_.size());  // full
        return nullptr;
    }
    auto* const taken = new (memory) abi::RunRing{};
    taken->owner = thread;
    rings_[index].store(taken, kRelease);
    const std::atomic_ref used(header_->rings_used);
    const auto needed = static_cast<std::uint32_t>(index + 1);
    std::uint32_t seen = used.load();
    while (seen < needed && !used.compare_exchange_weak(seen, needed)) {
    }
    return taken;
}

abi::RunRing* RunRecorder::find_ring(std::uint32_t thread, bool is_first) {
    const int saved_errno = errno;
    const Uncancelled uncancelled;
    abi::RunRing* found = is_first ? find_left(thread) : nullptr;
    if (!found) found = take_new(thread);
    if (found) {
        found->thread = thread;
        prctl(PR_GET_NAME, found->thread_name);
    }
    errno = saved_errno;
    return found;
}

void RunRecorder::set_gpu(const char* name) {
    if (header_) std::snprintf(header_->gpu, sizeof header_->gpu, "%s", name);
}

void RunRecorder::lose(bool is_first) {
    std::atomic_ref(header_->lost).fetch_add(1, kRelaxed);
    if (is_first) std::atomic_ref(header_->threads_lost).fetch_add(1, kRelaxed);
}

void RunRecorder::add(const abi::RunRecord& record) {
    if (is_frozen_.load(std::memory_order_relaxed)) [[unlikely]]
        return;
    Cursor& cursor = t_cursor;
    const bool is_new = cursor.recorder != id_;
    const bool is_full = !is_new && header_->keeps == abi::RunKeeps::kOldest && cursor.ring &&
                         cursor.ring->written > mask_;
    if (is_new || is_full) [[unlikely]] {
        if (is_new) cursor = {id_, nullptr, static_cast<std::uint32_t>(syscall(SYS_gettid))};
        cursor.ring = find_ring(cursor.thread, is_new);
        if (!cursor.ring) return lose(true);
    }
    if (!cursor.ring) return lose(false);
    abi::RunRing& its = *cursor.ring;
    const std::uint64_t number = its.written;
    abi::RunRecord& to = records_of(its)[number & mask_];
    to = record;
    to.thread = cursor.thread;
    std::atomic_ref(its.written).store(number + 1, std::memory_order_release);
}

void RunRecorder::thread_ends() {
    Cursor& cursor = t_cursor;
    if (id_ == 0 || cursor.recorder != id_) return;
    if (cursor.ring) std::atomic_ref(cursor.ring->owner).store(0, std::memory_order_release);
    cursor = {};
}

}  // namespace urgengo::observe
