// SPDX-License-Identifier: Apache-2.0
//
// Construction from the config.
#include "host/runtime/runtime.h"

#include <unistd.h>

#include <algorithm>
#include <cstdlib>

#include "host/config/limits.h"
#include "host/config/progress_choice.h"
#include "host/sched/instance_slot.h"

namespace urgengo::runtime {
namespace {

// As the driver reads it.
bool launches_block() {
    const char* value = std::getenv("CUDA_LAUNCH_BLOCKING");
    return value && std::atoi(value) != 0;
}

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

// A launch is over when its call returns, a mark's too; an event or a write would not be, and the
// program would find its stream busy.
config::Scheduler tracked_while_blocking(config::Scheduler scheduler) {
    if (launches_block()) {
        scheduler.tracking = config::Tracking::kProgress;
        scheduler.progress_source = config::ProgressSource::kKernel;
    }
    return scheduler;
}

std::size_t count_tasks(const config::Config& config) {
    std::size_t n = 0;
    for (const config::Chain& chain : config.chains) n += chain.tasks.size();
    return n;
}

// By their names, which no kernel can have: "(graph)", "(graph of 53 kernels, 8f3a12bc)".
bool has_graphs(const config::TaskProfile& profile) {
    return std::any_of(profile.kernels.begin(), profile.kernels.end(),
                       [](const auto& kernel) { return kernel.name.starts_with("(graph"); });
}

}  // namespace

Runtime::Runtime(config::ResolvedConfig resolved, const exec::DriverApi& driver, Clock& clock,
                 TraceOptions trace, std::uint64_t test_holds)
    : scheduler_(config::paced_by_tracking(tracked_while_blocking(resolved.config.scheduler))),
      driver_(driver),
      clock_(clock),
      launches_block_(launches_block()),
      random_holds_(test_holds),
      guard_(resolved.config),
      page_(std::make_unique<abi::SharedPage>()),
      governor_(scheduler_, resolved.config.chains, resolved.config.mode, *page_, *this,
                clock.now()),
      positions_(scheduler_.tracking, sched::kMarkVisible, clock),
      batches_(scheduler_.tracking, scheduler_.eval_interval, clock),
      streams_(driver, governor_.tasks()),
      marks_all_(scheduler_.mark_every == nanoseconds{0}),
      marks_(driver,
             config::choose_source(follows_marks() ? scheduler_.progress_source
                                                   : config::ProgressSource::kKernel),
             nullptr, marks_all_, count_tasks(resolved.config)),
      cheap_waits_(resolved.config.blocking_sync, driver, clock, streams_.captures(), governor_),
      kernels_(driver, trace.writer),
      tracer_(trace, driver, clock, marks_, kernels_.graphs()),
      report_({clock, governor_, guard_, instances_, names_, chains_, tasks_}),
      copies_(scheduler_, resolved.config.chains.size() > 1 && !launches_block_,
              {driver, clock, streams_.captures(), marks_, governor_, guard_, tasks_}, *this) {
    page_->magic = abi::kSharedPageMagic;
    page_->version = abi::kSharedPageVersion;
    page_->slot_bytes = sizeof(abi::TaskSlot);

    for (const config::Chain& c : resolved.config.chains) {
        auto& chain = *chains_.emplace_back(std::make_unique<ChainState>());
        governor_.tasks().add(chain);
        chain.config = c;
        chain.index = chains_.size() - 1;
        chain.statistics.name = c.name;
        instances_.add_chain(chain);
        for (const config::Task& t : c.tasks) {
            auto& task = *tasks_.emplace_back(std::make_unique<TaskState>());
            governor_.tasks().add(task);
            task.index = static_cast<int>(tasks_.size()) - 1;
            task.chain = &chain;
            task.stage = chain.tasks.size();
            task.known_by.config = t;
            kernels_.add_task(task.index, t.kernels);
            names_.add_task(task.index, t, c.mode == config::Mode::kOff);
            if (const auto* profile = find_profile(resolved.profile, c.name, t.name)) {
                task.plan = model::TaskPlan(*profile);
                if (has_graphs(*profile)) kernels_.look_into_graphs();
            }
            task.tracker = model::InstanceTracker(task.plan);
            task.cpu = model::CpuSegments(task.plan.cpu_segments());
            if (scheduler_.learn) task.learning = std::make_unique<progress::Learning>(task.plan);
            task.learns = scheduler_.learn;
            task.slot = &page_->tasks[task.index];
            sched::describe_task(task, static_cast<std::uint32_t>(getpid()));
            chain.tasks.push_back(task.index);
        }
        for (const int index : chain.tasks)
            sched::describe_chain(governor_.tasks(), governor_.tasks()[index]);
    }
    for (const auto& task : tasks_) task->views.reserve(tasks_.size());
    sched::rank_chains(governor_.tasks());
    governor_.plan().reckon_load();
    page_->num_tasks = static_cast<std::uint32_t>(tasks_.size());
}

void Runtime::graph_instantiated(CUgraphExec executable, CUgraph graph) {
    if (mode() == config::Mode::kOff || !kernels_.looks_into_graphs()) return;
    const exec::RelaxedCaptureMode relaxed(driver_);
    // How much of the GPU it takes is learned while profiling.
    kernels_.graph_instantiated(executable, graph, tracer_.is_on() ? marks_.prepare() : nullptr);
}

}  // namespace urgengo::runtime
