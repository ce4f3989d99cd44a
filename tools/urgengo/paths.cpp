// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/paths.h"

#include <filesystem>

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

std::string own_program() {
    std::error_code error;
    const fs::path path = fs::read_symlink("/proc/self/exe", error);
    return error ? "" : path.string();
}

/// @param relative  to the folder above bin/
Result<std::string> installed_file(const std::string& relative, const char* what) {
    const fs::path prefix = fs::path(own_program()).parent_path().parent_path();
    const fs::path path = prefix / relative;
    std::error_code ignored;
    if (fs::is_regular_file(path, ignored)) return path.string();
    return Error{path.string() + ": not found; " + what + " belongs there (build or install it)"};
}

}  // namespace

std::string urgengo_program() {
    return (fs::path(own_program()).parent_path() / "urgengo").string();
}

Result<std::string> interposer_library() {
    return installed_file("lib/urgengo/libcuda.so.1", "UrgenGo's library");
}

Result<std::string> own_time_interposer_library() {
    return installed_file("lib/urgengo-own-time/libcuda.so.1",
                          "the library that measures its own time (the build's target "
                          "urgengo_interposer_own_time)");
}

Result<std::string> simulated_gpu_library() {
    return installed_file("lib/simgpu/libcuda.so.1", "the simulated GPU");
}

Result<std::string> null_driver_library() {
    return installed_file("lib/nulldriver/libcuda.so.1", "the driver that answers at once");
}

Result<std::string> null_nvtx_tool() {
    return installed_file("lib/nulldriver/libnull_nvtx_tool.so", "the NVTX tool that does nothing");
}

Result<std::string> bench_program() {
    return installed_file("bin/urgengo-bench", "the benchmarks' program");
}

Result<std::string> export_program() {
    return installed_file("bin/urgengo-export", "the program that serves metrics");
}

Result<std::string> call_bench_program() {
    return installed_file("bin/urgengo_call_bench",
                          "the call benchmark, which needs Google Benchmark,");
}

Result<std::string> launch_bench_program() {
    return installed_file("bin/urgengo_launch_bench", "the launch benchmark");
}

Result<std::string> chains_program() {
    return installed_file("bin/urgengo-chains", "the workload program");
}

Result<std::string> chains_config(const std::string& file) {
    return installed_file("share/urgengo/" + file, "a config of the workload program");
}

}  // namespace urgengo::cli
