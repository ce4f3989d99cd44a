// SPDX-License-Identifier: Apache-2.0
#include "host/config/profile_json.h"

#include <nlohmann/json.hpp>

#include "host/config/limits.h"

namespace urgengo::config {
namespace {

using Json = nlohmann::json;

constexpr std::int64_t kFormatVersion = kProfileFormatVersion;
/// CUDA's own limits: grid 2^31-1 x 65535 x 65535 (more than fits, so 2^62), block 1024 threads.
constexpr std::int64_t kMaxGridBlocks = std::int64_t{1} << 62;
constexpr std::int64_t kMaxBlockThreads = 1024;

KernelProfile kernel_from_json(const JsonCursor& json) {
    KernelProfile kernel;
    kernel.name = json.at("name").name();
    kernel.grid_blocks =
        static_cast<std::uint64_t>(json.at("grid_blocks").integer(1, kMaxGridBlocks));
    kernel.block_threads =
        static_cast<std::uint32_t>(json.at("block_threads").integer(1, kMaxBlockThreads));
    kernel.gpu_time = json.at("gpu_time_ns").time_ns(0, kMaxTimeNs);
    kernel.utilization = json.at("utilization").number(0, 1);
    return kernel;
}

TaskProfile task_from_json(const JsonCursor& json) {
    TaskProfile task;
    task.name = json.at("name").name();
    task.cpu_time = json.at("cpu_time_ns").time_ns(0, kMaxTimeNs);
    for (const JsonCursor& kernel : json.at("kernels").items()) {
        task.kernels.push_back(kernel_from_json(kernel));
    }
    return task;
}

ChainProfile chain_from_json(const JsonCursor& json) {
    ChainProfile chain;
    chain.name = json.at("name").name();
    for (const JsonCursor& task : json.at("tasks").items()) {
        chain.tasks.push_back(task_from_json(task));
    }
    return chain;
}

Json kernel_to_json(const KernelProfile& kernel) {
    return {{"name", kernel.name},
            {"grid_blocks", kernel.grid_blocks},
            {"block_threads", kernel.block_threads},
            {"gpu_time_ns", kernel.gpu_time.count()},
            {"utilization", kernel.utilization}};
}

}  // namespace

Profile profile_from_json(const JsonCursor& root) {
    Profile profile;
    profile.format_version =
        static_cast<int>(root.at("format_version").integer(kFormatVersion, kFormatVersion));
    profile.gpu = root.at("gpu").text();
    profile.driver = root.at("driver").text();
    for (const JsonCursor& chain : root.at("chains").items()) {
        profile.chains.push_back(chain_from_json(chain));
    }
    return profile;
}

Json profile_to_json(const Profile& profile) {
    Json chains = Json::array();
    for (const ChainProfile& chain : profile.chains) {
        Json tasks = Json::array();
        for (const TaskProfile& task : chain.tasks) {
            Json kernels = Json::array();
            for (const KernelProfile& kernel : task.kernels) {
                kernels.push_back(kernel_to_json(kernel));
            }
            tasks.push_back({{"name", task.name},
                             {"cpu_time_ns", task.cpu_time.count()},
                             {"kernels", std::move(kernels)}});
        }
        chains.push_back({{"name", chain.name}, {"tasks", std::move(tasks)}});
    }
    return {{"format_version", profile.format_version},
            {"gpu", profile.gpu},
            {"driver", profile.driver},
            {"chains", std::move(chains)}};
}

}  // namespace urgengo::config
