// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/gpu_probe.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <string_view>

namespace urgengo::cli {
namespace {

constexpr std::chrono::seconds kLimit{30};
constexpr char kFoundMark = '+';  // first byte of the child's answer

/// The child's answer: "+name", or why there is none. The four functions have had these signatures
/// since CUDA 2; no CUDA header is needed for them.
std::string ask_driver(const char* library) {
    void* handle = dlopen(library, RTLD_NOW | RTLD_LOCAL);
    if (!handle) return dlerror();
    const auto init = reinterpret_cast<int (*)(unsigned)>(dlsym(handle, "cuInit"));
    const auto count = reinterpret_cast<int (*)(int*)>(dlsym(handle, "cuDeviceGetCount"));
    const auto get = reinterpret_cast<int (*)(int*, int)>(dlsym(handle, "cuDeviceGet"));
    const auto name = reinterpret_cast<int (*)(char*, int, int)>(dlsym(handle, "cuDeviceGetName"));
    if (!init || !count || !get || !name) return std::string(library) + " is not a CUDA driver";

    int num_devices = 0, device = 0;
    char text[256] = {};
    if (const int error = init(0)) return "cuInit answers " + std::to_string(error);
    if (const int error = count(&num_devices)) {
        return "cuDeviceGetCount answers " + std::to_string(error);
    }
    if (num_devices == 0) return "the driver knows of no GPU";
    if (get(&device, 0) != 0 || name(text, sizeof text - 1, device) != 0) {
        return "the driver cannot name its first GPU";
    }
    return kFoundMark + std::string(text);
}

[[noreturn]] void answer(const std::string& library, int output) {
    // What the driver prints is not for our user, and our exit handlers are not for the child.
    const int null = open("/dev/null", O_WRONLY | O_CLOEXEC);
    dup2(null, STDOUT_FILENO);
    dup2(null, STDERR_FILENO);
    const std::string text = ask_driver(library.empty() ? "libcuda.so.1" : library.c_str());
    _exit(write(output, text.data(), text.size()) < 0 ? 1 : 0);
}

std::string read_answer(int input) {
    const auto deadline = std::chrono::steady_clock::now() + kLimit;
    for (;;) {
        const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
            deadline - std::chrono::steady_clock::now());
        if (left.count() <= 0) return "the driver does not answer";
        pollfd wait{input, POLLIN, 0};
        if (poll(&wait, 1, static_cast<int>(left.count())) <= 0) continue;
        char buffer[1024];
        const ssize_t count = read(input, buffer, sizeof buffer);
        if (count <= 0) return "the driver crashed";
        return std::string(buffer, static_cast<std::size_t>(count));
    }
}

}  // namespace

GpuProbe probe_gpu(const std::string& library) {
    std::array<int, 2> pipe_ends{};
    if (pipe2(pipe_ends.data(), O_CLOEXEC) != 0) return {false, "", "no pipe"};
    const pid_t child = fork();
    if (child == 0) answer(library, pipe_ends[1]);
    close(pipe_ends[1]);
    std::string text = child > 0 ? read_answer(pipe_ends[0]) : "no process";
    close(pipe_ends[0]);
    if (child > 0) {
        kill(child, SIGKILL);
        waitpid(child, nullptr, 0);
    }
    if (text.front() == kFoundMark) return {true, text.substr(1), ""};
    return {false, "", text};
}

}  // namespace urgengo::cli
