// SPDX-License-Identifier: Apache-2.0
//
// The hint functions of include/urgengo/urgengo.h, as programs find them with dlsym.
#include <urgengo/urgengo.h>

#include "host/model/arrival_stamp.h"
#include "interposer/boundary.h"
#include "interposer/own_time.h"

using namespace urgengo::interposer;
using std::chrono::nanoseconds;

namespace {

nanoseconds to_monotonic(int64_t time_ns, int clock) {
    const nanoseconds now = urgengo::monotonic_now();
    if (time_ns == 0) return now;
    if (clock != UG_CLOCK_REALTIME) return nanoseconds(time_ns);
    timespec wall;
    clock_gettime(CLOCK_REALTIME, &wall);
    return urgengo::model::convert_stamp(
        time_ns, std::chrono::seconds(wall.tv_sec) + nanoseconds(wall.tv_nsec), now);
}

}  // namespace

extern "C" {

__attribute__((visibility("default"))) ug_instance ug_arrival(const char* chain, int64_t arrival_ns,
                                                              int clock) {
    ug_instance instance = 0;
    if (!chain || !acts()) return instance;
    OwnTime::frame_begins();
    const OwnTime own_time(CallClass::kOther);
    const Inside inside;  // another NVTX tool that is told may call the driver
    protect([&] {
        instance =
            the_runtime().frames().arrival(this_thread(), chain, to_monotonic(arrival_ns, clock));
    });
    return instance;
}

__attribute__((visibility("default"))) int ug_task_begin(ug_instance instance, const char* task) {
    bool exit_chain = false;
    if (!instance || !task || !acts_already()) return UG_CONTINUE;
    const OwnTime own_time(CallClass::kOther);
    const Inside inside;
    protect([&] {
        if (auto* thread = this_thread())
            exit_chain = the_runtime().frames().task_begin(*thread, instance, task);
    });
    return exit_chain ? UG_EXIT_CHAIN : UG_CONTINUE;
}

__attribute__((visibility("default"))) void ug_task_end(void) {
    if (!acts_already()) return;
    const OwnTime own_time(CallClass::kOther);
    const Inside inside;
    protect([] {
        if (auto* thread = this_thread()) the_runtime().frames().task_end(*thread);
    });
}

__attribute__((visibility("default"))) int ug_status(void) {
    if (!is_armed()) return 0;
    switch (the_runtime().mode()) {
        case urgengo::abi::StatusMode::kEnforce:
            return 1;
        case urgengo::abi::StatusMode::kObserve:
        case urgengo::abi::StatusMode::kShadow:
            return 2;
        default:
            break;
    }
    return 0;
}

__attribute__((visibility("default"))) int ug_position(const char* chain, const char* task,
                                                       ug_position_t* out) {
    bool known = false;
    if (chain && task && out && out->size >= sizeof(ug_position_t) && is_armed())
        protect([&] {
            const auto found = the_runtime().progress().position(chain, task);
            known = found.has_value();
            if (!known) return;
            const auto& at = found->at;
            out->busy = at.busy;
            out->launch = at.position;
            out->instance = at.instance;
            out->overdue = at.overdue;
            out->remaining_ns = found->remaining.count();
            out->unexecuted_ns = at.unexecuted.count();
            out->uncertain_ns = at.uncertain.count();
        });
    return known;
}

}  // extern "C"
