// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/workload.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include <fmt/format.h>

namespace urgengo::chains {

namespace {

using Json = nlohmann::ordered_json;

constexpr std::array kKinds = {KernelKind::kCompute, KernelKind::kMemory};

[[noreturn]] void reject(const std::string& where, const std::string& found,
                         const std::string& accepted) {
    throw std::runtime_error(fmt::format("{}: found {}, accepted: {}", where, found, accepted));
}

/// The value of `key` in `object`, converted; `where` is the object's place in the file.
template <typename T>
T get(const Json& object, const char* key, const std::string& where) {
    const auto found = object.is_object() ? object.find(key) : object.end();
    if (!object.is_object() || found == object.end()) {
        reject(where, fmt::format("no key \"{}\"", key), "files written by `calibrate`");
    }
    try {
        return found->template get<T>();
    } catch (const nlohmann::json::exception&) {
        reject(fmt::format("{}.{}", where, key), found->dump(),
               "a value of the type that `calibrate` writes");
    }
}

double get_positive(const Json& object, const char* key, const std::string& where) {
    const auto value = get<double>(object, key, where);
    if (!(value > 0))
        reject(fmt::format("{}.{}", where, key), fmt::format("{}", value), "more than 0");
    return value;
}

int get_int(const Json& object, const char* key, int least, int most, const std::string& where) {
    const auto value = get<std::int64_t>(object, key, where);
    if (value < least || value > most) {
        reject(fmt::format("{}.{}", where, key), fmt::format("{}", value),
               fmt::format("{} to {}", least, most));
    }
    return static_cast<int>(value);
}

/// A name that is safe in a thread's name (15 bytes with its chain's) and unquoted in YAML.
std::string get_name(const Json& object, const std::string& where) {
    auto name = get<std::string>(object, "name", where);
    const bool plain = name.find_first_not_of(
                           "abcdefghijklmnopqrstuvwxyz"
                           "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_") == std::string::npos;
    const bool starts_well = !name.empty() && (name[0] < '0' || name[0] > '9');
    if (!plain || !starts_well || name.size() > 11) {
        reject(where + ".name", '"' + name + '"', "a letter, then at most 10 letters, digits or _");
    }
    return name;
}

KernelKind get_kind(const Json& object, const std::string& where) {
    const auto name = get<std::string>(object, "kernel", where);
    for (const KernelKind kind : kKinds) {
        if (name == kernel_name(kind)) return kind;
    }
    reject(where + ".kernel", '"' + name + '"', "chains_comp, chains_mem");
}

Kernel parse_kernel(const Json& json, const std::string& where) {
    Kernel kernel;
    kernel.kind = get_kind(json, where);
    kernel.grid = get_int(json, "grid", 1, 1 << 24, where);
    kernel.block = get_int(json, "block", 1, 1024, where);
    kernel.iterations = get_int(json, "iterations", 1, 1 << 24, where);
    kernel.est_us = get_positive(json, "est_us", where);
    kernel.utilization = get_positive(json, "utilization", where);
    return kernel;
}

/// Each element of the array `key`, parsed; an empty array is an error.
template <typename Parse>
auto parse_all(const Json& object, const char* key, const std::string& where, Parse parse) {
    const auto array = get<Json>(object, key, where);
    const std::string place = where + "." + key;
    if (!array.is_array() || array.empty()) reject(place, array.dump(), "a list with an entry");
    std::vector<decltype(parse(array[0], place))> parsed;
    for (std::size_t i = 0; i < array.size(); i++) {
        parsed.push_back(parse(array[i], fmt::format("{}[{}]", place, i)));
    }
    return parsed;
}

Task parse_task(const Json& json, const std::string& where) {
    Task task;
    task.name = get_name(json, where);
    task.cpu_ms = get_positive(json, "cpu_ms", where);
    task.isolated_ms = get_positive(json, "isolated_ms", where);
    task.min_inputs = get_int(json, "min_inputs", 1, 1 << 24, where);
    task.max_inputs = get_int(json, "max_inputs", task.min_inputs, 1 << 24, where);
    task.kernels = parse_all(json, "kernels", where, parse_kernel);
    return task;
}

Chain parse_chain(const Json& json, const std::string& where) {
    Chain chain;
    chain.name = get_name(json, where);
    chain.period_ms = get_positive(json, "period_ms", where);
    chain.deadline_ms = get_positive(json, "deadline_ms", where);
    chain.tasks = parse_all(json, "tasks", where, parse_task);
    for (const Task& task : chain.tasks) {
        if (chain.name.size() + 1 + task.name.size() > 15) {
            reject(where, fmt::format("thread name \"{}.{}\"", chain.name, task.name),
                   "at most 15 bytes");
        }
    }
    return chain;
}

}  // namespace

const char* kernel_name(KernelKind kind) {
    return kind == KernelKind::kCompute ? "chains_comp" : "chains_mem";
}

int scaled_grid(const Kernel& kernel, double size) {
    return std::max(1, static_cast<int>(std::lround(kernel.grid * size)));
}

Workload parse_workload(const std::string& json_text) {
    const auto json = Json::parse(json_text, nullptr, /*allow_exceptions=*/false);
    if (json.is_discarded())
        throw std::runtime_error("not JSON; accepted: files written by `calibrate`");
    const std::string where = "workload";
    const int version = get<int>(json, "format_version", where);
    if (version != kWorkloadFormatVersion) {
        reject("format_version", fmt::format("{}", version),
               fmt::format("{} (calibrate again)", kWorkloadFormatVersion));
    }
    Workload workload;
    workload.gpu = get<std::string>(json, "gpu", where);
    workload.driver = get<std::string>(json, "driver", where);
    workload.num_sms = get_int(json, "num_sms", 1, 1 << 16, where);
    workload.seed = get<std::uint32_t>(json, "seed", where);
    workload.umin = get<double>(json, "umin", where);
    workload.umax = get<double>(json, "umax", where);
    workload.gpu_scale = get<double>(json, "gpu_scale", where);
    workload.memory_share = get<double>(json, "memory_share", where);
    workload.variable = get<bool>(json, "variable", where);
    workload.chains = parse_all(json, "chains", where, parse_chain);
    for (std::size_t i = 0; i < workload.chains.size(); i++) workload.chains[i].place = i;
    return workload;
}

std::string format_workload(const Workload& workload) {
    Json json = {{"format_version", kWorkloadFormatVersion},
                 {"gpu", workload.gpu},
                 {"driver", workload.driver},
                 {"num_sms", workload.num_sms},
                 {"seed", workload.seed},
                 {"umin", workload.umin},
                 {"umax", workload.umax},
                 {"gpu_scale", workload.gpu_scale},
                 {"memory_share", workload.memory_share},
                 {"variable", workload.variable},
                 {"chains", Json::array()}};
    for (const Chain& chain : workload.chains) {
        Json tasks = Json::array();
        for (const Task& task : chain.tasks) {
            Json kernels = Json::array();
            for (const Kernel& kernel : task.kernels) {
                kernels.push_back({{"kernel", kernel_name(kernel.kind)},
                                   {"grid", kernel.grid},
                                   {"block", kernel.block},
                                   {"iterations", kernel.iterations},
                                   {"est_us", kernel.est_us},
                                   {"utilization", kernel.utilization}});
            }
            tasks.push_back({{"name", task.name},
                             {"cpu_ms", task.cpu_ms},
                             {"isolated_ms", task.isolated_ms},
                             {"min_inputs", task.min_inputs},
                             {"max_inputs", task.max_inputs},
                             {"kernels", std::move(kernels)}});
        }
        json["chains"].push_back({{"name", chain.name},
                                  {"period_ms", chain.period_ms},
                                  {"deadline_ms", chain.deadline_ms},
                                  {"tasks", std::move(tasks)}});
    }
    return json.dump(1) + "\n";
}

}  // namespace urgengo::chains
