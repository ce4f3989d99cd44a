// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/runtime.h"

namespace urgengo::runtime {

Runtime::Runtime(const config::ResolvedConfig& resolved, const exec::DriverApi& driver,
                 Clock& clock, TraceOptions trace, std::uint64_t test_holds,
                 const observe::ShareOptions& share, const observe::RecordOptions& record)
    : common_(resolved, driver, clock, trace, share, record),
      segments_(common_),
      syncs_(common_),
      runs_(common_, segments_, syncs_),
      frames_(common_, runs_),
      reloading_(common_, resolved),
      steering_(common_, runs_, frames_.instances(), reloading_),
      work_on_streams_(common_, runs_),
      resolver_(common_, runs_, frames_, work_on_streams_),
      waits_(common_, {segments_, syncs_, runs_, frames_, work_on_streams_, resolver_},
             resolved.config.blocking_sync),
      planned_(common_, segments_, runs_),
      gates_(common_, segments_),
      launches_(common_, {segments_, syncs_, runs_, work_on_streams_, resolver_, planned_, gates_},
                test_holds),
      report_({clock, common_.governor, common_.guard, frames_.instances(), resolver_.names(),
               common_.roster.chains(), common_.roster.tasks(), &common_.observers.causes,
               &common_.gate_keeper.cores(), resolved.config.nice.has_value()}),
      copies_(common_.scheduler, resolved.config.chains.size() > 1 && !common_.launches_block,
              {driver, clock, common_.streams.captures(), common_.marks, common_.governor,
               common_.guard, common_.roster.tasks(), common_.observers.records},
              resolver_) {}

void Runtime::graph_instantiated(CUgraphExec executable, CUgraph graph) {
    if (common_.mode() == config::Mode::kOff || !common_.kernels.looks_into_graphs()) return;
    const exec::RelaxedCaptureMode relaxed(common_.driver);
    // How much of the GPU it takes is learned while profiling.
    common_.kernels.graph_instantiated(executable, graph,
                                       common_.tracer.is_on() ? common_.marks.prepare() : nullptr);
}

void Runtime::show_in_nvtx(std::unique_ptr<observe::NvtxLink> link) {
    std::vector<std::string> names;
    for (const auto& task : common_.roster.tasks()) names.push_back(task->name());
    common_.observers.nvtx.attach(
        std::move(link),
        {common_.governor.tasks(), common_.progress.gpu_clock(), std::move(names)});
}

void Runtime::jumped_out_of_hold(ThreadState& thread) {
    if (runs_.jumped_out_of_hold(thread)) report_.jumped();
}

void Runtime::thread_exit(ThreadState& thread) {
    runs_.thread_ends(thread);
    frames_.leave_task(thread);
    common_.tracer.thread_ends(thread);
    common_.streams.thread_ends();
    common_.nice.thread_ends();
    common_.observers.records.thread_ends();
}

}  // namespace urgengo::runtime
