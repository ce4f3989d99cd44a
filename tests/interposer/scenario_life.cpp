// SPDX-License-Identifier: Apache-2.0
//
// Lives of contexts, threads and processes that end while others are in the middle of something,
// and programs that hardly begin.
#include <pthread.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <thread>
#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

extern char** environ;

namespace twin {
namespace {

constexpr useconds_t kLongEnough = 15'000;  // for another thread to get into a call, us

void work(const Gpu& gpu, CUstream stream, std::uint64_t value) {
    std::uint64_t* to = make_mapped(2);
    for (int i = 0; i < 4; ++i) SHOW(launch_wide(gpu.wide, stream));
    SHOW(launch_store(gpu.store, to, value, stream));
    SHOW(cuStreamSynchronize(stream));
    say("%d", int(to[0]));
}

// --- contexts

// Streams of a green context, which shares modules and memory with the primary one.
int green_contexts(const Arguments&) {
    const Gpu gpu;
    CUdevResource all{}, half{}, rest{};
    unsigned num_groups = 1;
    CUdevResourceDesc desc = nullptr;
    CUgreenCtx green = nullptr, found = nullptr;
    CUcontext as_context = nullptr, current = nullptr;
    SHOW(cuDeviceGetDevResource(0, &all, CU_DEV_RESOURCE_TYPE_SM));
    SHOW(cuDevSmResourceSplitByCount(&half, &num_groups, &all, &rest, 0, all.sm.smCount / 2));
    SHOW(cuDevResourceGenerateDesc(&desc, &half, 1));
    SHOW(cuGreenCtxCreate(&green, desc, 0, CU_GREEN_CTX_DEFAULT_STREAM));
    SHOW(cuCtxFromGreenCtx(&as_context, green));
    const CUstream own = make_stream(CU_STREAM_NON_BLOCKING, -1);
    CUstream stream = nullptr;
    SHOW(cuGreenCtxStreamCreate(&stream, green, CU_STREAM_NON_BLOCKING, -2));
    SHOW(cuStreamGetGreenCtx(stream, &found));
    say("its own %d", found == green);
    SHOW(cuStreamGetGreenCtx(own, &found));
    say("none %d", found == nullptr);
    // With the primary context current, and with the green one.
    for (const bool converted : {false, true}) {
        SHOW(cuCtxSetCurrent(converted ? as_context : gpu.context));
        work(gpu, stream, 10);
        SHOW(launch_wide(gpu.wide, own));
        work(gpu, converted ? nullptr : own, 11);
        SHOW(cuCtxGetCurrent(&current));
        say("current %d", current == (converted ? as_context : gpu.context));
        int priority = 0;
        SHOW(cuStreamGetPriority(stream, &priority));
        say("priority %d", priority);
    }
    SHOW(launch_wide(gpu.wide, stream));
    SHOW(cuCtxSetCurrent(gpu.context));
    SHOW(cuCtxSynchronize());
    SHOW(cuStreamQuery(stream));  // the primary context's wait was for this too
    SHOW(launch_wide(gpu.wide, stream));
    SHOW(cuGreenCtxDestroy(green));
    if (simulated()) SHOW(launch_wide(gpu.wide, stream));  // else undefined
    work(gpu, own, 12);
    return 0;
}

// A context goes while another thread is in a launch there: held, if it is. How that launch ends
// depends on who comes first, with UrgenGo and without.
int destroyed_held(const Arguments&) {
    const Gpu gpu;
    const CUstream own = make_stream();
    const CUfunction very_long = gpu.function("very_long");
    for (int round = 0; round < 3; ++round) {
        const CUcontext other = make_context();
        CUmodule module = nullptr;
        CUfunction wide = nullptr;
        MUST(cuModuleLoadData(&module, kImage));
        MUST(cuModuleGetFunction(&wide, module, "wide"));
        const CUstream there = make_stream();
        MUST(cuCtxPopCurrent(nullptr));
        for (int i = 0; i < 2; ++i) SHOW(launch_wide(very_long, own));
        std::atomic<int> launches{0};
        std::atomic<bool> ready{false};
        std::thread worker([&] {
            name_this_thread("twin_1");
            MUST(cuCtxSetCurrent(other));
            ready = true;
            for (int i = 0; i < 4; ++i, ++launches) launch_wide(wide, there);
        });
        while (!ready) std::this_thread::yield();
        usleep(kLongEnough);
        SHOW(cuCtxDestroy(other));
        worker.join();
        say("launches %d", launches.load());
        SHOW(launch_wide(wide, there));
        SHOW(cuStreamSynchronize(own));
        work(gpu, own, 20 + std::uint64_t(round));
    }
    return 0;
}

// The device is reset under two threads that launch, one of which may be held; then all is begun
// anew, by them too.
int reset_busy(const Arguments&) {
    for (int round = 0; round < 2; ++round) {
        const Gpu gpu;
        const CUstream own = make_stream();
        std::atomic<int> num_frames{0};
        std::vector<std::thread> threads;
        for (int t = 1; t < 3; ++t)
            threads.emplace_back([&, t] {
                name_this_thread("twin_" + std::to_string(t));
                MUST(cuCtxSetCurrent(gpu.context));
                const CUstream stream = make_stream();
                CUresult result = CUDA_SUCCESS;
                for (; result == CUDA_SUCCESS; ++num_frames) {
                    for (int i = 0; i < 4 && result == CUDA_SUCCESS; ++i)
                        result = launch_wide(gpu.wide, stream);
                    if (result == CUDA_SUCCESS) result = cuStreamSynchronize(stream);
                }
            });
        while (num_frames < 10) std::this_thread::yield();
        SHOW(launch_wide(gpu.function("very_long"), own));
        SHOW(cuDevicePrimaryCtxReset(0));
        for (std::thread& thread : threads) thread.join();
        SHOW(launch_wide(gpu.wide, own));
        const Gpu again;
        work(again, make_stream(), 30 + std::uint64_t(round));
        SHOW(launch_wide(again.wide, nullptr));
        SHOW(cuCtxSynchronize());
    }
    return 0;
}

// --- threads

struct AtThreadEnd {
    const Gpu* gpu;
    std::uint64_t* word;
    int num_left;
    pthread_key_t key;
};

std::atomic<int> g_sum{0};

// Calls from a thread that is ending, once more in each of the rounds that the system allows.
void at_thread_end(void* argument) {
    auto& its = *static_cast<AtThreadEnd*>(argument);
    g_sum += launch_wide(its.gpu->wide, nullptr);
    g_sum += launch_store(its.gpu->store, its.word, std::uint64_t(its.num_left), nullptr);
    g_sum += cuStreamSynchronize(nullptr);
    if (--its.num_left > 0) pthread_setspecific(its.key, argument);
}

int thread_ends(const Arguments&) {
    const Gpu gpu;
    pthread_key_t before = 0, after = 0;
    MUST(pthread_key_create(&before, at_thread_end));
    SHOW(launch_wide(gpu.wide, nullptr));
    SHOW(cuCtxSynchronize());
    MUST(pthread_key_create(&after, at_thread_end));
    std::uint64_t* word = make_mapped(4);
    for (int round = 0; round < 3; ++round) {
        AtThreadEnd first{&gpu, word, 3, before}, second{&gpu, word + 2, 3, after};
        const CUstream own = make_stream();
        SHOW(launch_wide(gpu.function("very_long"), own));
        std::thread([&] {
            name_this_thread("twin_1");
            MUST(cuCtxSetCurrent(gpu.context));
            pthread_setspecific(before, &first);
            pthread_setspecific(after, &second);
            g_sum += launch_wide(gpu.wide, nullptr);  // held, if launches are, and not waited for
            // Ends here, by unwinding.
            if (round > 0) pthread_exit(nullptr);
        }).join();
        say("left %d %d, sum %d, words %d %d", first.num_left, second.num_left, g_sum.load(),
            int(word[0]), int(word[2]));
    }
    SHOW(cuCtxSynchronize());
    return 0;
}

// --- processes

// Apart from what uses its answer: what a vforked child runs shares this frame with its parent.
[[gnu::noinline]] pid_t run_by_vfork(const char* path, char* const* arguments) {
    const pid_t child = vfork();
    if (child == 0) {
        execv(path, arguments);
        _exit(9);
    }
    return child;
}

// A child that runs this program, in a way that runs no handler of ours at its fork.
int children(const Arguments&) {
    const Gpu gpu;
    const CUstream own = make_stream();
    std::string path = own_path(), scenario = "order";
    char* arguments[] = {path.data(), scenario.data(), nullptr};
    for (const bool by_vfork : {false, true}) {
        for (int i = 0; i < 3; ++i) SHOW(launch_wide(gpu.wide, own));
        std::fflush(stdout);
        pid_t child = 0;
        if (by_vfork)
            child = run_by_vfork(path.c_str(), arguments);
        else
            MUST(posix_spawn(&child, path.c_str(), nullptr, nullptr, arguments, environ));
        int status = 0;
        if (waitpid(child, &status, 0) != child) give_up("waitpid", errno);
        say("child exited %d with %d", WIFEXITED(status), WEXITSTATUS(status));
        work(gpu, own, 40);
    }
    return 0;
}

// Another thread than the main one executes a program, while the main one launches.
int exec_from_thread(const Arguments&) {
    static Gpu* const gpu = new Gpu;
    work(*gpu, make_stream(), 50);
    std::fflush(stdout);
    std::thread([] {
        name_this_thread("twin_2");
        MUST(cuCtxSetCurrent(gpu->context));
        const CUstream stream = make_stream();
        for (int i = 0; i < 5; ++i) MUST(launch_wide(gpu->wide, stream));
        std::string path = own_path(), scenario = "order";
        char* arguments[] = {path.data(), scenario.data(), nullptr};
        execv(path.c_str(), arguments);
        give_up("execv", errno);
    }).detach();
    const CUstream own = make_stream();
    while (true) {
        launch_wide(gpu->wide, own);
        cuStreamSynchronize(own);
    }
}

int quick_exit_(const Arguments&) {
    static Gpu* const gpu = new Gpu;
    std::at_quick_exit([] {
        SHOW(launch_wide(gpu->wide, nullptr));
        SHOW(cuCtxSynchronize());
        std::fflush(stdout);
    });
    work(*gpu, make_stream(), 60);
    SHOW(launch_wide(gpu->function("very_long"), nullptr));
    std::quick_exit(7);
}

// Handlers from before the first call and from after it, so one runs on each side of whatever a
// library of the driver's registered meanwhile.
int exit_order(const Arguments&) {
    static Gpu* gpu = nullptr;
    std::atexit([] {
        say("the first handler, last");
        SHOW(launch_wide(gpu->wide, nullptr));
        SHOW(cuCtxSynchronize());
        SHOW(cuDevicePrimaryCtxRelease(0));
        SHOW(launch_wide(gpu->wide, nullptr));
    });
    gpu = new Gpu;
    work(*gpu, make_stream(), 70);
    std::atexit([] {
        say("the second handler, first");
        work(*gpu, make_stream(), 71);
        SHOW(launch_wide(gpu->function("very_long"), nullptr));
    });
    std::exit(8);
}

// --- hardly any CUDA

int no_init(const Arguments&) {
    int count = -1;
    const char* text = nullptr;
    CUcontext context = nullptr;
    SHOW(cuDeviceGetCount(&count));
    SHOW(cuGetErrorString(CUDA_ERROR_NOT_INITIALIZED, &text));
    say("%s", text ? text : "-");
    SHOW(cuCtxGetCurrent(&context));
    SHOW(cuDevicePrimaryCtxRetain(&context, 0));
    return 0;
}

int only_queries(const Arguments&) {
    SHOW(cuInit(0));
    int count = 0, major = 0, minor = 0, active = 0;
    unsigned flags = 0;
    char name[100] = "";
    SHOW(cuDeviceGetCount(&count));
    SHOW(cuDeviceGetName(name, sizeof name, 0));
    SHOW(cuDeviceGetAttribute(&major, CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR, 0));
    SHOW(cuDeviceGetAttribute(&minor, CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR, 0));
    SHOW(cuDevicePrimaryCtxGetState(0, &flags, &active));
    say("%d '%s' %d.%d, primary context active %d", count, name, major, minor, active);
    return 0;
}

// UrgenGo needs one for what it keeps of each thread.
int without_thread_keys(const Arguments&) {
    const Gpu gpu;
    pthread_key_t key;
    while (pthread_key_create(&key, nullptr) == 0) {
    }
    work(gpu, make_stream(), 10);
    return 0;
}

// With CUDA_LAUNCH_BLOCKING=1 a launch has ended when it returns, and no wait is needed.
int blocking_launches(const Arguments&) {
    const Gpu gpu;
    std::uint64_t* to = make_mapped(2);
    for (CUstream stream : {make_stream(), make_stream(CU_STREAM_DEFAULT), CUstream(nullptr)}) {
        for (std::uint64_t i = 0; i < 4; ++i) {
            SHOW(launch_wide(gpu.wide, stream));
            SHOW(launch_store(gpu.store, to, i, stream));
            say("%d", int(to[0]));
            SHOW(cuStreamQuery(stream));
        }
    }
    std::vector<std::thread> threads;
    std::vector<int> sums(3);
    for (std::size_t t = 0; t < sums.size(); ++t)
        threads.emplace_back([&, t] {
            name_this_thread("twin_" + std::to_string(t));
            MUST(cuCtxSetCurrent(gpu.context));
            const CUstream stream = make_stream();
            for (int i = 0; i < 10; ++i)
                sums[t] += launch_wide(gpu.wide, stream) + cuStreamQuery(stream);
        });
    for (std::thread& thread : threads) thread.join();
    for (const int sum : sums) say("%d", sum);
    return 0;
}

// What a real driver does with a context that goes under a launch is undefined.
const Scenario s1("green_contexts", green_contexts),
    s2("destroyed_held", destroyed_held, Runs::kSimulated),
    s3("reset_busy", reset_busy, Runs::kSimulated), s4("thread_ends", thread_ends),
    s5("children", children), s6("exec_from_thread", exec_from_thread),
    s7("quick_exit", quick_exit_), s8("exit_order", exit_order), s9("no_init", no_init),
    s10("only_queries", only_queries), s11("blocking_launches", blocking_launches),
    s12("without_thread_keys", without_thread_keys, Runs::kSimulated);

}  // namespace
}  // namespace twin
