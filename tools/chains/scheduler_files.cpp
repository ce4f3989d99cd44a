// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/scheduler_files.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>

#include <fmt/format.h>

namespace urgengo::chains {

namespace {

std::int64_t to_whole(double value) {
    return static_cast<std::int64_t>(std::llround(value));
}

}  // namespace

// Written out and not emitted through yaml-cpp: all strings in it are names that parse_workload()
// has restricted to letters, digits and _, and the program stays free of a library that a machine
// with a GPU may lack. The tests read it back with yaml-cpp.
std::string format_yaml(const Workload& workload, const Scenario& scenario, OnLate on_late,
                        Threads threads) {
    std::string yaml = fmt::format("# The ten-chain workload on {}: f_a {}, f_d {}, {} tight.\n",
                                   workload.gpu, scenario.f_a, scenario.f_d, scenario.tight.size());
    yaml += "version: 1\nmode: enforce\nchains:\n";
    for (const Chain& chain : workload.chains) {
        yaml += fmt::format("  - name: {}\n", chain.name);
        yaml += fmt::format("    period_ms: {:.6f}\n", scenario.period_ms(chain));
        yaml += fmt::format("    deadline_ms: {:.6f}\n", scenario.deadline_ms(chain));
        yaml += fmt::format("    on_late: {}\n", on_late == OnLate::kExit ? "exit" : "continue");
        yaml += "    tasks:\n";
        for (const Task& task : chain.tasks) {
            yaml += fmt::format("      - {{name: {}, thread: \"{}\"}}\n", task.name,
                                thread_name(threads, chain, task));
        }
    }
    return yaml;
}

std::string format_profile(const Workload& workload) {
    using Json = nlohmann::ordered_json;
    Json json = {{"format_version", 2},
                 {"gpu", workload.gpu},
                 {"driver", workload.driver},
                 {"chains", Json::array()}};
    for (const Chain& chain : workload.chains) {
        Json tasks = Json::array();
        for (const Task& task : chain.tasks) {
            Json kernels = Json::array();
            for (const Kernel& kernel : task.kernels) {
                kernels.push_back({{"name", kernel_name(kernel.kind)},
                                   {"grid_blocks", kernel.grid},
                                   {"block_threads", kernel.block},
                                   {"gpu_time_ns", to_whole(std::max(1.0, kernel.est_us * 1e3))},
                                   {"utilization", kernel.utilization}});
            }
            tasks.push_back({{"name", task.name},
                             {"cpu_time_ns", to_whole(task.cpu_ms * 1e6)},
                             {"kernels", std::move(kernels)}});
        }
        json["chains"].push_back({{"name", chain.name}, {"tasks", std::move(tasks)}});
    }
    return json.dump(1) + "\n";
}

}  // namespace urgengo::chains
