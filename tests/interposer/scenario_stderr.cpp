// SPDX-License-Identifier: Apache-2.0
//
// Programs whose stderr nobody reads, nobody can write to, or is not there. They write nothing to
// it themselves.
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

/// Another scenario in this process's place: one whose stderr was so from its start.
[[noreturn]] void become(std::string scenario) {
    std::string path = own_path();
    char* arguments[] = {path.data(), scenario.data(), nullptr};
    execv(path.c_str(), arguments);
    give_up("execv", errno);
}

void make_stderr_a_pipe(int& reader) {
    int ends[2];
    MUST(pipe(ends));
    if (dup2(ends[1], STDERR_FILENO) < 0) give_up("dup2", errno);
    close(ends[1]);
    reader = ends[0];
}

int dead(const Arguments&) {
    int reader;
    make_stderr_a_pipe(reader);
    close(reader);
    become("stderr_signals");
}

int full(const Arguments&) {
    int reader;  // stays open and is never read
    make_stderr_a_pipe(reader);
    const int flags = fcntl(STDERR_FILENO, F_GETFL);
    MUST(fcntl(STDERR_FILENO, F_SETFL, flags | O_NONBLOCK));
    while (write(STDERR_FILENO, "x", 1) == 1) {
    }
    MUST(fcntl(STDERR_FILENO, F_SETFL, flags));
    become("stderr_signals");
}

/// What a write to a dead pipe might leave behind in the thread.
void say_signals(const char* when) {
    sigset_t pending, blocked;
    MUST(sigpending(&pending));
    MUST(pthread_sigmask(SIG_BLOCK, nullptr, &blocked));
    say("%s: SIGPIPE pending %d, blocked %d", when, sigismember(&pending, SIGPIPE),
        sigismember(&blocked, SIGPIPE));
}

int signals(const Arguments&) {
    const Gpu gpu;
    std::atexit([] { say_signals("at exit"); });  // runs after what the first launch registers
    SHOW(launch_tiny(gpu.tiny, nullptr));
    say_signals("launched");
    // One that the program has pending is the program's.
    sigset_t pipe;
    sigemptyset(&pipe);
    sigaddset(&pipe, SIGPIPE);
    MUST(pthread_sigmask(SIG_BLOCK, &pipe, nullptr));
    MUST(raise(SIGPIPE));
    SHOW(launch_tiny(gpu.tiny, nullptr));
    SHOW(cuCtxSynchronize());
    return 9;
}

/// A file of the program's own that got the number of stderr.
int reused(const Arguments&) {
    close(STDERR_FILENO);
    if (memfd_create("results", 0) != STDERR_FILENO) give_up("memfd_create", errno);
    std::atexit([] {
        char text[4096];
        const ssize_t length = pread(STDERR_FILENO, text, sizeof text, 0);
        say("the file: %.*s", static_cast<int>(length), text);
    });
    const Gpu gpu;
    if (write(STDERR_FILENO, "HEADER", 6) != 6) give_up("write", errno);
    SHOW(launch_tiny(gpu.tiny, nullptr));
    if (write(STDERR_FILENO, "DATA", 4) != 4) give_up("write", errno);
    SHOW(cuCtxSynchronize());
    return 0;
}

int closed(const Arguments&) {
    close(STDERR_FILENO);
    become("stderr_reused");
}

const Scenario s1("stderr_dead", dead), s2("stderr_full", full), s3("stderr_signals", signals),
    s4("stderr_reused", reused), s5("stderr_closed", closed);

}  // namespace
}  // namespace twin
