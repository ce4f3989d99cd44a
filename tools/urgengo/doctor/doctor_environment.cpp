// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/doctor/doctor_environment.h"

#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <system_error>
#include <utility>

#include "host/config/connections.h"
#include "host/config/dispatch_choice.h"
#include "host/config/names.h"
#include "tools/urgengo/program/environment_check.h"
#include "tools/urgengo/program/program_setup.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

constexpr int kMostConnections = 32;

std::vector<std::string> words_of(std::string text) {
    for (char& c : text) {
        if (c == ':') c = ' ';
    }
    std::istringstream stream(text);
    std::vector<std::string> words;
    for (std::string word; stream >> word;) words.push_back(word);
    return words;
}

/// @returns the entries that are not ours, and what is wrong with each
std::vector<std::string> strangers(const std::vector<std::string>& entries,
                                   const std::string& interposer, Verdict& verdict) {
    std::vector<std::string> list;
    for (const std::string& entry : entries) {
        std::error_code ignored;
        if (entry == interposer || fs::equivalent(entry, interposer, ignored)) continue;
        const bool is_driver = fs::path(entry).filename().string().starts_with("libcuda.so");
        const bool is_absent = entry.find('/') != std::string::npos && !fs::exists(entry, ignored);
        if (is_driver || is_absent) verdict = Verdict::kWarn;
        list.push_back(entry + (is_driver   ? " (another libcuda: ours comes before it)"
                                : is_absent ? " (no such file)"
                                            : ""));
    }
    return list;
}

Finding preloaded(const char* topic, const std::string& text, const std::string& interposer) {
    Finding finding{topic, Verdict::kOk, ""};
    const auto others = strangers(words_of(text), interposer, finding.verdict);
    finding.found = others.empty() ? "nothing else" : fmt::format("{}", fmt::join(others, ", "));
    return finding;
}

Finding connections(const Environment& environment, const config::Config& config) {
    const char* const topic = "connections";
    const std::string set = value_of(environment, "CUDA_DEVICE_MAX_CONNECTIONS");
    if (set.empty()) {
        const int ours = config::connections_of(config);
        const bool keeps = config.connections == 0;
        const std::string text =
            ours > 0 ? fmt::format("not set; `urgengo run` sets {} where it schedules", ours)
            : keeps  ? "not set, and env.connections is keep: the driver's default of 8"
                     : "not set, and left so for so few tasks: the driver's default of 8";
        const bool is_few = keeps || (ours > 0 && ours < kMostConnections);
        return {topic, is_few ? Verdict::kWarn : Verdict::kOk,
                text + (is_few ? ": more streams than that wait for each other" : "")};
    }
    const bool is_most = set == std::to_string(kMostConnections);
    return {topic, is_most ? Verdict::kOk : Verdict::kWarn,
            fmt::format("CUDA_DEVICE_MAX_CONNECTIONS is {} and stays{}", set,
                        is_most ? "" : ": more streams than that wait for each other")};
}

bool blocks_launches(const Environment& environment) {
    const std::string blocking = value_of(environment, "CUDA_LAUNCH_BLOCKING");
    return !blocking.empty() && blocking != "0";
}

/// What `dispatch` will come to; only if gates are asked for.
void check_dispatch(const Environment& environment, const config::Config& config, ToolSigns signs,
                    Findings& findings) {
    using config::Dispatch;
    const config::Scheduler& scheduler = config.scheduler;
    if (scheduler.dispatch.where == Dispatch::kThread) return;
    const std::string set = value_of(environment, "CUDA_DEVICE_MAX_CONNECTIONS");
    const int ours = config::connections_of(config);
    const int connections = set.empty() && ours > 0
                                ? ours
                                : config::driver_connections(set.empty() ? nullptr : set.c_str());
    for (const char* variable : {"LD_PRELOAD", "CUDA_INJECTION64_PATH"})
        for (const std::string& library : words_of(value_of(environment, variable)))
            signs.libraries.push_back(library);
    const auto choice =
        config::choose_dispatch(scheduler, {blocks_launches(environment), serialising_tool(signs)},
                                config::num_tasks(config.chains), connections);
    const std::string asked(config::to_word(scheduler.dispatch.where));
    if (choice.where == Dispatch::kThread) {
        findings.push_back({"dispatch", Verdict::kWarn,
                            fmt::format("{} is asked for, but {}: launches wait in their threads",
                                        asked, choice.why_thread)});
        return;
    }
    const std::string how =
        choice.where == Dispatch::kHost
            ? "a thread of UrgenGo's"
            : fmt::format("the GPU ({})", config::to_word(scheduler.dispatch.device));
    const std::string when =
        choice.where == Dispatch::kAuto ? ", while the host's cores are busy; else threads" : "";
    findings.push_back(
        {"dispatch", Verdict::kOk,
         fmt::format("launches that have to wait go behind gates that {} opens{}", how, when)});
}

}  // namespace

Findings check_preloaded(const Environment& environment, const std::string& interposer,
                         const std::string& preload_file) {
    Findings findings{preloaded("LD_PRELOAD", value_of(environment, "LD_PRELOAD"), interposer)};
    std::ifstream file(preload_file);
    const std::string everywhere{std::istreambuf_iterator<char>(file), {}};
    findings.push_back(preloaded("ld.so.preload", everywhere, interposer));
    if (const std::string tool = value_of(environment, "CUDA_INJECTION64_PATH"); !tool.empty()) {
        findings.push_back({"CUDA tool", Verdict::kWarn,
                            "CUDA_INJECTION64_PATH is " + tool +
                                ": a tool that may change when launches run, and may hold CUPTI: "
                                "`urgengo profile` "
                                "then times by marks"});
    }
    if (const std::string on = value_of(environment, "KINETO_USE_DAEMON");
        !on.empty() && on != "0") {
        findings.push_back({"CUPTI", Verdict::kWarn,
                            "KINETO_USE_DAEMON is " + on +
                                ": PyTorch's profiler may hold CUPTI; `urgengo profile` then times "
                                "by marks"});
    }
    const std::string tool = value_of(environment, "NVTX_INJECTION64_PATH");
    std::error_code ignored;
    if (!tool.empty() && !fs::equivalent(tool, interposer, ignored)) {
        findings.push_back({"NVTX tool", Verdict::kOk,
                            "NVTX_INJECTION64_PATH is " + tool +
                                ": it is behind UrgenGo where a task has NVTX ranges"});
    }
    return findings;
}

Findings check_variables(const Environment& environment, const config::Config& config,
                         ToolSigns signs) {
    Findings findings{connections(environment, config)};
    if (blocks_launches(environment)) {
        findings.push_back({"CUDA_LAUNCH_BLOCKING", Verdict::kWarn,
                            value_of(environment, "CUDA_LAUNCH_BLOCKING") +
                                ": every launch waits for its end; priorities and run-ahead "
                                "have nothing to work on"});
    }
    check_dispatch(environment, config, std::move(signs), findings);
    const EnvironmentCheck ours = check_environment(environment);
    if (!ours.error.empty()) findings.push_back({"variables", Verdict::kBad, ours.error});
    for (const std::string& warning : ours.warnings) {
        findings.push_back({"variables", Verdict::kWarn, warning});
    }
    return findings;
}

}  // namespace urgengo::cli
