// SPDX-License-Identifier: Apache-2.0
#include "host/base/own_thread.h"

#include <dirent.h>
#include <fcntl.h>
#include <limits.h>
#include <link.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>

namespace urgengo {
namespace {

struct Start {
    void (*run)(void*);
    void* argument;
};

/// Blocks all signals of the calling thread for as long as the object lives.
class AllSignalsBlocked {
  public:
    AllSignalsBlocked() {
        sigset_t all;
        sigfillset(&all);
        blocked_ = pthread_sigmask(SIG_SETMASK, &all, &before_) == 0;
    }
    ~AllSignalsBlocked() {
        if (blocked_) pthread_sigmask(SIG_SETMASK, &before_, nullptr);
    }
    AllSignalsBlocked(const AllSignalsBlocked&) = delete;
    AllSignalsBlocked& operator=(const AllSignalsBlocked&) = delete;
    bool all_blocked() const { return blocked_; }

  private:
    sigset_t before_;
    bool blocked_ = false;
};

// The creator may be pinned to a core that is its own.
void run_where_the_process_may() {
    cpu_set_t cpus;
    if (sched_getaffinity(getpid(), sizeof cpus, &cpus) == 0)
        sched_setaffinity(0, sizeof cpus, &cpus);
}

/// A config read anew takes 25 KiB of it (measured: 25 MB, or nested without end).
constexpr std::size_t kStackBytes = 256 * 1024;

// The C library puts them on each thread's stack, those of libraries that are loaded later in what
// it keeps free for them: counted too often rather than not.
std::size_t thread_local_bytes() {
    std::size_t bytes = 0;
    dl_iterate_phdr(
        [](dl_phdr_info* object, std::size_t, void* sum) {
            for (int i = 0; i < object->dlpi_phnum; ++i)
                if (const auto& part = object->dlpi_phdr[i]; part.p_type == PT_TLS)
                    *static_cast<std::size_t*>(sum) += part.p_memsz + part.p_align;
            return 0;
        },
        &bytes);
    return bytes;
}

// The program's default may be 16 KiB; or 8 MiB, all of them in memory after mlockall().
std::size_t stack_bytes() {
    return std::max<std::size_t>(PTHREAD_STACK_MIN, kStackBytes) + thread_local_bytes();
}

constexpr char kName[] = "urgengo";
std::atomic<void (*)(unsigned)> g_tell{nullptr};

void* run_thread(void* argument) {
    const std::unique_ptr<Start> given(static_cast<Start*>(argument));
    const Start start = *given;
    prctl(PR_SET_NAME, kName);
    run_where_the_process_may();
    if (auto* const tell = g_tell.load()) tell(static_cast<unsigned>(gettid()));
    start.run(start.argument);
    return nullptr;
}

}  // namespace

void tell_of_own_threads(void (*tell)(unsigned id)) {
    g_tell.store(tell);
}

std::vector<unsigned> own_threads() {
    std::vector<unsigned> ids;
    DIR* const tasks = opendir("/proc/self/task");
    if (!tasks) return ids;
    while (const dirent* entry = readdir(tasks)) {
        char name[16] = {}, path[64];
        std::snprintf(path, sizeof path, "/proc/self/task/%.20s/comm", entry->d_name);
        const int file = open(path, O_RDONLY | O_CLOEXEC);
        if (file < 0) continue;
        const ssize_t length = read(file, name, sizeof name);
        close(file);
        if (length == sizeof kName && std::strncmp(name, kName, sizeof kName - 1) == 0)
            ids.push_back(static_cast<unsigned>(std::atol(entry->d_name)));
    }
    closedir(tasks);
    return ids;
}

bool start_own_thread(void (*run)(void*), void* argument) {
    pthread_attr_t attributes;
    std::unique_ptr<Start> start(new (std::nothrow) Start{run, argument});
    if (!start || pthread_attr_init(&attributes) != 0) return false;
    sched_param no_priority{};
    pthread_t thread;
    // Inherited: the signal mask; not inherited: the scheduling class.
    const AllSignalsBlocked signals;
    const bool started = signals.all_blocked() &&
                         pthread_attr_setstacksize(&attributes, stack_bytes()) == 0 &&
                         pthread_attr_setdetachstate(&attributes, PTHREAD_CREATE_DETACHED) == 0 &&
                         pthread_attr_setinheritsched(&attributes, PTHREAD_EXPLICIT_SCHED) == 0 &&
                         pthread_attr_setschedpolicy(&attributes, SCHED_OTHER) == 0 &&
                         pthread_attr_setschedparam(&attributes, &no_priority) == 0 &&
                         pthread_create(&thread, &attributes, run_thread, start.get()) == 0;
    pthread_attr_destroy(&attributes);
    if (started) (void)start.release();  // the thread's
    return started;
}

}  // namespace urgengo
