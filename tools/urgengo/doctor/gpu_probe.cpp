// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/doctor/gpu_probe.h"

#include <chrono>
#include <sstream>

#include "tools/urgengo/doctor/driver_question.h"

namespace urgengo::cli {
namespace {

constexpr std::chrono::seconds kLimit{30};
constexpr std::uint32_t kKhzPerMhz = 1000;
constexpr char kFoundMark = '+';  // first byte of the child's answer

// As in cuda.h since CUDA 2 and 5; no CUDA header is needed for them.
constexpr int kClockRate = 13;        // CU_DEVICE_ATTRIBUTE_CLOCK_RATE, kHz
constexpr int kMemoryClockRate = 36;  // CU_DEVICE_ATTRIBUTE_MEMORY_CLOCK_RATE, kHz

/// "13000 1980000 3201000 ": the driver's version and the clocks, 0 for what it does not tell.
std::string describe(const DriverLibrary& driver, int device) {
    const auto version = driver.find<int (*)(int*)>("cuDriverGetVersion");
    const auto attribute = driver.find<int (*)(int*, int, int)>("cuDeviceGetAttribute");
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
std::string ask_driver(const std::string& library) {
    const DriverLibrary driver(library);
    if (!driver.problem().empty()) return driver.problem();
    const auto init = driver.find<int (*)(unsigned)>("cuInit");
    const auto count = driver.find<int (*)(int*)>("cuDeviceGetCount");
    const auto get = driver.find<int (*)(int*, int)>("cuDeviceGet");
    const auto name = driver.find<int (*)(char*, int, int)>("cuDeviceGetName");
    if (!init || !count || !get || !name) {
        return (library.empty() ? "libcuda.so.1" : library) + " is not a CUDA driver";
    }

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
    return kFoundMark + describe(driver, device) + text;
}

GpuProbe parse(const std::string& answer) {
    if (answer.empty() || answer.front() != kFoundMark) return {.problem = answer};
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
    const auto answer = ask_in_child([&] { return ask_driver(library); }, kLimit);
    return answer ? parse(*answer) : GpuProbe{.problem = answer.error()};
}

}  // namespace urgengo::cli
