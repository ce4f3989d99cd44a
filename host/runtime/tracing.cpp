// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/tracing.h"

#include <sys/prctl.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "host/base/hash.h"
#include "host/exec/mark_cost.h"
#include "host/identity/occupied_share.h"

namespace urgengo::runtime {
namespace {

using abi::TraceKind;
using abi::TraceRecord;
using observe::TraceWriter;

std::uint64_t stream_id(CUstream stream, exec::StreamFlavor flavor, std::uint32_t thread) {
    if (stream == CU_STREAM_LEGACY || (!stream && flavor == exec::StreamFlavor::kLegacy)) return 1;
    if (stream == CU_STREAM_PER_THREAD || !stream) return 2 + (std::uint64_t{thread} << 8);
    return reinterpret_cast<std::uint64_t>(stream);
}

std::int16_t index_of(const TaskState* task) {
    return static_cast<std::int16_t>(task ? task->index : -1);
}

}  // namespace

double Tracer::occupied_share(const Launch& launch, const exec::MarkContext& context) const {
    if (launch.function) return identity::occupied_share(driver_, launch, context);
    const auto unit = graphs_.find(launch.graph);
    return unit ? unit->utilization : 1;
}

void Tracer::thread_name(ThreadState& thread) {
    char name[16] = {};
    prctl(PR_GET_NAME, name);
    if (thread.tracing.cursor.thread != 0 &&
        std::memcmp(name, thread.tracing.name, sizeof name) == 0)
        return;
    std::memcpy(thread.tracing.name, name, sizeof name);
    TraceRecord* record = options_.writer->add(thread.tracing.cursor, clock_.now());
    if (!record) return;
    std::memcpy(record->name, name, sizeof name);
    record->cpu_us = observe::thread_cpu_us();
    TraceWriter::publish(*record, TraceKind::kThread);
}

void Tracer::launch_begins(ThreadState& thread, const Launch& launch) {
    if (thread.line.launches == thread.tracing.launches_at_wait) thread_name(thread);
    if (options_.cupti) exec::CuptiTracer::launch_begins();
    if (!options_.time_kernels || thread.tracing.untimed) return;
    const exec::MarkContext* context = marks_.prepare();
    if (!context) return;
    if (!thread.tracing.timer || &thread.tracing.timer->context() != context) {
        give_back_timer(thread);
        thread.tracing.timer = take_timer(*context);
        thread.tracing.untimed = !thread.tracing.timer;
        if (thread.tracing.untimed) return;
        describe_gpu(*context);
    }
    if (!launch.depends_on_previous)
        thread.tracing.timer->before_launch(launch.stream, launch.flavor);
}

// Timers hold memory that is mapped for good, so those of ended threads are used again.
std::unique_ptr<exec::KernelTimer> Tracer::take_timer(const exec::MarkContext& context) {
    constexpr int kMaxTimers = 256;  // of 1 MiB
    const std::lock_guard lock(timers_mutex_);
    const auto idle = std::find_if(idle_timers_.begin(), idle_timers_.end(),
                                   [&](const auto& t) { return &t->context() == &context; });
    if (idle == idle_timers_.end()) {
        if (num_timers_ == kMaxTimers) return nullptr;
        ++num_timers_;
        return exec::KernelTimer::create(marks_, context);
    }
    auto timer = std::move(*idle);
    idle_timers_.erase(idle);
    return timer;
}

void Tracer::give_back_timer(ThreadState& thread) {
    if (!thread.tracing.timer) return;
    thread.tracing.timer->collect();
    const std::lock_guard lock(timers_mutex_);
    idle_timers_.push_back(std::move(thread.tracing.timer));
}

void Tracer::launch_ended(ThreadState& thread, const Launch& launch, std::uint64_t name_hash,
                          const TaskState* task, nanoseconds time, bool succeeded) {
    exec::KernelTimer* timer = options_.time_kernels ? thread.tracing.timer.get() : nullptr;
    const exec::MarkContext* context = timer || options_.cupti ? marks_.prepare() : nullptr;
    if (!succeeded) {
        if (timer) timer->launch_failed();
        return;
    }
    TraceRecord* record = options_.writer->add(thread.tracing.cursor, time);
    if (record) {
        record->task = index_of(task);
        record->instance = task ? task->slot->instance.load(std::memory_order_relaxed) : 0;
        record->flags = launch.function ? 0 : abi::kTraceGraph;
        if (thread.line.launches == thread.tracing.launches_at_wait)
            record->cpu_us = observe::thread_cpu_us();
        abi::TraceLaunch& l = record->launch;
        l.name_hash = name_hash;
        l.stream = stream_id(launch.stream, launch.flavor, thread.tracing.cursor.thread);
        l.grid_blocks = static_cast<std::uint32_t>(
            std::min<std::uint64_t>(launch.grid_blocks, ~std::uint32_t{0}));
        l.block_threads = static_cast<std::uint16_t>(launch.block_threads);
        if (context)
            l.utilization = static_cast<std::uint16_t>(occupied_share(launch, *context) * 65535);
        if (options_.cupti) {
            exec::CuptiTracer::describe_launch(*record);
            if (context) describe_gpu(*context);
        }
        TraceWriter::publish(*record, TraceKind::kLaunch);
    }
    if (timer && context == &timer->context())
        timer->after_launch(record, launch.stream, launch.flavor);
}

void Tracer::waited(ThreadState& thread, const Wait& wait, bool for_all) {
    if (thread.tracing.timer) thread.tracing.timer->collect();
    const bool names_stream = wait.function != abi::TraceWait::kContext && !wait.event;
    TraceRecord* record = options_.writer->add(thread.tracing.cursor, wait.begin);
    const std::uint32_t launches = thread.line.launches - thread.tracing.launches_at_wait;
    thread.tracing.launches_at_wait = thread.line.launches;
    if (!record) return;
    record->task = index_of(thread.task);
    record->flags = for_all ? abi::kTraceCovers : 0;
    record->cpu_us = observe::thread_cpu_us();
    record->wait.end_ns = clock_.now().count();
    record->wait.stream =
        names_stream ? stream_id(wait.stream, wait.flavor, thread.tracing.cursor.thread) : 0;
    record->wait.launches = launches;
    record->wait.function = wait.function;
    TraceWriter::publish(*record, TraceKind::kWait);
    if (!options_.cupti) return;
    const bool was_inside = std::exchange(thread.line.inside, true);  // CUPTI calls the driver
    options_.cupti->flush_now_and_then(clock_.now());
    thread.line.inside = was_inside;
}

void Tracer::instance(ThreadState& thread, const TaskState& task, TraceKind kind, nanoseconds now,
                      int flags) {
    TraceRecord* record = options_.writer->add(thread.tracing.cursor, now);
    if (!record) return;
    record->task = index_of(&task);
    record->flags = static_cast<std::uint8_t>(flags);
    // begin_run() counts the instance up when it writes the slot, which is after its begin.
    record->instance = task.slot->instance.load(std::memory_order_relaxed) +
                       (kind == TraceKind::kInstanceBegin ? 1 : 0);
    record->arrival_ns = task.tracked.arrival.count();
    TraceWriter::publish(*record, kind);
}

// An empty name: the innermost range has ended.
void Tracer::range(ThreadState& thread, std::string_view name) {
    const std::uint64_t hash = fnv1a64(name);
    if (!name.empty()) {
        auto& seen = thread.tracing.ranges[hash % thread.tracing.ranges.size()];
        if (std::exchange(seen, hash) != hash)
            options_.writer->add_text(thread.tracing.cursor, hash, name);
    }
    TraceRecord* record = options_.writer->add(thread.tracing.cursor, clock_.now());
    if (!record) return;
    record->hash = hash;
    TraceWriter::publish(*record, name.empty() ? TraceKind::kRangePop : TraceKind::kRangePush);
}

void Tracer::hint(ThreadState& thread, TraceKind kind, int task, std::uint64_t token,
                  nanoseconds arrival) {
    TraceRecord* record = options_.writer->add(thread.tracing.cursor, clock_.now());
    if (!record) return;
    record->task = static_cast<std::int16_t>(task);
    record->instance = static_cast<std::uint32_t>(token);
    record->cpu_us = observe::thread_cpu_us();
    record->arrival_ns = arrival.count();
    TraceWriter::publish(*record, kind);
}

// Once: what the reader should know of the GPU.
void Tracer::describe_gpu(const exec::MarkContext& context) {
    if (gpu_described_.exchange(true)) return;
    abi::TraceHeader& header = options_.writer->header();
    int version = 0, clock_khz = 0, memory_khz = 0;
    if (driver_.cuDeviceGetName)
        driver_.cuDeviceGetName(header.gpu, sizeof header.gpu, context.device);
    if (driver_.cuDriverGetVersion) driver_.cuDriverGetVersion(&version);
    driver_.cuDeviceGetAttribute(&clock_khz, CU_DEVICE_ATTRIBUTE_CLOCK_RATE, context.device);
    driver_.cuDeviceGetAttribute(&memory_khz, CU_DEVICE_ATTRIBUTE_MEMORY_CLOCK_RATE,
                                 context.device);
    header.num_sms = static_cast<std::uint32_t>(context.num_sms);
    header.driver_version = static_cast<std::uint32_t>(version);
    header.sm_clock_mhz = static_cast<std::uint32_t>(clock_khz / 1000);
    header.memory_clock_mhz = static_cast<std::uint32_t>(memory_khz / 1000);
    if (!options_.time_kernels) return;
    const exec::MarkCost cost = exec::measure_mark_cost(marks_, context);
    header.mark_ns = static_cast<std::uint32_t>(cost.mark.count());
    header.pause_ns = static_cast<std::uint32_t>(cost.pause.count());
}

}  // namespace urgengo::runtime
