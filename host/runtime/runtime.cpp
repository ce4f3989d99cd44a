// SPDX-License-Identifier: Apache-2.0
//
// Construction from the config.
#include "host/runtime/runtime.h"

namespace urgengo::runtime {

Runtime::Runtime(const config::ResolvedConfig& resolved, const exec::DriverApi& driver,
                 Clock& clock, TraceOptions trace, std::uint64_t test_holds)
    : common_(resolved, driver, clock, trace),
      segments_(common_),
      random_holds_(test_holds),
      cheap_waits_(resolved.config.blocking_sync, driver, clock, common_.streams.captures(),
                   common_.governor),
      report_({clock, common_.governor, common_.guard, instances_, names_, common_.roster.chains(),
               common_.roster.tasks()}),
      copies_(common_.scheduler, resolved.config.chains.size() > 1 && !common_.launches_block,
              {driver, clock, common_.streams.captures(), common_.marks, common_.governor,
               common_.guard, common_.roster.tasks()},
              *this) {
    for (const auto& chain : common_.roster.chains()) instances_.add_chain(*chain);
    for (const auto& task : common_.roster.tasks())
        names_.add_task(task->index, task->known_by.config,
                        task->chain->config.mode == config::Mode::kOff);
}

void Runtime::graph_instantiated(CUgraphExec executable, CUgraph graph) {
    if (common_.mode() == config::Mode::kOff || !common_.kernels.looks_into_graphs()) return;
    const exec::RelaxedCaptureMode relaxed(common_.driver);
    // How much of the GPU it takes is learned while profiling.
    common_.kernels.graph_instantiated(executable, graph,
                                       common_.tracer.is_on() ? common_.marks.prepare() : nullptr);
}

}  // namespace urgengo::runtime
