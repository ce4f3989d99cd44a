// SPDX-License-Identifier: Apache-2.0
//
// Instances and whose work it is: construction from the config, hints, thread names. The launch
// path is in launch_path.cpp.
#include "host/runtime/runtime.h"

#include <fnmatch.h>
#include <sys/prctl.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "host/config/limits.h"
#include "host/model/urgency.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
static_assert(config::kMaxTasks == abi::kMaxTasks, "a config's tasks fit into the page");

const config::TaskProfile* find_profile(const std::optional<config::Profile>& profile,
                                        const std::string& chain, const std::string& task) {
    if (!profile) return nullptr;
    for (const config::ChainProfile& c : profile->chains)
        if (c.name == chain)
            for (const config::TaskProfile& t : c.tasks)
                if (t.name == task) return &t;
    return nullptr;
}

}  // namespace

Runtime::Runtime(config::ResolvedConfig resolved, const exec::DriverApi& driver, Clock& clock)
    : scheduler_(resolved.config.scheduler),
      driver_(driver),
      clock_(clock),
      mode_(resolved.config.mode),
      captures_(driver),
      marks_(driver),
      page_(std::make_unique<abi::SharedPage>()) {
    page_->magic = abi::kSharedPageMagic;
    page_->version = abi::kSharedPageVersion;
    page_->slot_bytes = sizeof(abi::TaskSlot);

    for (const config::Chain& c : resolved.config.chains) {
        auto& chain = *chains_.emplace_back(std::make_unique<ChainState>());
        chain.config = c;
        chain.statistics.name = c.name;
        for (const config::Task& t : c.tasks) {
            auto& task = *tasks_.emplace_back(std::make_unique<TaskState>());
            task.index = static_cast<int>(tasks_.size()) - 1;
            task.chain = &chain;
            task.name = t.name;
            task.thread_glob = t.thread_glob;
            if (const auto* profile = find_profile(resolved.profile, c.name, t.name))
                task.plan = model::TaskPlan(*profile);
            task.slot = &page_->tasks[task.index];
            task.slot->period_ns = c.period.count();
            task.slot->chain = static_cast<std::uint32_t>(chains_.size() - 1);
            chain.tasks.push_back(task.index);
        }
        nanoseconds gpu{0}, cpu{0};
        for (auto it = chain.tasks.rbegin(); it != chain.tasks.rend(); ++it) {
            TaskState& task = *tasks_[static_cast<std::size_t>(*it)];
            task.later_gpu = gpu;
            task.later_cpu = cpu;
            gpu += task.plan.gpu_time();
            cpu += task.plan.cpu_time();
        }
    }
    page_->num_tasks = static_cast<std::uint32_t>(tasks_.size());
}

// --- instances

std::uint64_t Runtime::arrival(const char* chain_name, nanoseconds when) {
    const auto chain = std::find_if(chains_.begin(), chains_.end(),
                                    [&](const auto& c) { return c->config.name == chain_name; });
    if (chain == chains_.end() || mode() == config::Mode::kOff) return 0;

    const std::lock_guard lock(instances_mutex_);
    const std::uint64_t token = next_token_++;
    Instance& entry = instances_[token % kMaxInstances];
    // A frame that the program never brought to its end, kMaxInstances frames ago.
    if (entry.token != 0) entry.chain->statistics.missed.fetch_add(1, kRelaxed);
    entry = {token, chain->get(), when};
    (*chain)->statistics.instances.fetch_add(1, kRelaxed);
    return token;
}

bool Runtime::task_begin(ThreadState& thread, std::uint64_t token, const char* task_name) {
    task_end(thread);
    leave_task(thread);
    Instance instance;
    {
        const std::lock_guard lock(instances_mutex_);
        instance = instances_[token % kMaxInstances];
    }
    if (token == 0 || instance.token != token) return false;
    TaskState* task = nullptr;
    for (int index : instance.chain->tasks)
        if (tasks_[static_cast<std::size_t>(index)]->name == task_name)
            task = tasks_[static_cast<std::size_t>(index)].get();
    if (!task) return false;

    const nanoseconds lax = model::laxity(
        {instance.arrival + instance.chain->config.deadline,
         task->plan.gpu_time() + task->later_gpu, task->plan.cpu_time() + task->later_cpu},
        clock_.now());
    if (lax.count() < 0 && instance.chain->config.on_late == config::OnLate::kExit &&
        mode() == config::Mode::kEnforce) {
        instance.chain->statistics.exited.fetch_add(1, kRelaxed);
        instance.chain->statistics.missed.fetch_add(1, kRelaxed);
        instance.chain->statistics.finished.fetch_add(1, kRelaxed);
        forget_instance(token);
        return true;
    }
    // From here on the thread's launches are this task's, or (if another thread has it) nobody's.
    thread.uses_hints = thread.hinted = true;
    thread.instance = instance;
    thread.last_task = task->index == instance.chain->tasks.back();
    thread.task = begin_run(thread, *task, instance.arrival) ? task : nullptr;
    return false;
}

void Runtime::task_end(ThreadState& thread) {
    if (!thread.hinted) return;
    leave_task(thread);
    if (!thread.last_task) return;
    finish_instance(*thread.instance.chain, thread.instance.arrival, clock_.now());
    forget_instance(thread.instance.token);
}

void Runtime::leave_task(ThreadState& thread) {
    thread.hinted = false;
    thread.name_is_fresh = false;
    if (TaskState* task = std::exchange(thread.task, nullptr)) end_run(*task);
}

void Runtime::forget_instance(std::uint64_t token) {
    const std::lock_guard lock(instances_mutex_);
    Instance& entry = instances_[token % kMaxInstances];
    if (entry.token == token) entry = {};
}

void Runtime::finish_instance(ChainState& chain, nanoseconds arrival, nanoseconds now) {
    const nanoseconds latency = now - arrival;
    ChainStatistics& s = chain.statistics;
    s.finished.fetch_add(1, kRelaxed);
    if (latency > chain.config.deadline) s.missed.fetch_add(1, kRelaxed);
    s.latency_sum_ns.fetch_add(latency.count(), kRelaxed);
    std::int64_t max = s.latency_max_ns.load(kRelaxed);
    while (latency.count() > max &&
           !s.latency_max_ns.compare_exchange_weak(max, latency.count(), kRelaxed)) {
    }
}

bool Runtime::begin_run(ThreadState& thread, TaskState& task, nanoseconds arrival) {
    ThreadState* nobody = nullptr;
    if (!task.owner.compare_exchange_strong(nobody, &thread, std::memory_order_acquire))
        return false;
    task.run = TaskRun{};
    task.run.arrival = arrival;

    abi::TaskSlot& slot = *task.slot;
    slot.version.fetch_add(1, std::memory_order_acq_rel);  // odd: being written
    slot.deadline_ns.store((arrival + task.chain->config.deadline).count(), kRelaxed);
    slot.later_gpu_ns.store(task.later_gpu.count(), kRelaxed);
    slot.later_cpu_ns.store(task.later_cpu.count(), kRelaxed);
    slot.instance.fetch_add(1, kRelaxed);
    slot.head_remaining_ns.store(task.plan.gpu_time().count(), kRelaxed);
    slot.state.store(abi::TaskState::kCpu, kRelaxed);
    slot.version.fetch_add(1, std::memory_order_release);
    return true;
}

void Runtime::end_run(TaskState& task) {
    leave_gpu_segment(task, false);
    task.slot->state.store(abi::TaskState::kIdle, kRelaxed);
    task.owner.store(nullptr, std::memory_order_release);
}

void Runtime::thread_exit(ThreadState& thread) {
    leave_task(thread);
}

// --- whose launch it is

TaskState* Runtime::resolve(ThreadState& thread) {
    if (thread.uses_hints) return thread.task;
    if (thread.task) {
        // A program that waits for its work in a way that we do not see never ends its instance.
        // Not for ever: it would rank as late for good.
        const ChainState& chain = *thread.task->chain;
        const nanoseconds now = clock_.now();
        if (now - thread.task->run.arrival <= std::max(chain.config.period, chain.config.deadline))
            return thread.task;
        end_named_run(thread, now);
    }
    if (!thread.name_is_fresh) {
        thread.name_is_fresh = true;
        thread.named_task = match_thread_name(thread);
    }
    return thread.named_task ? begin_named_run(thread) : nullptr;
}

// Without a hint the instance begins with its first launch, and ends with the wait for it.
TaskState* Runtime::begin_named_run(ThreadState& thread) {
    TaskState& task = *thread.named_task;
    if (!begin_run(thread, task, clock_.now())) return nullptr;
    task.chain->statistics.instances.fetch_add(1, kRelaxed);
    return thread.task = &task;
}

void Runtime::end_named_run(ThreadState& thread, nanoseconds now) {
    TaskState& task = *std::exchange(thread.task, nullptr);
    finish_instance(*task.chain, task.run.arrival, now);
    end_run(task);
}

TaskState* Runtime::match_thread_name(ThreadState& thread) {
    char name[16] = {};
    prctl(PR_GET_NAME, name);
    if (std::memcmp(name, thread.name, sizeof name) == 0) return thread.named_task;
    std::memcpy(thread.name, name, sizeof name);
    for (const auto& task : tasks_)
        if (!task->thread_glob.empty() && fnmatch(task->thread_glob.c_str(), name, 0) == 0)
            return task.get();
    return nullptr;
}

std::vector<const ChainStatistics*> Runtime::statistics() {
    if (const std::unique_lock lock(instances_mutex_, std::try_to_lock); lock.owns_lock()) {
        const nanoseconds now = clock_.now();
        for (Instance& i : instances_) {
            if (i.token == 0 || now - i.arrival <= i.chain->config.deadline) continue;
            i.chain->statistics.missed.fetch_add(1, kRelaxed);
            i = {};
        }
    }
    std::vector<const ChainStatistics*> all;
    for (const auto& chain : chains_) all.push_back(&chain->statistics);
    return all;
}

}  // namespace urgengo::runtime
