// SPDX-License-Identifier: Apache-2.0
//
// A program with a time limit of its own on launches: a signal's handler jumps out of one that
// takes long, and the program goes on. "urgent" fills the GPU, so that only UrgenGo has "loose"
// wait in a launch; a driver's launch is not jumped out of.
#include <csetjmp>
#include <csignal>

#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

/// Alarms in one launch: a thread that was off its core gets one for all that it has missed.
constexpr int kAlarms = 3;
constexpr long kBetweenAlarms_ns = 500'000;
/// Fewer than fill the driver's queue, which would have a launch wait, too.
constexpr int kLaunches = 100, kLaunchesAfter = 20, kUrgentLaunches = 400;

sigjmp_buf g_before_launch;
volatile std::sig_atomic_t g_alarms = -1;  // in the launch at hand; -1: there is none

void on_alarm(int) {
    if (g_alarms < 0) return;
    g_alarms = g_alarms + 1;
    if (g_alarms < kAlarms) return;
    g_alarms = -1;
    siglongjmp(g_before_launch, 1);
}

/// Signals of its own to the calling thread: SIGALRM ends a twin that hangs.
class Alarms {
  public:
    Alarms() {
        std::signal(SIGUSR1, on_alarm);
        sigevent event{};
        event.sigev_notify = SIGEV_THREAD_ID;
        event.sigev_signo = SIGUSR1;
        event._sigev_un._tid = static_cast<int>(syscall(SYS_gettid));
        timer_create(CLOCK_MONOTONIC, &event, &timer_);
        const timespec every{0, kBetweenAlarms_ns};
        const itimerspec times{every, every};
        timer_settime(timer_, 0, &times, nullptr);
    }
    ~Alarms() { timer_delete(timer_); }
    Alarms(const Alarms&) = delete;
    Alarms& operator=(const Alarms&) = delete;

  private:
    timer_t timer_{};
};

/// Not inlined: what lives across the jump is not kept in registers.
[[gnu::noinline]] CUresult launch_or_jump(CUfunction kernel, CUstream stream) {
    if (sigsetjmp(g_before_launch, 1) != 0) return CUDA_SUCCESS;
    g_alarms = 0;
    const CUresult result = launch_wide(kernel, stream);
    g_alarms = -1;
    return result;
}

int jumps(const Arguments&) {
    const Gpu gpu;
    std::atomic<bool> go{true};
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_BLOCK, &all, &before);
    std::thread urgent([&] {
        name_this_thread("urgent");
        MUST(cuCtxSetCurrent(gpu.context));
        const CUstream stream = make_stream();
        while (go) {
            for (int i = 0; i < kUrgentLaunches && go; ++i) MUST(launch_wide(gpu.wide, stream));
            MUST(cuStreamSynchronize(stream));
        }
    });
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
    name_this_thread("loose");
    const CUstream stream = make_stream();
    MUST(launch_tiny(gpu.tiny, stream));  // the first one loads, which takes long
    MUST(cuStreamSynchronize(stream));
    {
        const Alarms alarms;
        for (int i = 0; i < kLaunches; ++i) {
            MUST(launch_or_jump(gpu.wide, stream));
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        }
    }
    go = false;
    urgent.join();
    for (int i = 0; i < kLaunchesAfter; ++i) MUST(launch_tiny(gpu.tiny, stream));
    MUST(cuStreamSynchronize(stream));
    say("and it goes on");
    return 0;
}

const Scenario s1("jumps", jumps);

}  // namespace
}  // namespace twin
