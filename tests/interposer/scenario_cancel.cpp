// SPDX-License-Identifier: Apache-2.0
//
// pthread_cancel of a thread that is inside a CUDA call: its stack unwinds through the call, and
// the program goes on.
#include <pthread.h>
#include <unistd.h>

#include <atomic>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

constexpr useconds_t kLongEnough = 20'000;  // for the other thread to get into the call, us

struct Worker {
    const Gpu* gpu;
    CUstream stream;
    std::uint64_t* flag;
    std::atomic<int> launches{0};
    std::atomic<bool> ready{false};
    std::atomic<int> unwound{0};
};

struct CountsUnwinding {
    std::atomic<int>& count;
    ~CountsUnwinding() { ++count; }
};

void* run(void* argument) {
    auto& worker = *static_cast<Worker*>(argument);
    name_this_thread("twin_1");
    MUST(cuCtxSetCurrent(worker.gpu->context));
    const CountsUnwinding counts{worker.unwound};
    MUST(cuStreamWaitValue32(worker.stream, on_gpu(worker.flag), 1, CU_STREAM_WAIT_VALUE_GEQ));
    worker.ready = true;
    MUST(launch_wide(worker.gpu->wide, worker.stream));
    ++worker.launches;
    cuStreamSynchronize(worker.stream);
    return nullptr;
}

void cancel(Worker& worker) {
    pthread_t thread;
    MUST(pthread_create(&thread, nullptr, run, &worker));
    while (!worker.ready) usleep(100);
    usleep(kLongEnough);
    MUST(pthread_cancel(thread));
    void* result = nullptr;
    MUST(pthread_join(thread, &result));
    say("canceled %d, unwound %d, launches %d", result == PTHREAD_CANCELED, worker.unwound.load(),
        worker.launches.load());
}

void go_on(const Gpu& gpu, CUstream stream) {
    std::uint64_t* to = make_mapped(2);
    SHOW(launch_store(gpu.store, to, 33, stream));
    SHOW(cuStreamSynchronize(stream));
    say("%d", int(to[0]));
}

// Cancelled while it waits for work that does not end before we say so.
int cancel_waiting(const Arguments&) {
    const Gpu gpu;
    for (int i = 0; i < 2; ++i) {
        Worker worker{&gpu, make_stream(), make_mapped(1)};
        cancel(worker);
        *worker.flag = 1;
        go_on(gpu, worker.stream);
    }
    return 0;
}

// Cancelled while a more urgent task has the GPU: UrgenGo may be holding the launch.
int cancel_held(const Arguments&) {
    const Gpu gpu;
    const CUstream own = make_stream();
    const CUfunction very_long = gpu.function("very_long");
    Worker worker{&gpu, make_stream(), make_mapped(1)};
    SHOW(launch_wide(very_long, own));
    SHOW(launch_wide(very_long, own));
    cancel(worker);
    *worker.flag = 1;
    SHOW(cuStreamSynchronize(own));
    go_on(gpu, worker.stream);
    go_on(gpu, own);
    return 0;
}

// A real driver need not have a cancellation point where it waits.
const Scenario s1("cancel_waiting", cancel_waiting, Runs::kSimulated),
    s2("cancel_held", cancel_held, Runs::kSimulated);

}  // namespace
}  // namespace twin
