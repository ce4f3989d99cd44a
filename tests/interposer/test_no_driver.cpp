// SPDX-License-Identifier: Apache-2.0
//
// A machine without a driver, or a setting that names none.
#include <dlfcn.h>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo::testing;

namespace {

const char* const kNoDevice =
    "cuInit(0) = 100, errno 77\n"
    "cuDriverGetVersion(&version) = 100, errno 77\n"
    "cuDeviceGetCount(&count) = 100, errno 77\n"
    "version 0, devices -1\n"
    "cuStreamSynchronize(nullptr) = 100, errno 77\n"
    "cuCtxSynchronize() = 100, errno 77\n"
    "launch_tiny(nullptr, nullptr) = 100, errno 77\n"
    "cuGetProcAddress(\"cuLaunchKernel\", &function, 12000, 0, nullptr) = 100, errno 77\n";

Environment without_driver() {
    Environment environment = preloaded();
    environment["LD_LIBRARY_PATH"] = "/nonexistent";
    environment.erase("URGENGO_REAL_LIBCUDA");
    environment["URGENGO_MODE"] = "off";
    environment["URGENGO_CONFIG"] = "";
    return environment;
}

}  // namespace

TEST_CASE("Every call answers that there is no device when the setting names no driver",
          "[interposer][driver]") {
    Environment environment = without_driver();
    std::string path =
        GENERATE("/nonexistent/libcuda.so.1", "/dev/null", INTERPOSER_FOLDER "/libcuda.so.1");
    environment["URGENGO_REAL_LIBCUDA"] = path;
    const Outcome outcome = run_twin({"init"}, environment);
    INFO(path);
    CHECK(outcome.exit_status == 0);
    CHECK(outcome.out == kNoDevice);
    const auto lines = lines_of(outcome.err);
    // One line for this setting; one for the launch, which finds no config.
    REQUIRE(lines.size() == 2);
    CHECK(lines[0].rfind("urgengo: URGENGO_REAL_LIBCUDA: found '" + path + "', accepted: ", 0) ==
          0);
    CHECK(lines[1].rfind("urgengo: URGENGO_CONFIG is not set", 0) == 0);
}

TEST_CASE("Every call answers that there is no device when no driver is installed",
          "[interposer][driver]") {
    if (void* driver = dlopen("libcuda.so.1", RTLD_LAZY)) {
        dlclose(driver);
        WARN("there is a driver on this machine: not tested");
        return;
    }
    const Outcome outcome = run_twin({"init"}, without_driver());
    CHECK(outcome.exit_status == 0);
    CHECK(outcome.out == kNoDevice);
    CHECK(lines_of(outcome.err).size() == 1);
}

TEST_CASE("Setting wins when LD_LIBRARY_PATH names another driver", "[interposer][driver]") {
    Environment environment = by_library_path();
    environment["URGENGO_REAL_LIBCUDA"] = "/nonexistent/libcuda.so.1";
    CHECK(run_twin({"init"}, environment).out == kNoDevice);
}

TEST_CASE("Driver is found behind empty and foreign folders when LD_LIBRARY_PATH lists them",
          "[interposer][driver]") {
    Environment environment = by_library_path();
    const std::string expected = run_twin({"init"}, bare()).out;
    environment["LD_LIBRARY_PATH"] =
        INTERPOSER_FOLDER "/:/nonexistent::" INTERPOSER_FOLDER "/../urgengo:" SIMGPU_FOLDER;
    CHECK(run_twin({"init"}, environment).out == expected);
}
