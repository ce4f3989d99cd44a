// SPDX-License-Identifier: Apache-2.0
//
// Construction from the config, and what is reported at the end.
#include "host/runtime/runtime.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
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

constexpr auto kRelaxed = std::memory_order_relaxed;
static_assert(config::kMaxTasks == abi::kMaxTasks, "a config's tasks fit into the page");
/// More launches than this share of a chain's that the profile does not know: it is of something
/// else.
constexpr double kUnknownShare = 0.05;
constexpr double kEnoughLaunches = 100;
/// GPU times that were this many times longer or shorter than the profile's: it is worth a new one.
constexpr double kWrongProfile = 1.25;
/// So many frames that started late, and this share of all, are worth a word.
constexpr double kManyLateStarts = 10, kLateStartShare = 0.05;

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
            task.name = t.name;
            task.match = t;
            kernels_.add_task(task.index, t.kernels);
            names_.add_task(task.index, t, c.mode == config::Mode::kOff);
            if (const auto* profile = find_profile(resolved.profile, c.name, t.name)) {
                task.plan = model::TaskPlan(*profile);
                if (has_graphs(*profile)) kernels_.look_into_graphs();
            }
            task.tracker = model::InstanceTracker(task.plan);
            task.cpu = model::CpuSegments(task.plan.cpu_segments());
            if (scheduler_.learn) task.learning = std::make_unique<progress::Learning>(task.plan);
            task.has_plan = !task.plan.is_empty();
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

std::vector<const observe::ChainStatistics*> Runtime::statistics() {
    instances_.drop_late(clock_.now());
    const std::vector<const char*> guarded = guard_.words();
    std::vector<const observe::ChainStatistics*> all;
    for (const auto& chain : chains_) {
        observe::ChainStatistics& s = chain->statistics;
        s.misses_in_a_row = chain->misses_in_a_row.load(kRelaxed);
        const auto sum = [&](auto& total, auto counter) {
            total = 0;
            for (const int index : chain->tasks)
                total +=
                    (tasks_[static_cast<std::size_t>(index)]->counters.*counter).load(kRelaxed);
        };
        sum(s.launches, &TaskCounters::launches);
        sum(s.scheduled, &TaskCounters::scheduled);
        s.as_planned = 0;
        s.copies_cut = 0;
        s.synchronisations = 0;
        for (const int index : chain->tasks) {
            const TaskState& task = *tasks_[static_cast<std::size_t>(index)];
            const std::uint32_t uncounted = task.uncounted();
            s.launches += uncounted;
            s.scheduled += uncounted;
            s.as_planned += task.slot->as_planned.load(kRelaxed);
            s.copies_cut += task.copies.num_cut.load(kRelaxed);
            s.synchronisations += task.batches.num_waits.load(kRelaxed);
        }
        s.guard = guarded[chain->index];
        sum(s.marks, &TaskCounters::marks);
        sum(s.marks_refused, &TaskCounters::marks_refused);
        sum(s.holds, &TaskCounters::holds);
        sum(s.holds_opened, &TaskCounters::holds_opened);
        sum(s.held_ns, &TaskCounters::held_ns);
        sum(s.paced_ns, &TaskCounters::paced_ns);
        sum(s.unknown, &TaskCounters::unknown);
        sum(s.implicit_syncs, &TaskCounters::implicit_syncs);
        sum(s.lent, &TaskCounters::lent);
        all.push_back(&s);
    }
    return all;
}

void Runtime::graph_instantiated(CUgraphExec executable, CUgraph graph) {
    if (mode() == config::Mode::kOff || !kernels_.looks_into_graphs()) return;
    const exec::RelaxedCaptureMode relaxed(driver_);
    // How much of the GPU it takes is learned while profiling.
    kernels_.graph_instantiated(executable, graph, tracer_.is_on() ? marks_.prepare() : nullptr);
}

std::vector<std::string> Runtime::warnings() {
    std::vector<std::string> lines, unmatched;
    const std::vector<std::string> seen = names_.unmatched();
    std::uint64_t launches = 0;
    for (const auto& task : tasks_) {
        launches += task->counters.launches.load(kRelaxed);
        if (task->matched.load(kRelaxed)) continue;
        const config::Task& match = task->match;
        unmatched.push_back(
            fmt::format("'{}' of chain '{}' ({})", task->name, task->chain->config.name,
                        !match.thread_glob.empty() ? "thread: '" + match.thread_glob + "'"
                        : !match.nvtx_glob.empty() ? "nvtx: '" + match.nvtx_glob + "'"
                        : !match.kernels.empty()   ? "kernels: '" + match.kernels[0].name_glob + "'"
                                                   : std::string("hints only")));
    }
    for (const auto& task : tasks_)
        if (task->lost_streams.load(kRelaxed))
            lines.push_back(
                fmt::format("warning: task '{}' of chain '{}' uses more than {} streams "
                            "at a time: they are not followed",
                            task->name, task->chain->config.name, progress::kMaxStreams));
    if (!unmatched.empty() && (launches > 0 || !seen.empty()))
        lines.push_back(fmt::format(
            "warning: nothing matched task {}; threads that launched and matched nothing: {}",
            fmt::join(unmatched, ", "),
            seen.empty() ? "none" : fmt::format("'{}'", fmt::join(seen, "', '"))));
    if (guard_.has_fallen_back()) lines.push_back("warning: " + guard_.summary());
    if (const std::uint32_t ends = governor_.polls().num_ends(); ends > 0)
        lines.push_back(fmt::format(
            "warning: looks of held launches took more than {:.0f} % of a core, so nobody was held "
            "for a second: {} times",
            100 * sched::PollBudget::kShare, ends));
    if (const std::uint32_t jumps = num_jumps_.load(kRelaxed); jumps > 0)
        lines.push_back(fmt::format(
            "warning: the program jumped out of a held launch (siglongjmp): {} times", jumps));
    for (const observe::ChainStatistics* s : statistics()) {
        const auto scheduled = static_cast<double>(s->scheduled.load(kRelaxed));
        const auto unknown = static_cast<double>(s->unknown.load(kRelaxed));
        if (const auto implausible = s->implausible.load(kRelaxed); implausible > 0)
            lines.push_back(fmt::format(
                "warning: {} of {} arrivals that hints told of chain '{}' are implausible (another "
                "clock?): the time of the call was taken instead",
                implausible, s->instances.load(kRelaxed), s->name));
        const auto late = static_cast<double>(s->late_starts.load(kRelaxed));
        if (late >= kManyLateStarts &&
            late > kLateStartShare * static_cast<double>(s->instances.load(kRelaxed)))
            lines.push_back(fmt::format(
                "warning: {:.0f} of {} frames of chain '{}' started late, by more than their "
                "arrivals vary: a lock, a sensor or a slow thread; misses are counted from a "
                "frame's start",
                late, s->instances.load(kRelaxed), s->name));
        if (scheduled < kEnoughLaunches || unknown <= kUnknownShare * scheduled) continue;
        lines.push_back(
            fmt::format("warning: the profile does not know {:.0f} % of the launches of chain "
                        "'{}': run `urgengo profile` again",
                        100 * unknown / scheduled, s->name));
    }
    for (const auto& task : tasks_) {
        const std::uint32_t ppm = task->slot->factor_ppm.load(kRelaxed);
        const double factor = ppm == 0 ? 1 : ppm * 1e-6;
        if (task->plan.is_empty() || (factor < kWrongProfile && factor * kWrongProfile > 1))
            continue;
        lines.push_back(
            fmt::format("warning: GPU times of task '{}' of chain '{}' were {:.2f} times what the "
                        "profile says, "
                        "and were corrected: run `urgengo profile` again",
                        task->name, task->chain->config.name, factor));
    }
    if (governor_.bystanders().are_busy())
        lines.push_back(
            "warning: work of no chain kept the GPU busy, so nobody was held (priorities alone); "
            "name "
            "it as a chain of its own to have it give way");
    return lines;
}

}  // namespace urgengo::runtime
