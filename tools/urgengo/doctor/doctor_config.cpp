// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/doctor/doctor_config.h"

#include <fmt/format.h>

#include <filesystem>
#include <system_error>

#include "host/config/names.h"
#include "host/config/profile_reader.h"
#include "host/config/progress_choice.h"
#include "host/config/resolved_config.h"
#include "host/config/task_count.h"
#include "tools/urgengo/profile_table.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

Finding priority_via(const config::Config& config, const std::optional<PriorityChoice>& priority) {
    const char* const topic = "priority_via";
    const config::PriorityVia via = config.scheduler.priority.via;
    if (via != config::PriorityVia::kAuto) return {topic, Verdict::kOk, config::to_word(via)};
    if (config.scheduler.binding == config::Binding::kNone) {
        return {topic, Verdict::kOk, "auto; nothing gets a priority (binding: none)"};
    }
    if (!priority) {
        return {topic, Verdict::kOk,
                "auto: " + config::to_word(PriorityChoice{}.via) + ", without a measurement"};
    }
    return {topic, Verdict::kOk,
            "auto: " + config::to_word(priority->via) + ", " + priority->reason};
}

Finding progress_source(const config::Config& config, const GpuFacts* gpu) {
    using config::ProgressSource;
    const char* const topic = "progress.source";
    const ProgressSource asked = config.scheduler.progress.source;
    const ProgressSource source = config::choose_source(asked);
    std::string text = (asked == ProgressSource::kAuto ? "auto: " : "") + config::to_word(source);
    if (!gpu || gpu->devices.empty()) return {topic, Verdict::kOk, text};
    const GpuDevice& device = gpu->devices[0];
    if (source == ProgressSource::kKernel) {
        text += fmt::format("{} (compute capability {}.{})",
                            config::marks_overlap(device.compute_major)
                                ? ", launched with programmatic serialisation"
                                : ", launched plainly",
                            device.compute_major, device.compute_minor);
    }
    if (source == ProgressSource::kMemop && !gpu->memory_operation_problem.empty()) {
        return {topic, Verdict::kWarn,
                text + ": " + gpu->memory_operation_problem + "; kernel is used"};
    }
    return {topic, Verdict::kOk, text};
}

Finding tracking(const config::Scheduler& scheduler) {
    using config::Tracking;
    const std::string word = config::to_word(scheduler.progress.tracking);
    const auto interval_us = scheduler.progress.eval_interval / std::chrono::microseconds(1);
    const auto comes_to = [&]() -> std::string {
        switch (scheduler.progress.tracking) {
            case Tracking::kProgress:
                return "marks tell how far the GPU is";
            case Tracking::kAsync:
                return "what has been launched counts as executed";
            case Tracking::kSync:
                return "the thread waits for every launch";
            case Tracking::kBatched:
                return fmt::format("the thread waits every {} us of GPU time", interval_us);
            case Tracking::kOverlapped:
                return fmt::format("the thread waits, a batch late, every {} us of GPU time",
                                   interval_us);
        }
        return {};
    };
    const bool is_default = scheduler.progress.tracking == Tracking::kProgress;
    return {"tracking", is_default ? Verdict::kOk : Verdict::kWarn,
            word + ": " + comes_to() + (is_default ? "" : "; for comparisons")};
}

}  // namespace

Findings check_config(const std::string& file, const Result<config::Config>& config) {
    if (!config) return {{"config", Verdict::kBad, config.error()}};
    if (file.empty()) {
        return {{"config", Verdict::kOk,
                 "no chains.yaml here; what follows are the defaults (`urgengo discover` drafts "
                 "one)"}};
    }
    const std::size_t tasks = config::num_tasks(config->chains);
    const bool is_off = config->mode == config::Mode::kOff;
    return {
        {"config", is_off ? Verdict::kWarn : Verdict::kOk,
         fmt::format("{}: {} chains, {} tasks, preset {}, mode {}{}", file, config->chains.size(),
                     tasks, config->scheduler.preset, config::to_word(config->mode),
                     is_off ? ": programs run as if UrgenGo were not there" : "")}};
}

Findings explain_choices(const config::Config& config,
                         const std::optional<PriorityChoice>& priority, const GpuFacts* gpu) {
    const auto hold_ms = static_cast<double>(config.scheduler.hold.max_per_instance.count()) / 1e6;
    return {priority_via(config, priority),
            tracking(config.scheduler),
            progress_source(config, gpu),
            {"hold", Verdict::kOk,
             hold_ms > 0 ? fmt::format("for {} ms of an instance at most", hold_ms)
                         : fmt::format("for {} times each chain's own deadline at most",
                                       config.scheduler.hold.max_deadlines)},
            {"blocking_sync", Verdict::kOk,
             config.blocking_sync ? "on: waits of the program sleep instead of spinning"
                                  : "off: waits of the program are as it asks for them"}};
}

Findings check_profile(const std::string& yaml, const config::Config& config,
                       const config::RunTarget& target) {
    const char* const topic = "profile";
    const std::string path = config::profile_sibling(yaml);
    std::error_code ignored;
    if (!fs::exists(path, ignored)) {
        return {{topic, Verdict::kWarn,
                 path + " is not there: times are learned while the program runs (`urgengo "
                        "profile` writes it)"}};
    }
    const auto profile = config::read_profile(path);
    if (!profile) return {{topic, Verdict::kBad, profile.error()}};
    const config::ProfileMatch match = profile_matches(*profile, target);
    Findings findings;
    for (const std::string& text : match.refusals) {
        findings.push_back({topic, Verdict::kBad, path + ": " + text + " (profile again)"});
    }
    for (const std::string& text : match.warnings) {
        findings.push_back({topic, Verdict::kWarn, path + ": " + text});
    }
    for (const std::string& text : config::profile_warnings(config, *profile)) {
        findings.push_back({topic, Verdict::kWarn, text});
    }
    if (findings.empty()) findings.push_back({topic, Verdict::kOk, path});
    for (const Finding& finding : check_launching(*profile)) findings.push_back(finding);
    return findings;
}

Findings check_launching(const config::Profile& profile) {
    if (profile.program.rfind("python", 0) != 0) return {};
    std::size_t num_tasks = 0, num_bound = 0;
    for (const config::ChainProfile& chain : profile.chains) {
        num_tasks += chain.tasks.size();
        for (const config::TaskProfile& task : chain.tasks) num_bound += bound_by(task) == "launch";
    }
    if (num_bound < 2) return {};
    return {{"launching", Verdict::kWarn,
             fmt::format("{} of {} tasks take longer to launch than to execute, and share Python's "
                         "lock: near what it lets through, frames are late with any scheduler "
                         "(CUDA graphs, or fewer and larger kernels, need less of it)",
                         num_bound, num_tasks)}};
}

}  // namespace urgengo::cli
