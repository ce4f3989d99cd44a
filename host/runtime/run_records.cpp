// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/run_records.h"

#include <ctime>
#include <utility>

#include "host/base/memory_orders.h"
#include "host/identity/stream_id.h"

namespace urgengo::runtime {
namespace {

using abi::RunKind;
using abi::RunRecord;

constexpr std::uint32_t kFlightRings = 64;  ///< threads: 16 MiB by default
/// A trace's: 2 GiB of them.
constexpr std::uint32_t kTraceRings = 8192, kTraceRingRecords = 4096;
/// It takes a system call.
constexpr nanoseconds kCpuUseEvery{1'000'000'000};
constexpr nanoseconds kClockEvery{1'000'000'000};

/// @returns whether it is due, and this thread's to do
bool take_turn(std::atomic<std::int64_t>& next, nanoseconds every, nanoseconds now) {
    std::int64_t due = next.load(kRelaxed);
    return now.count() >= due && next.compare_exchange_strong(due, (now + every).count(), kRelaxed);
}

RunRecord record_at(RunKind kind, nanoseconds now) {
    RunRecord record{};
    record.kind = kind;
    record.chain = record.task = record.behind_chain = record.behind_task = -1;
    record.time_ns = now.count();
    return record;
}

RunRecord record_of(const ChainState& chain, RunKind kind, nanoseconds now) {
    RunRecord record = record_at(kind, now);
    record.chain = static_cast<std::int16_t>(chain.index);
    return record;
}

}  // namespace

RunRecords::RunRecords(const observe::RecordOptions& options, const observe::ShareOptions& share,
                       observe::StatusPage& page, const config::Config& config)
    : page_(&page) {
    for (std::size_t i = 0; i < config.chains.size(); ++i)
        chain_of_.insert(chain_of_.end(), config.chains[i].tasks.size(), static_cast<int>(i));
    if (!options.trace.empty())
        note_ = recorder_.start(options.trace, abi::RunKeeps::kOldest, kTraceRingRecords,
                                kTraceRings, "", config, options.conditions);
    else if (page.is_shared() && options.flight_records > 0)
        recorder_.start(page.stem() + observe::kRecordsSuffix, abi::RunKeeps::kNewest,
                        options.flight_records, kFlightRings, share.group, config,
                        options.conditions);
}

RunRecord RunRecords::record_of(const TaskState& task, RunKind kind, nanoseconds now) const {
    RunRecord record = runtime::record_of(task.its_chain(), kind, now);
    record.task = static_cast<std::int16_t>(task.index);
    record.number = task.slot->instance.load(kRelaxed);
    record.arrival_ns = task.tracked.arrival.count();
    return record;
}

void RunRecords::add_frame_begin(const ChainState& chain, nanoseconds arrival, nanoseconds now) {
    RunRecord record = runtime::record_of(chain, RunKind::kFrameBegin, now);
    record.number = static_cast<std::uint32_t>(chain.statistics.frames.instances.load(kRelaxed));
    record.arrival_ns = arrival.count();
    recorder_.add(record);
}

void RunRecords::add_frame_end(const ChainState& chain, nanoseconds arrival,
                               const observe::Cause& cause, bool exited, nanoseconds now) {
    RunRecord record = runtime::record_of(chain, RunKind::kFrameEnd, now);
    record.flags = exited ? abi::kRunExited : 0;
    record.begin_ns = record.arrival_ns = arrival.count();
    record.cause = cause.kind;
    record.behind_chain = static_cast<std::int16_t>(cause.behind);
    record.cause_detail = cause.detail;
    record.frame = {(now - arrival).count(), cause.amount.count()};
    recorder_.add(record);
    note_cpu_use(now);
}

void RunRecords::note_cpu_use(nanoseconds now) {
    if (!take_turn(next_cpu_use_, kCpuUseEvery, now)) return;
    timespec used{};
    if (clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used) != 0) return;
    RunRecord record = record_at(RunKind::kCpuUse, now);
    record.cpu = {std::int64_t{used.tv_sec} * 1'000'000'000 + used.tv_nsec, 0};
    recorder_.add(record);
}

void RunRecords::describe_gpu(const exec::DriverApi& driver, CUdevice device) {
    char name[sizeof(abi::RunHeader::gpu)] = "";
    if (!are_on() || !driver.cuDeviceGetName ||
        driver.cuDeviceGetName(name, sizeof name, device) != CUDA_SUCCESS)
        return;
    std::string told = name;
    int version = 0;
    if (driver.cuDriverGetVersion && driver.cuDriverGetVersion(&version) == CUDA_SUCCESS)
        told +=
            ", CUDA " + std::to_string(version / 1000) + "." + std::to_string(version % 1000 / 10);
    recorder_.set_gpu(told.c_str());
}

void RunRecords::frame_dropped(const ChainState& chain, nanoseconds now) {
    if (are_on()) recorder_.add(runtime::record_of(chain, RunKind::kFrameDropped, now));
}

void RunRecords::add_task(const TaskState& task, RunKind kind, nanoseconds now) {
    RunRecord record = record_of(task, kind, now);
    record.begin_ns = task.tracked.begin.count();
    if (task.tracked.hinted) record.flags |= abi::kRunHinted;
    if (task.run.observed) record.flags |= abi::kRunObserved;
    recorder_.add(record);
}

void RunRecords::add_segment(const TaskState& task, RunKind kind, bool idle, nanoseconds now) {
    RunRecord record = record_of(task, kind, now);
    const nanoseconds begin =
        kind == RunKind::kSegmentBegin ? now : nanoseconds(task.run.segment.time);
    record.begin_ns = begin.count();
    if (idle) record.flags = abi::kRunIdle;
    record.stream =
        streams_.number_of(identity::stream_id(task.tracked.stream, task.tracked.flavor));
    record.segment.position = task.run.position;
    record.segment.estimate_ns = (task.work.launched - task.run.segment.launched).count();
    recorder_.add(record);
}

void RunRecords::note_priority(TaskState& task, int priority, Clock& clock) {
    const int before = std::exchange(task.facts.recorded_priority, priority);
    if (page_) page_->task(static_cast<std::size_t>(task.index)).priority.store(priority, kRelaxed);
    if (!are_on()) return;
    RunRecord record = record_of(task, RunKind::kPriority, clock.now());
    record.priority = {priority, before};
    recorder_.add(record);
}

void RunRecords::add_held(const TaskState& task, HoldPiece& piece, const sched::Wait& wait,
                          nanoseconds now) {
    if (piece.begin.count() != 0) {
        if (piece.why == wait.why && piece.behind == wait.behind) return;
        add_hold_end(task, piece, now);
    }
    piece.begin = now;
    piece.flags &= ~abi::kRunPaced;
    if (wait.is_paced) piece.flags |= abi::kRunPaced;
    piece.why = wait.why;
    piece.behind = wait.behind;
    add_hold(task, RunKind::kHoldBegin, piece, now);
}

void RunRecords::add_hold_end(const TaskState& task, HoldPiece& piece, nanoseconds now) {
    add_hold(task, RunKind::kHoldEnd, piece, now);
    piece.begin = nanoseconds{0};
}

void RunRecords::add_hold(const TaskState& task, RunKind kind, const HoldPiece& piece,
                          nanoseconds now) {
    RunRecord record = record_of(task, kind, now);
    record.flags = piece.flags;
    record.why = piece.why;
    record.begin_ns = piece.begin.count();
    record.behind_task = static_cast<std::int16_t>(piece.behind);
    if (piece.behind >= 0)
        record.behind_chain =
            static_cast<std::int16_t>(chain_of_[static_cast<std::size_t>(piece.behind)]);
    recorder_.add(record);
}

void RunRecords::add_wait(const TaskState& task, RunKind kind, nanoseconds begin, nanoseconds now) {
    RunRecord record = record_of(task, kind, now);
    record.begin_ns = begin.count();
    recorder_.add(record);
}

void RunRecords::add_mark(const TaskState& task, const progress::Positions::Seen& seen,
                          nanoseconds laxity, const model::GpuClock& gpu_clock, nanoseconds now) {
    RunRecord record = record_at(RunKind::kMark, now);
    record.chain = static_cast<std::int16_t>(task.chain->index);
    record.task = static_cast<std::int16_t>(task.index);
    // The mark's own instance: the task may be at a later one.
    const std::uint32_t newest = task.slot->instance.load(kRelaxed);
    record.number = newest - static_cast<std::uint16_t>(newest - seen.mark.instance);
    if (seen.time) record.begin_ns = seen.time->count();
    const std::uint64_t stream = task.log.mark_stream(seen.mark.sequence);
    if (task.log.still_holds(task.log.count(), seen.mark.sequence))
        record.stream = streams_.number_of(stream);
    record.mark = {seen.mark.position, seen.mark.sequence, laxity.count()};
    recorder_.add(record);
    note_gpu_clock(gpu_clock, now);
}

void RunRecords::note_gpu_clock(const model::GpuClock& gpu_clock, nanoseconds now) {
    if (gpu_clock.restarts() == 0 || !take_turn(next_clock_, kClockEvery, now)) return;
    const auto known = gpu_clock.newest();
    if (!known) return;
    RunRecord record = record_at(RunKind::kClock, now);
    record.clock = {known->stamp, known->host.count()};
    recorder_.add(record);
}

void RunRecords::mode(abi::StatusMode mode, nanoseconds now) {
    if (!are_on()) return;
    RunRecord record = record_at(RunKind::kMode, now);
    record.mode = mode;
    recorder_.add(record);
}

void RunRecords::tripped(nanoseconds now) {
    if (are_on()) recorder_.add(record_at(RunKind::kTrip, now));
    recorder_.freeze();
}

void RunRecords::chain_mode(const ChainState& chain, abi::StatusMode mode, nanoseconds now) {
    if (!are_on()) return;
    RunRecord record = runtime::record_of(chain, RunKind::kChainMode, now);
    record.mode = mode;
    recorder_.add(record);
}

void RunRecords::guard(const ChainState& chain, sched::GuardMode way, nanoseconds now) {
    if (!are_on()) return;
    RunRecord record = runtime::record_of(chain, RunKind::kGuard, now);
    record.way = static_cast<std::uint32_t>(way);
    recorder_.add(record);
}

void RunRecords::reloaded(nanoseconds now) {
    if (are_on()) recorder_.add(record_at(RunKind::kReload, now));
}

void RunRecords::add_park(const Park& park, nanoseconds now) {
    RunRecord record = record_at(RunKind::kPark, now);
    record.begin_ns = park.begin.count();
    record.park = {park.opening.count(), park.gated, park.refused};
    recorder_.add(record);
}

void RunRecords::add_rounds(const Rounds& rounds, nanoseconds now) {
    RunRecord record = record_at(RunKind::kRound, now);
    if (rounds.by_gpu) record.flags = abi::kRunByGpu;
    record.begin_ns = rounds.begin.count();
    record.round = {rounds.opened, rounds.rounds, rounds.took.count()};
    recorder_.add(record);
}

}  // namespace urgengo::runtime
