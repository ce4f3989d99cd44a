// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/command_json.h"

#include <fmt/format.h>

#include <cstdio>
#include <vector>

#include "host/config/kernel_pattern.h"
#include "tools/trace/profile_check.h"
#include "tools/urgengo/profile_table.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

double ms_of_ns(double ns) {
    return 1e-6 * ns;
}
double ms_of(std::int64_t ns) {
    return ms_of_ns(static_cast<double>(ns));
}

/// 0 stands for "not known".
Json ms_or_null(std::int64_t ns) {
    return ns == 0 ? Json(nullptr) : Json(ms_of(ns));
}

Json task_claims_json(const discover::TaskClaims& task, std::int64_t total_gpu_ns) {
    Json by = Json::object();
    for (std::size_t i = 0; i < task.by.size(); ++i)
        if (task.by[i] > 0)
            by[discover::matched_by_name(static_cast<discover::MatchedBy>(i))] = task.by[i];
    const double total = static_cast<double>(total_gpu_ns);
    return {{"chain", task.chain},
            {"task", task.name},
            {"launches", task.launches},
            {"gpu_ms", ms_of(task.gpu_ns)},
            {"gpu_share", total > 0 ? static_cast<double>(task.gpu_ns) / total : 0},
            {"frames", task.instances.instances.size()},
            {"period_ms", ms_of(task.period.count())},
            {"measured_period_ms", ms_or_null(task.instances.period_ns)},
            {"matched_by", std::move(by)}};
}

Json rule_json(const config::Task& task) {
    Json rule = Json::object();
    if (!task.thread_glob.empty()) rule["thread"] = task.thread_glob;
    if (!task.nvtx_glob.empty()) rule["nvtx"] = task.nvtx_glob;
    for (const config::KernelPattern& pattern : task.kernels)
        rule["kernels"].push_back(config::to_text(pattern));
    return rule;
}

const char* verdict_word(trace::Verdict verdict) {
    switch (verdict) {
        case trace::Verdict::kAddsUp:
            return "adds_up";
        case trace::Verdict::kGuess:
            return "guess";
        case trace::Verdict::kRefused:
            break;
    }
    return "refused";
}

Json learned_task_json(const trace::TaskReport& report, const config::TaskProfile& task) {
    Json json = {{"chain", report.chain},
                 {"task", report.task},
                 {"instances", task.instances},
                 {"launches", task.kernels.size()},
                 {"segments", task.segments.size()},
                 {"verdict", verdict_word(report.verdict)}};
    if (task.kernels.empty()) return json;
    const std::string bound = bound_by(task);
    json["busy_ms"] = ms_of(trace::busy_time(task).count());
    json["sum_ms"] = ms_of(report.times.sum.count());
    json["latency_ms"] = ms_or_null(trace::latency(task).count());
    json["bound"] = bound == "-" ? Json(nullptr) : Json(bound == "GPU" ? "gpu" : bound);
    json["cpu_ms"] = ms_of(task.cpu_time.count());
    json["streams"] = report.times.streams;
    json["start_up_launches"] = task.start_up_launches;
    json["alone_share"] = report.samples == 0 ? 0
                                              : static_cast<double>(report.clean_samples) /
                                                    static_cast<double>(report.samples);
    json["timed_by"] = report.times.by_cupti ? "cupti" : "marks";
    return json;
}

}  // namespace

Json claims_json(const std::string& file, const discover::Claims& claims) {
    Json root = {{"format_version", 1},
                 {"config", file},
                 {"all_matched", discover::all_matched(claims)},
                 {"gpu_ms", ms_of(claims.total_gpu_ns)}};
    root["tasks"] = Json::array();
    for (const discover::TaskClaims& task : claims.tasks)
        root["tasks"].push_back(task_claims_json(task, claims.total_gpu_ns));
    const auto name = [&](int index) {
        const discover::TaskClaims& task = claims.tasks[static_cast<std::size_t>(index)];
        return Json{{"chain", task.chain}, {"task", task.name}};
    };
    root["claimed_twice"] = Json::array();
    for (const auto& [tasks, launches] : claims.doubles)
        root["claimed_twice"].push_back(
            {{"of", name(tasks.first)}, {"also_of", name(tasks.second)}, {"launches", launches}});
    root["unexplained"] = Json::array();
    for (const auto& [thread, group] : claims.unexplained) {
        Json kernels = Json::object();
        for (const auto& [kernel, gpu_ns] : group.kernels) kernels[kernel] = ms_of(gpu_ns);
        root["unexplained"].push_back({{"thread", thread},
                                       {"launches", group.launches},
                                       {"gpu_ms", ms_of(group.gpu_ns)},
                                       {"kernels_gpu_ms", std::move(kernels)}});
    }
    root["seen"] = {{"threads", claims.thread_names},
                    {"ranges", claims.range_names},
                    {"first_kernels", claims.first_kernels}};
    return root;
}

Json draft_json(const std::string& file, const config::Config& config, const discover::Draft& draft,
                const discover::Activities& activities) {
    Json root = {{"format_version", 1}, {"config", file}};
    root["chains"] = Json::array();
    for (std::size_t i = 0; i < config.chains.size() && i < draft.chains.size(); ++i) {
        const config::Chain& chain = config.chains[i];
        const discover::Activity& seen = activities.list[draft.chains[i].activity];
        Json json = {{"name", chain.name},
                     {"period_ms", ms_of(chain.period.count())},
                     {"period_low_ms", ms_of_ns(seen.period_ns.low)},
                     {"period_high_ms", ms_of_ns(seen.period_ns.high)},
                     {"deadline_ms", ms_of(chain.deadline.count())},
                     {"frames", seen.frames.size()},
                     {"threads", seen.threads.size()}};
        json["tasks"] = Json::array();
        for (const config::Task& task : chain.tasks)
            json["tasks"].push_back({{"name", task.name}, {"found_by", rule_json(task)}});
        root["chains"].push_back(std::move(json));
    }
    return root;
}

Json profile_json(const std::string& file, const trace::LearnedProfile& learned) {
    Json root = {{"format_version", 1},
                 {"profile", file.empty() ? Json(nullptr) : Json(file)},
                 {"program", learned.profile.program},
                 {"gpu", learned.profile.gpu}};
    root["tasks"] = Json::array();
    std::size_t index = 0;
    for (const config::ChainProfile& chain : learned.profile.chains)
        for (const config::TaskProfile& task : chain.tasks)
            root["tasks"].push_back(learned_task_json(learned.tasks[index++], task));
    root["warnings"] = learned.warnings;
    return root;
}

void print_as_json(const Json& json) {
    fmt::print("{}\n", json.dump(2, ' ', false, Json::error_handler_t::replace));
    std::fflush(stdout);
}

}  // namespace urgengo::cli
