// SPDX-License-Identifier: Apache-2.0
//
// Forks while another thread is inside UrgenGo. That thread is not in the child: what it was about
// to finish stays half-done there, and what it had locked stays locked.
#include <nvtx3/nvToolsExt.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

constexpr unsigned kLongest_s = 5;

/// Forks a child that does the work and exits, and waits for it: the end if that takes kLongest_s.
template <typename Work>
void fork_to(Work&& work) {
    const pid_t child = fork();
    if (child < 0) give_up("fork", errno);
    if (child == 0) {
        alarm(kLongest_s);
        work();
        std::exit(0);
    }
    int status = 0;
    if (waitpid(child, &status, 0) != child) give_up("waitpid", errno);
    if (status == 0) return;
    say("a child ended with %#x", status);
    std::fflush(stdout);
    _exit(1);
}

// The first launch of all, which starts UrgenGo, may be under way in the other thread.
int fork_starting(const Arguments&) {
    const Gpu gpu;
    std::atomic<bool> launched{false};
    std::thread other([&] {
        name_this_thread("twin_1");
        MUST(cuCtxSetCurrent(gpu.context));
        MUST(launch_tiny(gpu.tiny, nullptr));  // says nothing: children would say it again
        launched = true;
    });
    while (!launched)
        fork_to([&] {
            if (launch_tiny(gpu.tiny, nullptr) != CUDA_ERROR_NOT_INITIALIZED) _exit(2);
            int version = 0;
            MUST(cuDriverGetVersion(&version));
        });
    other.join();
    SHOW(launch_tiny(gpu.tiny, nullptr));
    SHOW(cuCtxSynchronize());
    return 0;
}

// The other thread keeps giving names to NVTX.
int fork_naming(const Arguments&) {
    const nvtxDomainHandle_t domain = nvtxDomainCreateA("a domain");
    std::atomic<bool> enough{false};
    std::thread other([&] {
        for (int i = 0; !enough; ++i) {
            const std::string name = std::to_string(i % 100);
            nvtxDomainRegisterStringA(domain, name.c_str());
            nvtxDomainCreateA(name.c_str());
        }
    });
    for (int i = 0; i < 200; ++i)
        fork_to([&] {
            nvtxDomainRegisterStringA(domain, "child");
            nvtxDomainCreateA("child");
        });
    enough = true;
    other.join();
    say("all children exited");
    return 0;
}

const Scenario s1("fork_starting", fork_starting, Runs::kSimulated), s2("fork_naming", fork_naming);

}  // namespace
}  // namespace twin
