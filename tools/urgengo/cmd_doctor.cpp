// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_doctor.h"

#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "host/config/config_reader.h"
#include "host/config/names.h"
#include "interposer/driver_file.h"
#include "tools/urgengo/doctor/doctor_config.h"
#include "tools/urgengo/doctor/doctor_environment.h"
#include "tools/urgengo/doctor/doctor_gpu.h"
#include "tools/urgengo/doctor/doctor_program.h"
#include "tools/urgengo/doctor/doctor_report.h"
#include "tools/urgengo/doctor/doctor_rights.h"
#include "tools/urgengo/doctor/priority_probe.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/program/program_setup.h"
#include "tools/urgengo/program/pruned_library.h"
#include "tools/urgengo/progress_bar.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

constexpr char kPreloadFile[] = "/etc/ld.so.preload";
constexpr char kMigCapabilities[] = "/proc/driver/nvidia/capabilities";
constexpr std::chrono::seconds kFactsLimit{30};

std::string cuda_text(int version) {
    return fmt::format("{}.{}", version / 1000, version % 1000 / 10);
}

/// Measures anew, and leaves the answer for `urgengo run`.
Result<PriorityMeasurement> measure(const PriorityKey& key, const std::string& driver,
                                    const Environment& environment, Findings& findings) {
    const auto measured = probe_priority(driver, kPriorityLimit);
    if (!measured) return measured;
    const auto stored = PriorityCache(cache_folder(environment)).store(key, *measured);
    if (!stored) findings.push_back({"cache", Verdict::kWarn, stored.error()});
    return measured;
}

/// What is known of the GPU when all questions are answered.
struct GpuAnswers {
    Findings findings;
    std::optional<GpuFacts> facts;
    config::RunTarget target;
    std::optional<PriorityChoice> priority;
};

GpuAnswers ask_gpu(const std::string& driver, const Environment& environment, bool no_probe) {
    GpuAnswers answers;
    ProgressBar bar;
    bar.show(-1, "asking the driver");
    const auto facts = find_gpu_facts(driver, kFactsLimit);
    answers.findings = check_gpu(facts);
    if (!facts || facts->devices.empty()) return answers;
    answers.facts = *facts;
    const std::string& name = facts->devices[0].name;
    const std::string cuda = cuda_text(facts->cuda_version);
    answers.target = {name, cuda, 0, 0, ""};
    append(answers.findings, check_mig(*facts, kMigCapabilities));
    append(answers.findings, check_mps(environment));
    if (!facts->context_problem.empty()) return answers;
    std::optional<Result<PriorityMeasurement>> measured;
    if (!no_probe) {
        bar.show(-1, "measuring which priorities the GPU honours");
        measured = measure(priority_key(name, cuda, driver), driver, environment, answers.findings);
        answers.priority = choose_priority(*measured);
    }
    append(answers.findings, check_priority(*facts, measured));
    return answers;
}

void print_json(const Findings& findings, const config::Config& config,
                const std::optional<PriorityChoice>& priority) {
    nlohmann::json report = to_json(findings);
    report["format_version"] = 1;
    const config::PriorityVia via = config.scheduler.priority.via;
    const bool is_auto = via == config::PriorityVia::kAuto;
    report["priority_via"] = config::to_word(is_auto && priority ? priority->via : via);
    report["urgengo"] = fmt::format("{} ({})", kVersion, kCommit);
    fmt::print("{}\n", report.dump(2, ' ', false, nlohmann::json::error_handler_t::replace));
}

}  // namespace

CLI::App* add_doctor(CLI::App& app, DoctorOptions& options) {
    CLI::App* command =
        app.add_subcommand("doctor", "Show what this machine allows, and what would be used");
    command->footer(
        "After the options, if you like: -- program [args...], which is looked at and not "
        "started.\n"
        "Exit status: 0 UrgenGo can schedule (warnings or not), 1 something prevents it, 2 wrong "
        "usage.");
    command->add_option("-c,--config", options.config, "The chains [chains.yaml, if it exists]");
    command->add_flag("--json", options.json, "Print JSON");
    command->add_flag("--no-probe", options.no_probe,
                      "Do not measure which priorities the GPU honours (it is busy for a quarter "
                      "of a second)");
    command->add_option("--real-libcuda", options.real_libcuda,
                        "The driver's library, instead of searching for it");
    return command;
}

int cmd_doctor(const DoctorOptions& options, const std::vector<std::string>& program) {
    const Environment environment = current_environment();
    const auto interposer = interposer_library();
    const std::string ours = interposer ? *interposer : "";
    Findings findings = check_library(interposer);

    ProgramFindings checked = check_program_file(program, environment);
    const std::string library_path = value_of(environment, "LD_LIBRARY_PATH");
    const std::string driver = interposer::find_driver_file(
        choose_driver(options.real_libcuda, environment, checked.driver, ours),
        library_path.empty() ? nullptr : library_path.c_str());
    append(findings, check_driver_file(driver, ours));
    append(findings, check_nvtx_tools(driver, ours, environment));

    config::RunTarget target;
    std::optional<PriorityChoice> priority;
    std::optional<GpuFacts> gpu;
    if (!driver.empty()) {
        GpuAnswers answers = ask_gpu(driver, environment, options.no_probe);
        append(findings, std::move(answers.findings));
        target = answers.target;
        priority = answers.priority;
        gpu = answers.facts;
    }
    target.program = checked.name;

    std::string yaml = options.config;
    if (yaml.empty() && fs::exists(kDefaultConfig)) yaml = kDefaultConfig;
    const Result<config::Config> config =
        yaml.empty() ? Result<config::Config>(config::Config{}) : config::read_config(yaml);
    const config::Config used = config ? *config : config::Config{};
    append(findings, check_variables(environment, used, tool_signs()));
    append(findings, check_preloaded(environment, ours, kPreloadFile));
    append(findings, check_rights(used.nice));
    append(findings, std::move(checked.findings));
    append(findings, check_config(yaml, config));
    if (config) append(findings, explain_choices(used, priority, gpu ? &*gpu : nullptr));
    if (config && !yaml.empty()) append(findings, check_profile(yaml, used, target));

    if (options.json) {
        print_json(findings, used, priority);
    } else {
        fmt::print("{}", to_text(findings));
    }
    return worst(findings) == Verdict::kBad ? kExitFailure : 0;
}

}  // namespace urgengo::cli
