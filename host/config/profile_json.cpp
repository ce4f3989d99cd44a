// SPDX-License-Identifier: Apache-2.0
#include "host/config/profile_json.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "host/config/hex.h"
#include "host/config/limits.h"

namespace urgengo::config {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::int64_t kFormatVersion = kProfileFormatVersion;
/// CUDA's own limits: grid 2^31-1 x 65535 x 65535 (more than fits, so 2^62), block 1024 threads.
constexpr std::int64_t kMaxGridBlocks = std::int64_t{1} << 62;
constexpr std::int64_t kMaxBlockThreads = 1024;

std::uint32_t count_from_json(const JsonCursor& json) {
    return static_cast<std::uint32_t>(json.integer(0, UINT32_MAX));
}

// The same for keys that may be absent.

nanoseconds time_from_json(const JsonCursor& json, const char* key) {
    const auto member = json.find(key);
    return member ? member->time_ns(0, kMaxTimeNs) : nanoseconds{0};
}

std::uint32_t count_from_json(const JsonCursor& json, const char* key, std::uint32_t otherwise) {
    const auto member = json.find(key);
    return member ? count_from_json(*member) : otherwise;
}

std::string text_from_json(const JsonCursor& json, const char* key) {
    const auto member = json.find(key);
    return member ? member->text() : "";
}

KernelProfile kernel_from_json(const JsonCursor& json) {
    KernelProfile kernel;
    kernel.name = json.at("name").name();
    kernel.grid_blocks =
        static_cast<std::uint64_t>(json.at("grid_blocks").integer(1, kMaxGridBlocks));
    kernel.block_threads =
        static_cast<std::uint32_t>(json.at("block_threads").integer(1, kMaxBlockThreads));
    kernel.gpu_time = json.at("gpu_time_ns").time_ns(0, kMaxTimeNs);
    kernel.utilization = json.at("utilization").number(0, 1);
    kernel.samples = count_from_json(json, "samples", 0);
    kernel.launch_time = time_from_json(json, "launch_ns");
    kernel.stream = count_from_json(json, "stream", 0);
    return kernel;
}

std::vector<KernelProfile> kernels_from_json(const JsonCursor& json) {
    std::vector<KernelProfile> kernels;
    for (const JsonCursor& kernel : json.items()) kernels.push_back(kernel_from_json(kernel));
    return kernels;
}

SegmentProfile segment_from_json(const JsonCursor& json) {
    SegmentProfile segment;
    segment.cpu_time = json.at("cpu_time_ns").time_ns(0, kMaxTimeNs);
    segment.num_launches = count_from_json(json.at("num_launches"));
    segment.min_launches = count_from_json(json.at("min_launches"));
    segment.max_launches = static_cast<std::uint32_t>(
        json.at("max_launches").integer(segment.min_launches, UINT32_MAX));
    segment.closed_by = json.at("closed_by").text();
    segment.latency = time_from_json(json, "latency_ns");
    return segment;
}

TaskProfile task_from_json(const JsonCursor& json) {
    TaskProfile task;
    task.name = json.at("name").name();
    task.cpu_time = json.at("cpu_time_ns").time_ns(0, kMaxTimeNs);
    task.instances = count_from_json(json, "instances", 0);
    task.start_up_launches = count_from_json(json, "start_up_launches", 0);
    if (const auto segments = json.find("segments")) {
        for (const JsonCursor& segment : segments->items()) {
            task.segments.push_back(segment_from_json(segment));
        }
    }
    task.kernels = kernels_from_json(json.at("kernels"));
    if (const auto sizes = json.find("sizes")) task.sizes = kernels_from_json(*sizes);
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

Json kernels_to_json(const std::vector<KernelProfile>& kernels) {
    Json list = Json::array();
    for (const KernelProfile& kernel : kernels) {
        list.push_back({{"name", kernel.name},
                        {"grid_blocks", kernel.grid_blocks},
                        {"block_threads", kernel.block_threads},
                        {"gpu_time_ns", kernel.gpu_time.count()},
                        {"utilization", kernel.utilization},
                        {"samples", kernel.samples},
                        {"launch_ns", kernel.launch_time.count()},
                        {"stream", kernel.stream}});
    }
    return list;
}

Json segments_to_json(const std::vector<SegmentProfile>& segments) {
    Json list = Json::array();
    for (const SegmentProfile& segment : segments) {
        list.push_back({{"cpu_time_ns", segment.cpu_time.count()},
                        {"num_launches", segment.num_launches},
                        {"min_launches", segment.min_launches},
                        {"max_launches", segment.max_launches},
                        {"closed_by", segment.closed_by},
                        {"latency_ns", segment.latency.count()}});
    }
    return list;
}

Json chain_to_json(const ChainProfile& chain) {
    Json tasks = Json::array();
    for (const TaskProfile& task : chain.tasks) {
        tasks.push_back({{"name", task.name},
                         {"cpu_time_ns", task.cpu_time.count()},
                         {"instances", task.instances},
                         {"start_up_launches", task.start_up_launches},
                         {"segments", segments_to_json(task.segments)},
                         {"kernels", kernels_to_json(task.kernels)},
                         {"sizes", kernels_to_json(task.sizes)}});
    }
    return {{"name", chain.name}, {"tasks", std::move(tasks)}};
}

/// Names need not be UTF-8; replacing is better than throwing.
std::string dump(const Json& json) {
    return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

/// Appends with two spaces a level; what holds nothing but single values stays in one line.
void append_text(const Json& json, const std::string& indent, std::string& text) {
    const bool is_nested = std::any_of(json.begin(), json.end(),
                                       [](const Json& child) { return child.is_structured(); });
    if (!json.is_structured() || (json.is_object() && !is_nested) || json.empty()) {
        text += dump(json);
        return;
    }
    const std::string inner = indent + "  ";
    text += json.is_object() ? "{" : "[";
    bool is_first = true;
    for (const auto& [key, child] : json.items()) {
        text += (is_first ? "\n" : ",\n") + inner;
        if (json.is_object()) text += dump(key) + ": ";
        append_text(child, inner, text);
        is_first = false;
    }
    text += "\n" + indent + (json.is_object() ? "}" : "]");
}

}  // namespace

Profile profile_from_json(const JsonCursor& root) {
    Profile profile;
    profile.format_version =
        static_cast<int>(root.at("format_version").integer(kFormatVersion, kFormatVersion));
    profile.gpu = root.at("gpu").text();
    profile.driver = root.at("driver").text();
    profile.sm_clock_mhz = count_from_json(root, "sm_clock_mhz", 0);
    profile.memory_clock_mhz = count_from_json(root, "memory_clock_mhz", 0);
    profile.program = text_from_json(root, "program");
    if (const auto hash = root.find("kernel_set_hash")) profile.kernel_set_hash = hash->hash();
    profile.runs = count_from_json(root, "runs", 1);
    for (const JsonCursor& chain : root.at("chains").items()) {
        profile.chains.push_back(chain_from_json(chain));
    }
    return profile;
}

Json profile_to_json(const Profile& profile) {
    Json chains = Json::array();
    for (const ChainProfile& chain : profile.chains) chains.push_back(chain_to_json(chain));
    return {{"format_version", profile.format_version},
            {"gpu", profile.gpu},
            {"driver", profile.driver},
            {"sm_clock_mhz", profile.sm_clock_mhz},
            {"memory_clock_mhz", profile.memory_clock_mhz},
            {"program", profile.program},
            {"kernel_set_hash", to_hex(profile.kernel_set_hash)},
            {"runs", profile.runs},
            {"chains", std::move(chains)}};
}

std::string to_profile_text(const Profile& profile) {
    std::string text;
    append_text(profile_to_json(profile), "", text);
    return text + "\n";
}

}  // namespace urgengo::config
