// SPDX-License-Identifier: Apache-2.0
#include "host/config/resolved_config.h"

#include <exception>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "host/base/hash.h"
#include "host/config/file_text.h"
#include "host/config/hex.h"
#include "host/config/json_cursor.h"
#include "host/config/kernel_pattern.h"
#include "host/config/limits.h"
#include "host/config/names.h"
#include "host/config/profile_json.h"

namespace urgengo::config {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr std::int64_t kFormatVersion = 2;
constexpr std::int64_t kNsPerUs = 1'000;

nanoseconds time_from_json(const JsonCursor& json, Range<std::int64_t> range_us) {
    return json.time_ns(range_us.min * kNsPerUs, range_us.max * kNsPerUs);
}

Json scheduler_to_json(const Scheduler& s) {
    Json json = {{"preset", s.preset},
                 {"policy", to_word(s.policy)},
                 {"binding", to_word(s.binding)},
                 {"admission", to_word(s.admission)},
                 {"pack_limit", s.packing.limit},
                 {"priority_levels", s.priority.levels},
                 {"launchers", s.packing.launchers},
                 {"lambda", s.parameters.lambda},
                 {"share_limit", s.packing.share_limit},
                 {"share_slack_ns", s.packing.share_slack.count()},
                 {"plan_margin", s.parameters.plan_margin},
                 {"exempt_utilization", s.parameters.exempt_utilization},
                 {"urgent_percentile", s.parameters.urgent_percentile},
                 {"quantum_ns", s.parameters.quantum.count()},
                 {"hold_poll_ns", s.hold.poll.count()},
                 {"hold_max_per_instance_ns", s.hold.max_per_instance.count()},
                 {"hold_max_deadlines", s.hold.max_deadlines},
                 {"run_ahead_ns", s.run_ahead.limit.count()},
                 {"run_ahead_alone_ns", s.run_ahead.alone.count()},
                 {"progress_source", to_word(s.progress.source)},
                 {"tracking", to_word(s.progress.tracking)},
                 {"eval_interval_ns", s.progress.eval_interval.count()},
                 {"learn", s.progress.learn},
                 {"hold_copies", s.copies.hold},
                 {"copy_slice_bytes", s.copies.slice_bytes},
                 {"dispatch", to_word(s.dispatch.where)},
                 {"device_dispatch", to_word(s.dispatch.device)},
                 {"lease_ns", s.dispatch.lease.count()},
                 {"lease_idle_ns", s.dispatch.idle.count()},
                 {"gate_group_ns", s.dispatch.gate_group.count()},
                 {"most_gates", s.dispatch.most_gates},
                 {"guard", s.guard},
                 {"priority_via", to_word(s.priority.via)}};
    if (s.progress.mark_every) json["mark_every_ns"] = s.progress.mark_every->count();
    return json;
}

Scheduler scheduler_from_json(const JsonCursor& json) {
    Scheduler s;
    s.preset = json.at("preset").name();
    s.policy = json.at("policy").word<Policy>();
    s.binding = json.at("binding").word<Binding>();
    s.admission = json.at("admission").word<Admission>();
    s.packing.limit = json.at("pack_limit").number(kPackLimit.min, kPackLimit.max);
    s.hold.poll = time_from_json(json.at("hold_poll_ns"), kHoldPollUs);
    s.hold.max_per_instance = json.at("hold_max_per_instance_ns").time_ns(0, kMaxTimeNs);
    s.run_ahead.limit = time_from_json(json.at("run_ahead_ns"), kRunAheadUs);
    if (const auto every = json.find("mark_every_ns"))
        s.progress.mark_every = time_from_json(*every, kMarkEveryUs);
    // Absent from files that an older version wrote, as blocking_sync below.
    if (const auto alone = json.find("run_ahead_alone_ns"))
        s.run_ahead.alone = time_from_json(*alone, kRunAheadUs);
    const auto deadlines = json.find("hold_max_deadlines");
    s.hold.max_deadlines =
        deadlines ? deadlines->number(kHoldDeadlines.min, kHoldDeadlines.max) : 1;
    if (const auto levels = json.find("priority_levels"))
        s.priority.levels =
            static_cast<int>(levels->integer(kPriorityLevels.min, kPriorityLevels.max));
    if (const auto launchers = json.find("launchers"))
        s.packing.launchers = static_cast<int>(launchers->integer(kLaunchers.min, kLaunchers.max));
    if (const auto lambda = json.find("lambda"))
        s.parameters.lambda = lambda->number(kLambda.min, kLambda.max);
    if (const auto limit = json.find("share_limit"))
        s.packing.share_limit = limit->number(kPackLimit.min, kPackLimit.max);
    if (const auto slack = json.find("share_slack_ns"))
        s.packing.share_slack = time_from_json(*slack, kShareSlackUs);
    if (const auto margin = json.find("plan_margin"))
        s.parameters.plan_margin = margin->number(kPlanMargin.min, kPlanMargin.max);
    if (const auto exempt = json.find("exempt_utilization"))
        s.parameters.exempt_utilization =
            exempt->number(kExemptUtilization.min, kExemptUtilization.max);
    if (const auto percentile = json.find("urgent_percentile"))
        s.parameters.urgent_percentile =
            percentile->number(kUrgentPercentile.min, kUrgentPercentile.max);
    if (const auto quantum = json.find("quantum_ns"))
        s.parameters.quantum = time_from_json(*quantum, kQuantumUs);
    if (const auto source = json.find("progress_source"))
        s.progress.source = source->word<ProgressSource>();
    if (const auto learn = json.find("learn")) s.progress.learn = learn->boolean();
    if (const auto hold = json.find("hold_copies")) s.copies.hold = hold->boolean();
    if (const auto slice = json.find("copy_slice_bytes")) {
        s.copies.slice_bytes = slice->integer(0, kCopySliceBytes.max);
        if (s.copies.slice_bytes != 0) slice->integer(kCopySliceBytes.min, kCopySliceBytes.max);
    }
    if (const auto dispatch = json.find("dispatch")) s.dispatch.where = dispatch->word<Dispatch>();
    if (const auto device = json.find("device_dispatch"))
        s.dispatch.device = device->word<DeviceDispatch>();
    if (const auto lease = json.find("lease_ns"))
        s.dispatch.lease = time_from_json(*lease, kLeaseUs);
    if (const auto idle = json.find("lease_idle_ns"))
        s.dispatch.idle = time_from_json(*idle, kLeaseIdleUs);
    if (const auto group = json.find("gate_group_ns"))
        s.dispatch.gate_group = time_from_json(*group, kGateGroupUs);
    if (const auto most = json.find("most_gates"))
        s.dispatch.most_gates = static_cast<int>(most->integer(kMostGates.min, kMostGates.max));
    const auto guard = json.find("guard");
    s.guard = guard ? guard->boolean() : s.preset == "urgengo";
    if (const auto via = json.find("priority_via")) s.priority.via = via->word<PriorityVia>();
    if (const auto tracking = json.find("tracking"))
        s.progress.tracking = tracking->word<Tracking>();
    if (const auto interval = json.find("eval_interval_ns"))
        s.progress.eval_interval = time_from_json(*interval, kEvalIntervalUs);
    return s;
}

Json task_to_json(const Task& task) {
    Json kernels = Json::array();
    for (const KernelPattern& kernel : task.kernels) kernels.push_back(to_text(kernel));
    return {{"name", task.name},
            {"thread", task.thread_glob},
            {"nvtx", task.nvtx_glob},
            {"kernels", std::move(kernels)}};
}

Task task_from_json(const JsonCursor& json) {
    Task task;
    task.name = json.at("name").name();
    task.thread_glob = json.at("thread").text();
    task.nvtx_glob = json.at("nvtx").text();
    for (const JsonCursor& kernel : json.at("kernels").items()) {
        const auto pattern = parse_kernel_pattern(kernel.text());
        if (!pattern) kernel.fail(kKernelPatternAccepted);
        task.kernels.push_back(pattern.value_or(KernelPattern{}));
    }
    return task;
}

Json chain_to_json(const Chain& chain) {
    Json tasks = Json::array();
    for (const Task& task : chain.tasks) tasks.push_back(task_to_json(task));
    return {{"name", chain.name},
            {"period_ns", chain.period.count()},
            {"deadline_ns", chain.deadline.count()},
            {"arrival", to_word(chain.arrival)},
            {"mode", to_word(chain.mode)},
            {"on_late", to_word(chain.on_late)},
            {"criticality", chain.criticality},
            {"max_consecutive_misses", chain.max_consecutive_misses},
            {"tasks", std::move(tasks)}};
}

Chain chain_from_json(const JsonCursor& json) {
    Chain chain;
    chain.name = json.at("name").name();
    chain.period = json.at("period_ns").time_ns(1, kMaxTimeNs);
    chain.deadline = json.at("deadline_ns").time_ns(1, kMaxTimeNs);
    chain.arrival = json.at("arrival").word<ArrivalFrom>();
    chain.mode = json.at("mode").word<Mode>();
    chain.on_late = json.at("on_late").word<OnLate>();
    if (const auto criticality = json.find("criticality"))
        chain.criticality =
            static_cast<int>(criticality->integer(kCriticality.min, kCriticality.max));
    if (const auto most = json.find("max_consecutive_misses"))
        chain.max_consecutive_misses =
            static_cast<int>(most->integer(kMaxConsecutiveMisses.min, kMaxConsecutiveMisses.max));
    for (const JsonCursor& task : json.at("tasks").items()) {
        chain.tasks.push_back(task_from_json(task));
    }
    if (chain.tasks.empty()) json.at("tasks").fail("at least one task");
    return chain;
}

Json config_to_json(const Config& config) {
    Json chains = Json::array();
    for (const Chain& chain : config.chains) chains.push_back(chain_to_json(chain));
    Json json = {{"version", config.version},
                 {"mode", to_word(config.mode)},
                 {"connections", config.connections},
                 {"blocking_sync", config.blocking_sync},
                 {"nvtx", to_word(config.nvtx)},
                 {"chains", std::move(chains)},
                 {"scheduler", scheduler_to_json(config.scheduler)}};
    if (config.nice) json["nice"] = *config.nice;
    return json;
}

Config config_from_json(const JsonCursor& json) {
    Config config;
    config.version = static_cast<int>(json.at("version").integer(1, 1));
    config.mode = json.at("mode").word<Mode>();
    config.connections =
        static_cast<int>(json.at("connections").integer(kAutoConnections, kConnections.max));
    if (const auto blocking = json.find("blocking_sync")) {
        config.blocking_sync = blocking->boolean();
    }
    if (const auto nice = json.find("nice"))
        config.nice = static_cast<int>(nice->integer(kNice.min, kNice.max));
    if (const auto nvtx = json.find("nvtx")) config.nvtx = nvtx->word<NvtxEvents>();
    config.scheduler = scheduler_from_json(json.at("scheduler"));

    const JsonCursor chains = json.at("chains");
    std::size_t num_tasks = 0;
    for (const JsonCursor& chain : chains.items()) {
        config.chains.push_back(chain_from_json(chain));
        num_tasks += config.chains.back().tasks.size();
    }
    // `urgengo discover` watches a program that no chain is known of.
    const bool too_few = config.chains.empty() && config.mode != Mode::kObserve;
    if (too_few || config.chains.size() > kMaxChains || num_tasks > kMaxTasks) {
        chains.fail("1 to 256 chains with up to 256 tasks in all");
    }
    return config;
}

ResolvedConfig resolved_from_json(const JsonCursor& root) {
    ResolvedConfig resolved;
    root.at("format_version").integer(kFormatVersion, kFormatVersion);
    resolved.config = config_from_json(root.at("config"));
    if (const auto profile = root.find("profile")) resolved.profile = profile_from_json(*profile);
    for (const JsonCursor& source : root.at("sources").items()) {
        resolved.source.push_back({source.at("path").name(), source.at("fnv1a64").hash()});
    }
    return resolved;
}

std::string sibling(const std::string& yaml_path, const char* suffix) {
    fs::path path(yaml_path);
    path.replace_extension();
    return path.string() + suffix;
}

/// @returns why the resolved file is not what its sources say today; empty if it is
std::string why_stale(const ResolvedConfig& resolved, const std::string& resolved_path,
                      const std::string& yaml_path) {
    const fs::path folder = fs::path(resolved_path).parent_path();
    bool names_yaml = false;
    for (const SourceFile& source : resolved.source) {
        const fs::path path = folder / source.path;  // an absolute source.path stands for itself
        const Result<std::string> text = read_file(path.string());
        if (!text) return text.error();
        if (fnv1a64(*text) != source.hash) return path.string() + " has changed since";
        std::error_code ignored;
        names_yaml = names_yaml || fs::equivalent(path, yaml_path, ignored);
    }
    if (!names_yaml) return "it was made from another file";
    std::error_code ignored;
    if (!resolved.profile && fs::exists(profile_sibling(yaml_path), ignored)) {
        return profile_sibling(yaml_path) + " has appeared since";
    }
    return {};
}

Error needs_resolving(const std::string& yaml_path, const std::string& why) {
    return Error{yaml_path + ": no up-to-date resolved config (" + why +
                 "); write it with: urgengo run -c " + yaml_path + " -- program"};
}

Result<ResolvedConfig> load_resolved(const std::string& path, const ReadFile& read) {
    const Result<std::string> text = read(path);
    if (!text) return Error{text.error()};
    return parse_resolved_json(*text, path);
}

Result<ResolvedConfig> load_sibling_of(const std::string& yaml_path, const ReadFile& read) {
    std::error_code ignored;
    if (!fs::exists(yaml_path, ignored)) return Error{yaml_path + ": cannot be read: no such file"};
    const std::string path = resolved_sibling(yaml_path);
    Result<ResolvedConfig> resolved = load_resolved(path, read);
    if (!resolved) return needs_resolving(yaml_path, resolved.error());
    const std::string stale = why_stale(*resolved, path, yaml_path);
    if (!stale.empty()) return needs_resolving(yaml_path, stale);
    return resolved;
}

}  // namespace

std::string to_resolved_json(const Config& config, const Profile* profile,
                             const SourceStamp& source) {
    Json sources = Json::array();
    for (const SourceFile& file : source) {
        sources.push_back({{"path", file.path}, {"fnv1a64", to_hex(file.hash)}});
    }
    Json root = {{"format_version", kFormatVersion},
                 {"sources", std::move(sources)},
                 {"config", config_to_json(config)}};
    if (profile) root["profile"] = profile_to_json(*profile);
    // Names need not be UTF-8; replacing is better than throwing.
    return root.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

Result<ResolvedConfig> parse_resolved_json(std::string_view text,
                                           const std::string& file_name_for_errors) {
    try {
        const Result<Json> root = parse_json(text, file_name_for_errors);
        if (!root) return Error{root.error()};
        JsonFault fault{file_name_for_errors, {}};
        ResolvedConfig resolved = resolved_from_json(JsonCursor(*root, fault));
        if (!fault.message.empty()) return Error{fault.message};
        return resolved;
    } catch (const std::exception& e) {
        return Error{file_name_for_errors + ": cannot be read: " + e.what()};
    }
}

Result<ResolvedConfig> load_for_interposer(const std::string& path, const ReadFile& read) {
    try {
        const std::string extension = fs::path(path).extension().string();
        if (extension == ".json") return load_resolved(path, read);
        if (extension == ".yaml" || extension == ".yml") return load_sibling_of(path, read);
        return Error{path + ": found the extension '" + extension +
                     "', accepted: .yaml, .yml, or .json (a resolved config)"};
    } catch (const std::exception& e) {
        return Error{path + ": cannot be read: " + e.what()};
    }
}

std::string resolved_sibling(const std::string& yaml_path) {
    return sibling(yaml_path, ".resolved.json");
}

std::string profile_sibling(const std::string& yaml_path) {
    return sibling(yaml_path, ".profile.json");
}

}  // namespace urgengo::config
