// SPDX-License-Identifier: Apache-2.0
//
// The life of the process: none of it CUDA, fork, exec, and every way to end.
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

int no_cuda(const Arguments&) {
    say("no CUDA here");
    return 0;
}

int init(const Arguments&) {
    SHOW(cuInit(0));
    int version = 0, count = -1;
    SHOW(cuDriverGetVersion(&version));
    SHOW(cuDeviceGetCount(&count));
    say("version %d, devices %d", version, count);
    SHOW(cuStreamSynchronize(nullptr));
    SHOW(cuCtxSynchronize());
    SHOW(launch_tiny(nullptr, nullptr));
    void* function = nullptr;
    SHOW(cuGetProcAddress("cuLaunchKernel", &function, 12000, 0, nullptr));
    return 0;
}

// Waits for the child and says how it ended.
void say_end_of(pid_t child) {
    int status = 0;
    if (waitpid(child, &status, 0) != child) give_up("waitpid", errno);
    say("child: exited %d with %d, signal %d", WIFEXITED(status), WEXITSTATUS(status),
        WIFSIGNALED(status) ? WTERMSIG(status) : 0);
}

void in_child() {
    int version = 0;
    const char* name = nullptr;
    SHOW(cuDriverGetVersion(&version));
    SHOW(cuGetErrorName(CUDA_ERROR_NOT_INITIALIZED, &name));
    say("child: %d %s", version, name ? name : "-");
    SHOW(launch_tiny(nullptr, nullptr));
    SHOW(cuCtxSynchronize());
}

// Forks while work is under way, before and after the first launch.
int fork_(const Arguments&) {
    const Gpu gpu;
    for (int i = 0; i < 2; ++i) {
        if (i == 1) SHOW(launch_wide(gpu.wide, nullptr));
        std::fflush(stdout);
        const pid_t child = fork();
        if (child == 0) {
            in_child();
            std::exit(6);
        }
        say_end_of(child);
        SHOW(launch_wide(gpu.wide, nullptr));
        SHOW(cuCtxSynchronize());
    }
    return 0;
}

// The parent leaves nothing behind; whatever is written then was written by the child.
int fork_and_leave(const Arguments&) {
    const Gpu gpu;
    SHOW(launch_wide(gpu.wide, nullptr));
    SHOW(cuCtxSynchronize());
    std::fflush(stdout);
    const pid_t child = fork();
    if (child == 0) std::exit(0);
    say_end_of(child);
    std::fflush(stdout);
    _exit(0);
}

int exec(const Arguments&) {
    const Gpu gpu;
    SHOW(launch_wide(gpu.wide, nullptr));
    SHOW(cuCtxSynchronize());
    std::fflush(stdout);
    std::string path = own_path(), scenario = "copies";
    char* arguments[] = {path.data(), scenario.data(), nullptr};
    execv(path.c_str(), arguments);
    give_up("execv", errno);
}

void leave_work_pending(const Gpu& gpu) {
    const CUstream stream = make_stream();
    const CUfunction very_long = gpu.function("very_long");
    for (int i = 0; i < 5; ++i) SHOW(launch_wide(very_long, stream));
    SHOW(launch_tiny(gpu.tiny, nullptr));
}

int exit_pending(const Arguments&) {
    static Gpu* const gpu = new Gpu;  // not released: the process ends with the work under way
    leave_work_pending(*gpu);
    std::exit(3);
}

int exit_at_once(const Arguments&) {
    static Gpu* const gpu = new Gpu;
    leave_work_pending(*gpu);
    std::fflush(stdout);
    _exit(4);
}

// Ends while other threads launch, held or not.
int exit_busy(const Arguments&) {
    static Gpu* const gpu = new Gpu;
    static std::atomic<int> num_running{0};
    for (int t = 0; t < 3; ++t)
        std::thread([t] {
            name_this_thread("twin_" + std::to_string(t));
            MUST(cuCtxSetCurrent(gpu->context));
            const CUstream stream = make_stream();
            for (int round = 0;; ++round) {
                for (int i = 0; i < 5; ++i) launch_wide(gpu->wide, stream);
                cuStreamSynchronize(stream);
                if (round == 0) ++num_running;  // its first launch may take long
            }
        }).detach();
    while (num_running < 3) usleep(1000);
    usleep(10'000);
    say("enough");
    std::exit(5);
}

// Calls from where a library's destructor would make them.
int calls_at_exit(const Arguments&) {
    static Gpu* const gpu = new Gpu;
    std::atexit([] {
        SHOW(launch_tiny(gpu->tiny, nullptr));
        SHOW(cuCtxSynchronize());
        SHOW(cuModuleUnload(gpu->module));
    });
    SHOW(launch_tiny(gpu->tiny, nullptr));
    SHOW(cuCtxSynchronize());
    return 0;
}

const Scenario s1("no_cuda", no_cuda), s2("init", init), s3("fork", fork_),
    s4("fork_and_leave", fork_and_leave), s5("exec", exec), s6("exit_pending", exit_pending),
    s7("exit_at_once", exit_at_once), s8("exit_busy", exit_busy),
    s9("calls_at_exit", calls_at_exit);

}  // namespace
}  // namespace twin
