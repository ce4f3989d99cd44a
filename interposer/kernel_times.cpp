// SPDX-License-Identifier: Apache-2.0
#include "interposer/kernel_times.h"

#include <cstring>

#include "host/exec/cupti_tracer.h"
#include "interposer/boundary.h"

namespace urgengo::interposer {
namespace {

/// Only a traced run is profiled.
bool asks_for_cupti(const Settings& settings) {
    return !settings.trace.empty() && (settings.trace_kernels == KernelTimes::kCupti ||
                                       settings.trace_kernels == KernelTimes::kAuto);
}

}  // namespace

void start_kernel_times() {
    // CUPTI calls the driver, which is us.
    if (t_this.line.inside) return;
    const Inside inside;
    protect([] {
        const Settings settings = read_settings();
        if (asks_for_cupti(settings)) exec::CuptiTracer::start(settings.cupti);
    });
}

runtime::TraceOptions kernel_times(const Settings& settings, observe::TraceWriter* writer) {
    runtime::TraceOptions options{writer, settings.trace_kernels == KernelTimes::kMarks};
    if (!writer || !asks_for_cupti(settings)) return options;
    const Inside inside;
    const auto& started = exec::CuptiTracer::start(settings.cupti);
    abi::TraceHeader& header = writer->header();
    if (started) {
        header.kernel_times = abi::TraceTimes::kCupti;
        options.cupti = *started;
        options.cupti->attach(*writer);
        return options;
    }
    options.time_kernels = settings.trace_kernels == KernelTimes::kAuto;
    if (!options.time_kernels) header.kernel_times = abi::TraceTimes::kRefused;
    std::strncpy(header.note, started.error().c_str(), sizeof header.note - 1);
    return options;
}

}  // namespace urgengo::interposer
