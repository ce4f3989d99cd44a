// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/common.h"

#include <cstdlib>

#include "host/base/serialising_tool.h"
#include "host/config/progress_choice.h"

namespace urgengo::runtime {
namespace {

// As the driver reads it.
bool do_launches_block() {
    const char* value = std::getenv("CUDA_LAUNCH_BLOCKING");
    return value && std::atoi(value) != 0;
}

// A launch is over when its call returns, a mark's too; an event or a write would not be, and the
// program would find its stream busy.
config::Scheduler tracked_while_blocking(config::Scheduler scheduler, bool launches_block) {
    if (launches_block) {
        scheduler.progress.tracking = config::Tracking::kProgress;
        scheduler.progress.source = config::ProgressSource::kKernel;
    }
    return scheduler;
}

/// @returns a tool that gates do not go with; null: there is none, or none is asked for
const char* tool_against_gates(const config::Scheduler& scheduler) {
    const bool has_gates = scheduler.dispatch.where != config::Dispatch::kThread;
    return has_gates ? serialising_tool(tool_signs()) : nullptr;
}

}  // namespace

Common::Common(const config::ResolvedConfig& resolved, const exec::DriverApi& its_driver,
               Clock& its_clock, TraceOptions trace, const observe::ShareOptions& share,
               const observe::RecordOptions& record)
    : launches_block(do_launches_block()),
      scheduler(config::paced_by_tracking(
          tracked_while_blocking(resolved.config.scheduler, launches_block))),
      driver(its_driver),
      clock(its_clock),
      guard(resolved.config),
      status(share, resolved.config, clock.now(), resolved.profile ? &*resolved.profile : nullptr),
      observers{.records = RunRecords(record, share, status, resolved.config),
                .causes = FrameCauses(roster, governor, clock),
                .nvtx = {}},
      progress(scheduler.progress.tracking, clock, page(), governor, roster, observers.records),
      governor(scheduler, resolved.config.chains, resolved.config.mode, page(), progress,
               clock.now()),
      roster(resolved, scheduler.progress.learn, page(), governor.tasks()),
      streams(driver, governor.tasks()),
      marks(driver,
            config::choose_source(follows_marks() ? scheduler.progress.source
                                                  : config::ProgressSource::kKernel),
            nullptr, marks_all(), roster.tasks().size()),
      gate_keeper(scheduler, {launches_block, tool_against_gates(scheduler)},
                  {driver, clock, page(), governor, progress, roster, observers.records,
                   &observers.nvtx, &nice}),
      kernels(driver, trace.writer),
      tracer(trace, driver, clock, marks, kernels.graphs()),
      nice(resolved.config.nice) {
    observers.causes.take_roster();
    guard.tell([this](std::size_t chain, sched::GuardMode mode) {
        observers.records.guard(*roster.chains()[chain], mode, clock.now());
    });
    for (const auto& task : roster.tasks())
        kernels.add_task(task->index, task->known_by.config.kernels);
    if (roster.has_graphs()) kernels.look_into_graphs();
    progress.show_to(observers.nvtx);
    marks.use(gate_keeper.dispatcher());
    governor.plan().reckon_load();
}

}  // namespace urgengo::runtime
