// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/common.h"

#include <sys/mman.h>

#include <cstdlib>
#include <new>

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
        scheduler.tracking = config::Tracking::kProgress;
        scheduler.progress_source = config::ProgressSource::kKernel;
    }
    return scheduler;
}

// Shared: pages that the GPU writes to must not be copied when the program forks.
OwnedPage make_page() {
    void* memory = mmap(nullptr, sizeof(abi::SharedPage), PROT_READ | PROT_WRITE,
                        MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) throw std::bad_alloc();
    OwnedPage page(new (memory) abi::SharedPage());
    page->magic = abi::kSharedPageMagic;
    page->version = abi::kSharedPageVersion;
    page->slot_bytes = sizeof(abi::TaskSlot);
    return page;
}

}  // namespace

void UnmapPage::operator()(abi::SharedPage* page) const {
    munmap(page, sizeof *page);
}

Common::Common(const config::ResolvedConfig& resolved, const exec::DriverApi& its_driver,
               Clock& its_clock, TraceOptions trace)
    : launches_block(do_launches_block()),
      scheduler(config::paced_by_tracking(
          tracked_while_blocking(resolved.config.scheduler, launches_block))),
      marks_all(scheduler.mark_every == nanoseconds{0}),
      driver(its_driver),
      clock(its_clock),
      guard(resolved.config),
      page(make_page()),
      progress(scheduler.tracking, clock, *page, governor, roster),
      governor(scheduler, resolved.config.chains, resolved.config.mode, *page, progress,
               clock.now()),
      roster(resolved, scheduler.learn, *page, governor.tasks()),
      streams(driver, governor.tasks()),
      marks(driver,
            config::choose_source(follows_marks() ? scheduler.progress_source
                                                  : config::ProgressSource::kKernel),
            nullptr, marks_all, roster.tasks().size()),
      gate_keeper(scheduler, launches_block, {driver, clock, *page, governor, progress, roster}),
      kernels(driver, trace.writer),
      tracer(trace, driver, clock, marks, kernels.graphs()) {
    for (const auto& task : roster.tasks())
        kernels.add_task(task->index, task->known_by.config.kernels);
    if (roster.has_graphs()) kernels.look_into_graphs();
    marks.use(gate_keeper.dispatcher());
    governor.plan().reckon_load();
}

}  // namespace urgengo::runtime
