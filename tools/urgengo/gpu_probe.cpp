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
#include <sstream>
#include <string_view>

namespace urgengo::cli {
namespace {

constexpr std::chrono::seconds kLimit{30};
constexpr std::uint32_t kKhzPerMhz = 1000;
constexpr char kFoundMark = '+';  // first byte of the child's answer

// As in cuda.h since CUDA 2 and 5; no CUDA header is needed for them.
constexpr int kClockRate = 13;        // CU_DEVICE_ATTRIBUTE_CLOCK_RATE, kHz
constexpr int kMemoryClockRate = 36;  // CU_DEVICE_ATTRIBUTE_MEMORY_CLOCK_RATE, kHz

/// "13000 1980000 3201000 ": the driver's version and the clocks, 0 for what it does not tell.
std::string describe(void* handle, int device) {
    const auto version = reinterpret_cast<int (*)(int*)>(dlsym(handle, "cuDriverGetVersion"));
    const auto attribute =
        reinterpret_cast<int (*)(int*, int, int)>(dlsym(handle, "cuDeviceGetAttribute"));
    int number = 0, sm_khz = 0, memory_khz = 0;
    if (!version || version(&number) != 0) number = 0;
    if (!attribute || attribute(&sm_khz, kClockRate, device) != 0) sm_khz = 0;
    if (!attribute || attribute(&memory_khz, kMemoryClockRate, device) != 0) memory_khz = 0;
    std::string text;
    for (const int value : {number, sm_khz, memory_khz}) {
        text += std::to_string(value > 0 ? value : 0) + " ";
    }
    return text;
}

/// The child's answer: "+version clock clock name", or why there is none. The four functions have
/// had these signatures since CUDA 2.
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
    return kFoundMark + describe(handle, device) + text;
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

namespace {

GpuProbe parse(const std::string& answer) {
    if (answer.front() != kFoundMark) return {.problem = answer};
    std::istringstream text(answer.substr(1));
    GpuProbe probe;
    probe.found = true;
    int version = 0;
    text >> version >> probe.sm_clock_mhz >> probe.memory_clock_mhz >> std::ws;
    std::getline(text, probe.name);
    probe.sm_clock_mhz /= kKhzPerMhz;
    probe.memory_clock_mhz /= kKhzPerMhz;
    if (version > 0) {
        probe.driver = std::to_string(version / 1000) + "." + std::to_string(version % 1000 / 10);
    }
    return probe;
}

}  // namespace

GpuProbe probe_gpu(const std::string& library) {
    std::array<int, 2> pipe_ends{};
    if (pipe2(pipe_ends.data(), O_CLOEXEC) != 0) return {.problem = "no pipe"};
    const pid_t child = fork();
    if (child == 0) answer(library, pipe_ends[1]);
    close(pipe_ends[1]);
    std::string text = child > 0 ? read_answer(pipe_ends[0]) : "no process";
    close(pipe_ends[0]);
    if (child > 0) {
        kill(child, SIGKILL);
        waitpid(child, nullptr, 0);
    }
    return parse(text);
}

}  // namespace urgengo::cli
