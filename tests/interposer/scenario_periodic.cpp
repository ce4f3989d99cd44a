// SPDX-License-Identifier: Apache-2.0
//
// A program as `urgengo discover` may meet it: a thread with a name of its own, and two that have
// the program's, run different networks, begin with the same kernel and share the default stream.
#include <time.h>

#include <string>
#include <thread>
#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

constexpr int kFrames = 25;

CUmodule load_networks() {
    CUmodule module = nullptr;
    MUST(cuModuleLoadData(&module, R"({"kernels": [
        {"name": "stem", "block_ns": 100000}, {"name": "points", "block_ns": 100000},
        {"name": "image", "block_ns": 100000}, {"name": "decode", "block_ns": 100000}]})"));
    return module;
}

CUfunction function(CUmodule module, const char* name) {
    CUfunction found = nullptr;
    MUST(cuModuleGetFunction(&found, module, name));
    return found;
}

void sleep_until(timespec& time, long period_ns) {
    time.tv_nsec += period_ns;
    time.tv_sec += time.tv_nsec / 1'000'000'000;
    time.tv_nsec %= 1'000'000'000;
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, nullptr);
}

void run_network(const Gpu& gpu, const std::vector<CUfunction>& kernels, CUstream stream,
                 long period_ns) {
    MUST(cuCtxSetCurrent(gpu.context));
    timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    for (int frame = 0; frame < kFrames; ++frame) {
        sleep_until(time, period_ns);
        for (CUfunction kernel : kernels) MUST(launch_tiny(kernel, stream));
        MUST(cuStreamSynchronize(stream));
    }
}

int periodic(const Arguments&) {
    const Gpu gpu;
    const CUmodule module = load_networks();
    const CUfunction stem = function(module, "stem"), points = function(module, "points"),
                     image = function(module, "image"), decode = function(module, "decode");
    for (int i = 0; i < 3; ++i) MUST(launch_tiny(gpu.tiny, nullptr));  // it starts up
    MUST(cuCtxSynchronize());
    std::thread sensor([&] {
        name_this_thread("sensor");
        MUST(cuCtxSetCurrent(gpu.context));
        run_network(gpu, {decode, decode}, make_stream(), 20'000'000);
    });
    std::thread lidar([&] { run_network(gpu, {stem, points, points}, nullptr, 30'000'000); });
    std::thread camera([&] { run_network(gpu, {stem, image}, nullptr, 40'000'000); });
    sensor.join();
    lidar.join();
    camera.join();
    say("done");
    return 0;
}

const Scenario periodic_scenario("periodic", periodic, Runs::kSimulated);

}  // namespace
}  // namespace twin
