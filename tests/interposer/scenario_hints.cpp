// SPDX-License-Identifier: Apache-2.0
//
// The hint API: a program that gives hints does the same with and without UrgenGo. What the hints
// answer may differ (tokens, status); that is not said, but used.
#include <time.h>
#include <urgengo/urgengo.h>

#include <thread>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

std::int64_t now_ns(clockid_t clock) {
    timespec t;
    clock_gettime(clock, &t);
    return t.tv_sec * std::int64_t{1'000'000'000} + t.tv_nsec;
}

/// One task of one instance, on a stream of its own.
void run_task(const Gpu& gpu, const ug_hints& hints, ug_instance instance, const char* task,
              CUstream stream, std::uint64_t* to, std::uint64_t value) {
    errno = kErrno;
    const int verdict = hints.task_begin(instance, task);
    say("%s: verdict %d, errno %d", task, verdict, errno);
    SHOW(launch_wide(gpu.wide, stream));
    SHOW(launch_store(gpu.store, to, value, stream));
    ug_position_t position = {};
    position.size = sizeof(position);
    errno = kErrno;
    hints.position("hinted", task, &position);
    say("errno %d", errno);
    SHOW(cuStreamSynchronize(stream));
    SHOW(launch_tiny(gpu.tiny, stream));  // a second GPU segment
    SHOW(cuStreamSynchronize(stream));
    errno = kErrno;
    hints.task_end();
    say("%d, errno %d", int(to[0]), errno);
}

ug_instance arrive(const ug_hints& hints, const char* chain, std::int64_t when, int clock) {
    errno = kErrno;
    const ug_instance instance = hints.arrival(chain, when, clock);
    say("arrival: errno %d", errno);
    return instance;
}

int hints(const Arguments&) {
    ug_hints hints;
    ug_hints_load(&hints);
    const Gpu gpu;
    const CUstream stream = make_stream(), other = make_stream();
    std::uint64_t* to = make_mapped(2);

    ug_position_t position = {};
    position.size = sizeof(position);
    errno = kErrno;
    say("%d, errno %d", hints.position("hinted", "front", &position), errno);
    hints.task_end();  // before anything
    hints.task_begin(0, "front");
    const ug_instance instances[] = {
        arrive(hints, "hinted", 0, UG_CLOCK_MONOTONIC),
        arrive(hints, "hinted", now_ns(CLOCK_MONOTONIC) - 1'000'000, UG_CLOCK_MONOTONIC),
        arrive(hints, "hinted", now_ns(CLOCK_REALTIME) - 1'000'000, UG_CLOCK_REALTIME),
        arrive(hints, "hinted", 1, UG_CLOCK_MONOTONIC),  // long past its deadline
        arrive(hints, "no such chain", 0, UG_CLOCK_MONOTONIC),
        arrive(hints, nullptr, 0, UG_CLOCK_MONOTONIC),
    };
    std::uint64_t value = 80;
    for (ug_instance instance : instances) {
        run_task(gpu, hints, instance, "front", stream, to, value++);
        std::thread([&] {
            MUST(cuCtxSetCurrent(gpu.context));
            run_task(gpu, hints, instance, "back", other, to, value++);
        }).join();
    }
    // Not as one should: unknown tasks, old tokens, a task in a task, ends without begins.
    const ug_instance last = arrive(hints, "hinted", 0, 77);
    say("%d", hints.task_begin(last, "no such task"));
    say("%d", hints.task_begin(last, nullptr));
    say("%d", hints.task_begin(instances[0], "back"));
    say("%d", hints.task_begin(~ug_instance{0}, "back"));
    say("%d", hints.task_begin(last, "front"));
    say("%d", hints.task_begin(last, "back"));
    SHOW(launch_tiny(gpu.tiny, nullptr));
    hints.task_end();
    hints.task_end();
    for (int i = 0; i < 1000; ++i) hints.arrival("hinted", 0, UG_CLOCK_MONOTONIC);
    // A thread that ends inside its task.
    std::thread([&] {
        MUST(cuCtxSetCurrent(gpu.context));
        hints.task_begin(arrive(hints, "hinted", 0, UG_CLOCK_MONOTONIC), "front");
        SHOW(launch_tiny(gpu.tiny, other));
    }).join();
    run_task(gpu, hints, arrive(hints, "hinted", 0, UG_CLOCK_MONOTONIC), "front", stream, to, 99);
    return 0;
}

const Scenario s1("hints", hints);

}  // namespace
}  // namespace twin
