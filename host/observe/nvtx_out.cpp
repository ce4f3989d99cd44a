// SPDX-License-Identifier: Apache-2.0
#include "host/observe/nvtx_out.h"

#include <algorithm>
#include <utility>

#include "host/base/memory_orders.h"
#include "host/model/position.h"
#include "host/observe/nvtx_call.h"

namespace urgengo::observe {
namespace {

using nvtx::Category;
using nvtx::Counter;
using nvtx::Schema;
using nvtx::Word;
using Value = NvtxLink::Value;

/// Two points in time tell more of the clocks' rates the farther they are apart.
constexpr nanoseconds kFirstSync{1'000'000}, kSyncEvery{200'000'000};

Value value(nanoseconds time) {
    return std::int64_t{time.count()};
}
Value value(std::uint32_t number) {
    return std::int64_t{number};
}

Word word_of(abi::Why why) {
    return static_cast<Word>(static_cast<int>(Word::kRank) + static_cast<int>(why) -
                             static_cast<int>(abi::Why::kRank));
}
static_assert(static_cast<int>(Word::kExclusive) - static_cast<int>(Word::kRank) ==
              static_cast<int>(abi::Why::kExclusive) - static_cast<int>(abi::Why::kRank));

}  // namespace

void NvtxOut::attach(std::unique_ptr<NvtxLink> link, const Source& source) {
    if (!link || its_link_) return;
    its_link_ = std::move(link);
    source_ = std::make_unique<Source>(source);
    tasks_ = std::vector<Task>(source.tasks.all().size());
    chains_ = std::vector<Chain>(source.tasks.chains().size());
    for (std::size_t i = 0; i < tasks_.size(); ++i)
        tasks_[i].name = its_link_->add_text(source.task_names[i]);
    for (std::size_t i = 0; i < chains_.size(); ++i) {
        Chain& chain = chains_[i];
        const std::string& name = source.tasks.chains()[i]->config.name;
        chain.name = its_link_->add_text(name);
        for (std::size_t c = 0; c < nvtx::kNumCounters; ++c) {
            chain.counter_names[c] = its_link_->add_text(name + " " + nvtx::kCounters[c].name);
            chain.counters[c] =
                its_link_->add_counter(chain.counter_names[c]->text, nvtx::kCounters[c]);
        }
    }
    for (std::size_t i = 0; i < kNumCauses; ++i)
        causes_[i] = its_link_->add_text(to_word(static_cast<MissCause>(i)));
    is_on_.store(true, std::memory_order_release);
}

nanoseconds NvtxOut::laxity(sched::GovernedTask& task, nanoseconds now) const {
    return source_->tasks.look(task, now).laxity;
}

void NvtxOut::count(const sched::GovernedChain& chain, Counter counter, std::int64_t value) {
    const Chain& its = of(chain);
    const auto i = static_cast<std::size_t>(counter);
    link()->sample(its.counters[i], its.counter_names[i], value);
}

// --- instances

void NvtxOut::show_run(sched::GovernedTask& task, nanoseconds arrival, nanoseconds now) {
    const NvtxLink& tool = *link();
    Task& its = of(task);
    Chain& chain = of(*task.chain);
    its.laxity = laxity(task, now);
    const nanoseconds deadline = arrival + task.chain->deadline();
    if (task.stage == 0) {
        const std::lock_guard lock(mutex_);
        Instance& instance = chain.instances[chain.next++ % Chain::kInstances];
        if (instance.range != 0)  // so many are under way: it will not come to its end
            end_instance(chain, instance, instance.arrival + task.chain->deadline(), nanoseconds{0},
                         tool.word(Word::kDropped), {});
        instance = {0, ++chain.num_instances, arrival, its.laxity};
        instance.range =
            tool.start(Category::kChain, chain.name, Schema::kInstance,
                       std::array<Value, 9>{chain.name, nullptr, instance.number, value(deadline),
                                            value(its.laxity), std::int64_t{0},
                                            tool.word(Word::kUnderWay), nullptr, nullptr});
    }
    its.range = tool.start(
        Category::kLaunch, its.name, Schema::kInstance,
        std::array<Value, 9>{chain.name, its.name, value(task.slot->instance.load(kRelaxed)),
                             value(deadline), value(its.laxity), std::int64_t{0},
                             tool.word(Word::kUnderWay), nullptr, nullptr});
    count(*task.chain, Counter::kLaxity, its.laxity.count());
    count(*task.chain, Counter::kHeld, 0);
}

void NvtxOut::show_run_end(sched::GovernedTask& task, nanoseconds now) {
    const NvtxLink& tool = *link();
    Task& its = of(task);
    show_wait_end(task, now);  // by a thread that has ended in it
    if (its.range == 0) return;
    const nanoseconds left = laxity(task, now);
    const Text* const outcome = tool.word(left.count() < 0 ? Word::kLate : Word::kInTime);
    const nanoseconds deadline(task.slot->deadline_ns.load(kRelaxed));
    tool.end(its.range.exchange(0), Schema::kInstance,
             std::array<Value, 9>{of(*task.chain).name, its.name,
                                  value(task.slot->instance.load(kRelaxed)), value(deadline),
                                  value(its.laxity), value(left), outcome, nullptr, nullptr});
    sync_clocks();
}

void NvtxOut::end_instance(const Chain& chain, const Instance& instance, nanoseconds deadline,
                           nanoseconds laxity, const Text* outcome, const Cause& cause) const {
    const Text* const behind =
        cause.behind < 0 ? nullptr : chains_[static_cast<std::size_t>(cause.behind)].name;
    const std::array<Value, 9> values{
        chain.name,    nullptr, instance.number,        value(deadline), value(instance.laxity),
        value(laxity), outcome, cause_text(cause.kind), behind};
    link()->end(instance.range, Schema::kInstance, values);
    if (cause.kind == MissCause::kNone) return;
    const bool exited = outcome == link()->word(Word::kExited);
    link()->mark(Category::kChain, link()->word(exited ? Word::kEarlyExit : Word::kMiss),
                 Schema::kInstance, values);
}

void NvtxOut::show_frame_end(const sched::GovernedChain& chain, nanoseconds arrival,
                             nanoseconds now, const Cause& cause, bool exited) {
    Chain& its = of(chain);
    const nanoseconds deadline = arrival + chain.deadline();
    const nanoseconds left = deadline - now;
    const Word outcome = exited ? Word::kExited : left.count() < 0 ? Word::kLate : Word::kInTime;
    {
        const std::lock_guard lock(mutex_);
        const auto found =
            std::find_if(its.instances.begin(), its.instances.end(),
                         [&](const Instance& i) { return i.range != 0 && i.arrival == arrival; });
        Instance none{0, 0, arrival, left};
        Instance& instance = found != its.instances.end() ? *found : none;
        end_instance(its, instance, deadline, left, link()->word(outcome), cause);
        instance.range = 0;
    }
    count(chain, Counter::kLaxity, left.count());
}

void NvtxOut::show_dropped(const sched::GovernedChain& chain) {
    link()->mark(
        Category::kChain, link()->word(Word::kDropped), Schema::kInstance,
        std::array<Value, 9>{of(chain).name, nullptr, std::int64_t{0}, std::int64_t{0},
                             std::int64_t{0}, std::int64_t{0}, link()->word(Word::kDropped),
                             cause_text(MissCause::kDropped), nullptr});
}

// --- launches

void NvtxOut::show_wait(sched::GovernedTask& task, const sched::Wait& wait, nanoseconds now) {
    const NvtxLink& tool = *link();
    Task& its = of(task);
    show_wait_end(task, now);  // one whose thread has jumped out of it
    its.waited = task.run.waited;
    its.wait_laxity = laxity(task, now);
    its.why = wait.why == abi::Why::kNone ? nullptr : tool.word(word_of(wait.why));
    its.behind = wait.behind < 0 ? nullptr : chains_[source_->tasks[wait.behind].chain->index].name;
    its.wait = tool.start(
        Category::kHold, tool.word(wait.is_paced ? Word::kPaced : Word::kHold), Schema::kHold,
        std::array<Value, 8>{of(*task.chain).name, its.name, its.behind, its.why, std::int64_t{0},
                             std::int64_t{0}, value(its.wait_laxity), std::int64_t{0}});
}

void NvtxOut::show_wait_end(sched::GovernedTask& task, nanoseconds now) {
    Task& its = of(task);
    if (its.wait == 0) return;
    if (task.slot->started.load(kRelaxed) == 0)  // the segment's first launch was held
        its.segment_begin.store(now, std::memory_order_relaxed);
    const nanoseconds left = laxity(task, now);
    link()->end(its.wait.exchange(0), Schema::kHold,
                std::array<Value, 8>{of(*task.chain).name, its.name, its.behind, its.why,
                                     value(task.run.waited.held - its.waited.held),
                                     value(task.run.waited.paced - its.waited.paced),
                                     value(its.wait_laxity), value(left)});
    count(*task.chain, Counter::kLaxity, left.count());
    count(*task.chain, Counter::kHeld, task.run.waited.held.count());
}

void NvtxOut::show_priority(const sched::GovernedTask& task, int priority) {
    Task& its = of(task);
    const int before = its.has_priority ? its.priority : priority;
    if (its.has_priority && before == priority) return;
    its.priority = priority;
    count(*task.chain, Counter::kPriority, priority);
    if (std::exchange(its.has_priority, true))
        link()->mark(Category::kLaunch, link()->word(Word::kPriority), Schema::kPriority,
                     std::array<Value, 4>{of(*task.chain).name, its.name, std::int64_t{priority},
                                          std::int64_t{before}});
}

// --- where the GPU is

std::optional<std::uint64_t> NvtxOut::stamp_at(nanoseconds host) const {
    const auto known = source_->gpu_clock.newest();
    if (!known) return std::nullopt;
    constexpr std::uint64_t kMask = (std::uint64_t{1} << 48) - 1;
    return (known->stamp + static_cast<std::uint64_t>((host - known->host).count())) & kMask;
}

// What was launched since the mark before has executed since then, or since its segment's begin.
void NvtxOut::show_executed(const sched::GovernedTask& task, std::uint16_t instance,
                            std::uint32_t position, std::uint64_t stamp) {
    Task& its = of(task);
    const auto extended = [&](std::uint64_t to) {
        return its.mark.has_stamp ? its.mark.gpu_time + model::stamp_difference(to, its.mark.stamp)
                                  : static_cast<std::int64_t>(to);
    };
    const auto segment = stamp_at(its.segment_begin.load(std::memory_order_relaxed));
    const std::int64_t end = extended(stamp);
    std::int64_t begin = segment              ? extended(*segment)
                         : its.mark.has_stamp ? its.mark.gpu_time
                                              : end;
    if (its.mark.has_stamp) begin = std::max(begin, its.mark.gpu_time);
    const bool goes_on = its.mark.instance == instance && position >= its.mark.position;
    const std::uint32_t first = goes_on ? its.mark.position : 0;
    if (position > first && begin < end)
        link()->event(std::array<Value, 7>{its.name, begin, end, of(*task.chain).name,
                                           value(std::uint32_t{instance}), value(first),
                                           value(position)});
    its.mark.instance = instance;
    its.mark.position = position;
    its.mark.stamp = stamp;
    its.mark.gpu_time = end;
    its.mark.has_stamp = true;
}

void NvtxOut::show_progress(const sched::GovernedTask& task, const ug_mark_line& line) {
    Task& its = of(task);
    if (its.looks.exchange(true, std::memory_order_acquire)) return;  // at a mark before this one
    const auto mark =
        model::read_mark(line, task.slot->marks_issued.load(std::memory_order_acquire));
    const bool is_gpu_time = mark && mark->stamp != UG_MARK_NO_TIME &&
                             __atomic_load_n(&line.clock, __ATOMIC_ACQUIRE) == UG_MARK_CLOCK_GPU;
    if (is_gpu_time) show_executed(task, mark->instance, mark->position, mark->stamp);
    its.looks.store(false, std::memory_order_release);
    if (mark) count(*task.chain, Counter::kExecuting, std::int64_t{mark->position});
    sync_clocks();
}

// Behind the last mark: until the wait for it has ended.
void NvtxOut::show_segment_end(const sched::GovernedTask& task, nanoseconds now) {
    Task& its = of(task);
    count(*task.chain, Counter::kExecuting, std::int64_t{task.run.position});
    const auto stamp = stamp_at(now);
    if (!stamp || its.looks.exchange(true, std::memory_order_acquire)) return;
    show_executed(task, static_cast<std::uint16_t>(task.slot->instance.load(kRelaxed)),
                  task.run.position, *stamp);
    its.looks.store(false, std::memory_order_release);
}

void NvtxOut::sync_clocks() {
    if (!link()->takes_deferred()) return;
    const auto known = source_->gpu_clock.newest();
    if (!known) return;
    const std::unique_lock lock(sync_mutex_, std::try_to_lock);
    if (!lock) return;
    if (num_syncs_ == 0) {
        first_sync_ = last_sync_ = *known;
        last_sync_gpu_ = static_cast<std::int64_t>(known->stamp);
        num_syncs_ = 1;
        return;
    }
    const nanoseconds since = known->host - last_sync_.host;
    if (since < (num_syncs_ == 1 ? kFirstSync : kSyncEvery)) return;
    const std::int64_t gpu =
        last_sync_gpu_ + model::stamp_difference(known->stamp, last_sync_.stamp);
    if (gpu <= last_sync_gpu_) return;
    link()->sync(std::array<NvtxLink::SyncPoint, 2>{
        {{last_sync_gpu_, last_sync_.host.count()}, {gpu, known->host.count()}}});
    last_sync_ = *known;
    last_sync_gpu_ = gpu;
    ++num_syncs_;
}

// --- dispatcher, and UrgenGo itself

void NvtxOut::show_gates(const sched::GovernedTask& task, Word what) {
    if (const int closed = closed_in_round_.exchange(kNoRound, kRelaxed); closed != kNoRound)
        show_dispatch(Word::kRound, closed);
    link()->mark(Category::kDispatch, link()->word(what), Schema::kGates,
                 std::array<Value, 3>{of(task).name, value(task.slot->gates_closed.load(kRelaxed)),
                                      value(task.slot->gates_opened.load(kRelaxed))});
}

void NvtxOut::show_dispatch(Word what, int closed) {
    link()->mark(Category::kDispatch, link()->word(what), Schema::kGates,
                 std::array<Value, 3>{nullptr, std::int64_t{closed}, std::int64_t{0}});
}

void NvtxOut::show_mode(abi::StatusMode mode) {
    const Word word = mode == abi::StatusMode::kEnforce   ? Word::kEnforce
                      : mode == abi::StatusMode::kShadow  ? Word::kShadow
                      : mode == abi::StatusMode::kObserve ? Word::kObserve
                                                          : Word::kOff;
    link()->mark(Category::kDispatch, link()->word(Word::kMode), Schema::kMode,
                 std::array<Value, 1>{link()->word(word)});
}

void NvtxOut::show_trip() {
    link()->mark(Category::kDispatch, link()->word(Word::kTrip), Schema::kMode,
                 std::array<Value, 1>{link()->word(Word::kOff)});
}

void NvtxOut::finish() {
    // Out of a signal's handler the tool may be in the middle of a call, as far as this thread
    // goes.
    if (!is_on_.exchange(false) || NvtxCall::is_under_way()) return;
    const NvtxLink* const tool = link();
    const Text* const under_way = tool->word(Word::kUnderWay);
    for (std::size_t i = 0; i < tasks_.size(); ++i) {
        const Text* const chain = of(*source_->tasks.all()[i]->chain).name;
        tool->end(tasks_[i].wait.exchange(0), Schema::kHold,
                  std::array<Value, 8>{chain, tasks_[i].name, nullptr, nullptr, std::int64_t{0},
                                       std::int64_t{0}, std::int64_t{0}, std::int64_t{0}});
        tool->end(
            tasks_[i].range.exchange(0), Schema::kInstance,
            std::array<Value, 9>{chain, tasks_[i].name, std::int64_t{0}, std::int64_t{0},
                                 std::int64_t{0}, std::int64_t{0}, under_way, nullptr, nullptr});
    }
    // Or this very thread may have the mutex.
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock.owns_lock()) return;
    for (Chain& chain : chains_)
        for (Instance& instance : chain.instances)
            tool->end(std::exchange(instance.range, 0), Schema::kInstance,
                      std::array<Value, 9>{chain.name, nullptr, instance.number, std::int64_t{0},
                                           value(instance.laxity), std::int64_t{0}, under_way,
                                           nullptr, nullptr});
}

}  // namespace urgengo::observe
