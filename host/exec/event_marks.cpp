// SPDX-License-Identifier: Apache-2.0
#include "host/exec/event_marks.h"

#include <algorithm>
#include <optional>

#include "host/exec/relaxed_capture_mode.h"

namespace urgengo::exec {
namespace {

/// Where looks are farther apart they tell less: then a position is rather behind, and does not go
/// back.
constexpr nanoseconds kMostBefore{100'000};
/// What is current in the poller's thread has gone.
const CUcontext kGone = reinterpret_cast<CUcontext>(~std::uintptr_t{0});

}  // namespace

EventContext* EventMarks::add(CUcontext handle, CUdevice device, ug_mark_line* lines) {
    if (!driver_.cuEventCreate || !driver_.cuEventRecord || !driver_.cuEventRecord_ptsz ||
        !driver_.cuEventQuery || !driver_.cuCtxSetCurrent)
        return nullptr;
    if (!is_started_)
        is_started_ = poller_.start([this] {
            SteadyClock clock;
            return poll(clock);
        });
    if (!is_started_) return nullptr;
    const std::lock_guard lock(mutex_);
    const auto end = contexts_.begin() + num_contexts_.load(std::memory_order_relaxed);
    auto place = std::find_if(contexts_.begin(), end, [](const auto* c) { return !c->handle; });
    if (place == contexts_.end()) return nullptr;
    if (place == end) *place = new EventContext;
    EventContext& context = **place;
    context.handle = handle;
    context.device = device;
    context.lines = lines;
    context.given_up.store(false);
    if (place == end) num_contexts_.fetch_add(1, std::memory_order_release);
    return &context;
}

// Its events went with it. A launch that the program makes in the context as it goes may be on its
// way into record(): whatever that leaves here makes the next context's marks kernels, at worst.
void EventMarks::make_free(EventContext& context) {
    const std::lock_guard lock(mutex_);
    context.given_up.store(true);
    context.handle = nullptr;
    context.pending.store({});
    for (EventContext::Line& line : context.line) {
        line.is_made = false;
        line.pending_at = nanoseconds{0};
        if (line.ring) line.ring->fill({});
        line.num_recorded.store(0);
        line.num_seen.store(0);
    }
}

bool EventMarks::make_ring(EventContext::Line& line) const {
    const RelaxedCaptureMode relaxed(driver_);
    if (!line.ring)
        line.ring = std::make_unique<std::array<EventContext::Entry, EventContext::kRing>>();
    for (EventContext::Entry& entry : *line.ring)
        if (!entry.event &&
            driver_.cuEventCreate(&entry.event, CU_EVENT_DISABLE_TIMING) != CUDA_SUCCESS)
            return false;
    return line.is_made = true;
}

CUresult EventMarks::record(EventContext& context, const Mark& mark) {
    if (context.given_up.load(std::memory_order_acquire)) return CUDA_ERROR_NOT_PERMITTED;
    EventContext::Line& line = context.line[static_cast<std::size_t>(mark.task)];
    if (!line.is_made && !make_ring(line)) {
        context.given_up.store(true);
        return CUDA_ERROR_OUT_OF_MEMORY;
    }
    const std::uint32_t n = line.num_recorded.load(std::memory_order_relaxed);
    if (n - line.num_seen.load(std::memory_order_acquire) == EventContext::kRing)
        return CUDA_ERROR_NOT_READY;
    EventContext::Entry& entry = (*line.ring)[n % EventContext::kRing];
    entry.word0 = mark.word0;
    entry.tag = static_cast<std::uint16_t>(mark.sequence);
    entry.recorded = mark.time;
    if (is_watched_.load(std::memory_order_relaxed) != mark.is_watched)
        is_watched_.store(mark.is_watched, std::memory_order_relaxed);
    const auto record = of_flavor(mark.flavor, driver_.cuEventRecord, driver_.cuEventRecord_ptsz);
    const CUresult result = record(entry.event, mark.stream);
    if (result != CUDA_SUCCESS) {
        context.given_up.store(true);
        return result;
    }
    // The bit is seen set, or it is set, after the count: the poller clears it before it looks at
    // the count for the last time.
    line.num_recorded.store(n + 1);
    if (!context.pending.contains(mark.task)) context.pending.insert(mark.task);
    if (poller_.wake()) return CUDA_SUCCESS;
    context.given_up.store(true);
    return CUDA_ERROR_NOT_PERMITTED;
}

bool EventMarks::make_current(CUcontext context) {
    if (current_ == context) return true;
    if (driver_.cuCtxSetCurrent(context) != CUDA_SUCCESS) return false;
    current_ = context;
    return true;
}

// Those before the n-th are complete. When, is known to the last look: of so many that came since,
// evenly spread, the last did so a while ago.
void EventMarks::publish_last(EventContext& context, int task, std::uint32_t n, nanoseconds now) {
    EventContext::Line& line = context.line[static_cast<std::size_t>(task)];
    ug_mark_line& mailbox = context.lines[task];
    const EventContext::Entry& last = (*line.ring)[(n - 1) % EventContext::kRing];
    const nanoseconds since = std::min(std::max(line.pending_at, last.recorded), now);
    // Of the others it is not known to have been since then.
    const bool alone = last.recorded > line.pending_at;
    const std::uint32_t gaps = alone ? 2 : n - line.num_seen.load(std::memory_order_relaxed) + 1;
    const nanoseconds before = std::min((now - since) / gaps, kMostBefore);
    const auto time_ns = static_cast<std::uint64_t>((now - before).count());
    __atomic_store_n(&mailbox.word[0], last.word0, __ATOMIC_RELEASE);
    __atomic_store_n(&mailbox.word[1], ug_mark_word1(time_ns, last.tag), __ATOMIC_RELEASE);
    line.num_seen.store(n, std::memory_order_release);
}

void EventMarks::look_at(EventContext& context, int task, Clock& clock) {
    EventContext::Line& line = context.line[static_cast<std::size_t>(task)];
    const std::uint32_t seen = line.num_seen.load(std::memory_order_relaxed);
    std::uint32_t n = seen;
    CUresult result = CUDA_SUCCESS;
    nanoseconds asked = clock.now();  // before: the thread may lose its turn behind the question
    for (; n != line.num_recorded.load(); ++n) {
        asked = clock.now();
        result = driver_.cuEventQuery((*line.ring)[n % EventContext::kRing].event);
        if (result != CUDA_SUCCESS) break;
    }
    if (result != CUDA_SUCCESS && result != CUDA_ERROR_NOT_READY) {  // the context is lost
        context.given_up.store(true);
        return;
    }
    if (n != seen) publish_last(context, task, n, clock.now());
    line.pending_at = asked;
    if (result == CUDA_ERROR_NOT_READY) {
        __atomic_store_n(&context.lines[task].looked_ns, static_cast<std::uint64_t>(asked.count()),
                         __ATOMIC_RELEASE);
        return;
    }
    context.pending.erase(task);
    if (n != line.num_recorded.load()) context.pending.insert(task);
}

More EventMarks::poll(Clock& clock) {
    const std::lock_guard lock(mutex_);
    More more = More::kNone;
    bool has_called = false;
    {
        // Two calls, only where there is something to ask for.
        std::optional<RelaxedCaptureMode> relaxed;
        const int n = num_contexts_.load(std::memory_order_acquire);
        for (int i = 0; i < n; ++i) {
            EventContext& context = *contexts_[static_cast<std::size_t>(i)];
            const model::TaskSet pending = context.pending.load(std::memory_order_seq_cst);
            if (pending.is_empty() || context.given_up.load()) continue;
            if (!has_called) relaxed.emplace(driver_);
            has_called = true;
            if (!make_current(context.handle)) {
                context.given_up.store(true);
                continue;
            }
            pending.for_each([&](int task) {
                if (!context.given_up.load()) look_at(context, task, clock);
            });
            if (!context.given_up.load() && !context.pending.is_empty())
                more = is_watched_.load(std::memory_order_relaxed) ? More::kSoon : More::kLater;
        }
        if (more == More::kNone && current_) make_current(nullptr);
    }
    return more;
}

void EventMarks::drop(const EndingContext& ending) {
    const std::lock_guard lock(mutex_);
    const int n = num_contexts_.load(std::memory_order_acquire);
    for (int i = 0; i < n; ++i) {
        EventContext& context = *contexts_[static_cast<std::size_t>(i)];
        if (!context.handle || !ending.may_be(context.handle, context.device)) continue;
        context.given_up.store(true);
        // Its handle may come to mean another context.
        if (current_ == context.handle) current_ = kGone;
    }
}

}  // namespace urgengo::exec
