// SPDX-License-Identifier: Apache-2.0
#include "host/config/config_reader.h"

#include <cmath>
#include <map>

#include "host/config/file_text.h"
#include "host/config/kernel_pattern.h"
#include "host/config/limits.h"
#include "host/config/presets.h"
#include "host/config/yaml_cursor.h"

namespace urgengo::config {
namespace {

constexpr char kNameAccepted[] = "a name";
constexpr char kDeadlineWord[] = "deadline";  // hold.max_per_instance_ms
constexpr char kKeepWord[] = "keep";          // env.connections
constexpr char kAutoWord[] = "auto";

nanoseconds read_ms(const YamlCursor& yaml, const std::string& note = " (milliseconds)") {
    const double ms = yaml.positive_number(kMaxTimeMs, note);
    const auto time = nanoseconds(std::llround(ms * 1e6));
    if (time.count() == 0) yaml.fail("a number >= 0.000001" + note);
    return time;
}

nanoseconds read_us(const YamlCursor& yaml, Range<std::int64_t> range) {
    return std::chrono::microseconds(yaml.integer(range.min, range.max, " (microseconds)"));
}

std::string read_name(const YamlCursor& yaml) {
    std::string name = yaml.text(kNameAccepted);
    if (name.empty()) yaml.fail(kNameAccepted);
    return name;
}

/// Remembers where each name was first used.
class UniqueNames {
  public:
    void add(const std::string& name, const YamlCursor& yaml) {
        const auto [first, is_new] = lines_.emplace(name, yaml.line());
        if (is_new) return;
        yaml.fail("a name not used before (it is in line " + std::to_string(first->second) + ")");
    }

  private:
    std::map<std::string, int> lines_;
};

std::string read_glob(const std::optional<YamlCursor>& yaml, const std::string& accepted) {
    if (!yaml) return {};
    std::string glob = yaml->text(accepted);
    if (glob.empty()) yaml->fail(accepted);
    return glob;
}

KernelPattern read_kernel_pattern(const YamlCursor& yaml) {
    const std::string accepted = kKernelPatternAccepted;
    const auto pattern = parse_kernel_pattern(yaml.text(accepted));
    if (!pattern) yaml.fail(accepted);
    return pattern.value_or(KernelPattern{});
}

/// One pattern, or a list of them.
std::vector<KernelPattern> read_kernels(const YamlCursor& yaml) {
    if (!yaml.is_list()) return {read_kernel_pattern(yaml)};
    std::vector<KernelPattern> kernels;
    for (const YamlCursor& item : yaml.items("")) kernels.push_back(read_kernel_pattern(item));
    if (kernels.empty()) yaml.complain("found no pattern, accepted: at least one");
    return kernels;
}

Task read_task(const YamlCursor& yaml) {
    yaml.accept_keys({"name", "thread", "nvtx", "kernels"});
    Task task;
    task.name = read_name(yaml.at("name"));
    task.thread_glob =
        read_glob(yaml.find("thread"), "a pattern for thread names, such as \"det_*\"");
    task.nvtx_glob =
        read_glob(yaml.find("nvtx"), "a pattern for NVTX ranges' names, such as \"detect*\"");
    if (const auto kernels = yaml.find("kernels")) task.kernels = read_kernels(*kernels);
    return task;
}

Chain read_chain(const YamlCursor& yaml) {
    yaml.accept_keys({"name", "period_ms", "deadline_ms", "arrival", "mode", "on_late",
                      "criticality", "max_consecutive_misses", "tasks"});
    Chain chain;
    chain.name = read_name(yaml.at("name"));
    chain.period = read_ms(yaml.at("period_ms"));
    chain.deadline = read_ms(yaml.at("deadline_ms"));
    if (const auto on_late = yaml.find("on_late")) chain.on_late = on_late->word<OnLate>();
    if (const auto key = yaml.find("criticality"))
        chain.criticality = static_cast<int>(key->integer(kCriticality.min, kCriticality.max, ""));
    if (const auto key = yaml.find("max_consecutive_misses"))
        chain.max_consecutive_misses = static_cast<int>(
            key->integer(kMaxConsecutiveMisses.min, kMaxConsecutiveMisses.max, ""));
    if (const auto mode = yaml.find("mode")) chain.mode = mode->word<Mode>();
    if (const auto arrival = yaml.find("arrival")) {
        arrival->accept_keys({"from"});
        chain.arrival = arrival->at("from").word<ArrivalFrom>();
    }

    const YamlCursor tasks = yaml.at("tasks");
    UniqueNames names;
    for (const YamlCursor& item : tasks.items("a list of tasks")) {
        chain.tasks.push_back(read_task(item));
        names.add(chain.tasks.back().name, item.at("name"));
    }
    if (chain.tasks.empty()) tasks.complain("found no task, accepted: at least one");
    return chain;
}

std::vector<Chain> read_chains(const YamlCursor& yaml) {
    std::vector<Chain> chains;
    UniqueNames names;
    std::size_t num_tasks = 0;
    for (const YamlCursor& item : yaml.items("a list of chains")) {
        chains.push_back(read_chain(item));
        names.add(chains.back().name, item.at("name"));
        num_tasks += chains.back().tasks.size();
    }
    const auto complain = [&](const std::string& found, std::size_t max) {
        yaml.complain("found " + found + ", accepted: 1 to " + std::to_string(max));
    };
    if (chains.empty()) complain("no chain", kMaxChains);
    if (chains.size() > kMaxChains) complain(std::to_string(chains.size()) + " chains", kMaxChains);
    if (num_tasks > kMaxTasks) complain(std::to_string(num_tasks) + " tasks in all", kMaxTasks);
    return chains;
}

void read_dispatch(const YamlCursor& yaml, Scheduler& s) {
    yaml.accept_keys({"where", "device", "lease_us", "idle_us", "group_us", "most_gates"});
    if (const auto where = yaml.find("where")) s.dispatch.where = where->word<Dispatch>();
    if (const auto device = yaml.find("device")) s.dispatch.device = device->word<DeviceDispatch>();
    if (const auto lease = yaml.find("lease_us")) s.dispatch.lease = read_us(*lease, kLeaseUs);
    if (const auto idle = yaml.find("idle_us")) s.dispatch.idle = read_us(*idle, kLeaseIdleUs);
    if (const auto group = yaml.find("group_us"))
        s.dispatch.gate_group = read_us(*group, kGateGroupUs);
    if (const auto most = yaml.find("most_gates"))
        s.dispatch.most_gates = static_cast<int>(most->integer(kMostGates.min, kMostGates.max, ""));
}

void read_hold(const YamlCursor& yaml, Scheduler& s) {
    yaml.accept_keys({"poll_us", "max_deadlines", "max_per_instance_ms"});
    if (const auto deadlines = yaml.find("max_deadlines"))
        s.hold.max_deadlines = deadlines->number(kHoldDeadlines.min, kHoldDeadlines.max);
    if (const auto poll = yaml.find("poll_us")) s.hold.poll = read_us(*poll, kHoldPollUs);
    if (const auto max = yaml.find("max_per_instance_ms")) {
        const std::string note = " (milliseconds), or the word 'deadline'";
        const bool is_deadline = max->text("a number > 0" + note) == kDeadlineWord;
        s.hold.max_per_instance = is_deadline ? nanoseconds(0) : read_ms(*max, note);
        if (is_deadline) s.hold.max_deadlines = 1;
        if (yaml.find("max_deadlines"))
            max->complain("found beside max_deadlines, accepted: one of the two");
    }
}

void read_copies(const YamlCursor& yaml, Scheduler& s) {
    yaml.accept_keys({"hold", "slice_bytes"});
    if (const auto hold = yaml.find("hold")) s.copies.hold = hold->on_off();
    if (s.copies.hold) s.copies.slice_bytes = kDefaultCopySliceBytes;
    if (const auto slice = yaml.find("slice_bytes")) {
        const std::string note = " (bytes), or 0";
        const bool is_whole = slice->text("a number" + note) == "0";
        s.copies.slice_bytes =
            is_whole ? 0 : slice->integer(kCopySliceBytes.min, kCopySliceBytes.max, note);
    }
}

Scheduler read_preset(const std::optional<YamlCursor>& yaml, const std::string& override) {
    const auto key = yaml ? yaml->find("preset") : std::nullopt;
    const std::string accepted = preset_names();
    Scheduler chosen;
    if (key) {
        // Read even if overridden: a file with an unknown preset is wrong in any case.
        const auto named = preset(key->text(accepted));
        if (!named) key->fail(accepted);
        chosen = named.value_or(chosen);
    }
    return override.empty() ? chosen : preset(override).value_or(chosen);
}

Scheduler read_scheduler(const std::optional<YamlCursor>& yaml, const std::string& override) {
    if (yaml) {
        yaml->accept_keys({"preset",
                           "policy",
                           "binding",
                           "admission",
                           "pack_limit",
                           "hold",
                           "progress",
                           "run_ahead_us",
                           "run_ahead_alone_us",
                           "priority_via",
                           "tracking",
                           "eval_interval_us",
                           "share_limit",
                           "share_slack_us",
                           "priority_levels",
                           "launchers",
                           "lambda",
                           "plan_margin",
                           "exempt_utilization",
                           "urgent_percentile",
                           "quantum_us",
                           "copies",
                           "dispatch",
                           "guard"});
    }
    Scheduler s = read_preset(yaml, override);
    if (!yaml) return s;
    if (const auto key = yaml->find("policy")) s.policy = key->word<Policy>();
    if (const auto key = yaml->find("binding")) s.binding = key->word<Binding>();
    if (const auto key = yaml->find("admission")) s.admission = key->word<Admission>();
    if (const auto key = yaml->find("pack_limit")) {
        s.packing.limit = key->number(kPackLimit.min, kPackLimit.max);
    }
    if (const auto key = yaml->find("priority_levels"))
        s.priority.levels =
            static_cast<int>(key->integer(kPriorityLevels.min, kPriorityLevels.max, ""));
    if (const auto key = yaml->find("launchers"))
        s.packing.launchers = static_cast<int>(key->integer(kLaunchers.min, kLaunchers.max, ""));
    if (const auto key = yaml->find("lambda"))
        s.parameters.lambda = key->number(kLambda.min, kLambda.max);
    if (const auto key = yaml->find("share_limit"))
        s.packing.share_limit = key->number(kPackLimit.min, kPackLimit.max);
    if (const auto key = yaml->find("share_slack_us"))
        s.packing.share_slack = read_us(*key, kShareSlackUs);
    if (const auto key = yaml->find("plan_margin"))
        s.parameters.plan_margin = key->number(kPlanMargin.min, kPlanMargin.max);
    if (const auto key = yaml->find("exempt_utilization"))
        s.parameters.exempt_utilization =
            key->number(kExemptUtilization.min, kExemptUtilization.max);
    if (const auto key = yaml->find("urgent_percentile"))
        s.parameters.urgent_percentile = key->number(kUrgentPercentile.min, kUrgentPercentile.max);
    if (const auto key = yaml->find("quantum_us")) s.parameters.quantum = read_us(*key, kQuantumUs);
    if (const auto key = yaml->find("hold")) read_hold(*key, s);
    if (const auto key = yaml->find("progress")) {
        key->accept_keys({"source", "every_us", "learn"});
        if (const auto source = key->find("source"))
            s.progress.source = source->word<ProgressSource>();
        if (const auto every = key->find("every_us"))
            s.progress.mark_every = read_us(*every, kMarkEveryUs);
        if (const auto learn = key->find("learn")) s.progress.learn = learn->on_off();
    }
    if (const auto key = yaml->find("run_ahead_us")) s.run_ahead.limit = read_us(*key, kRunAheadUs);
    if (const auto key = yaml->find("run_ahead_alone_us"))
        s.run_ahead.alone = read_us(*key, kRunAheadUs);
    if (const auto key = yaml->find("priority_via")) s.priority.via = key->word<PriorityVia>();
    if (const auto key = yaml->find("tracking")) s.progress.tracking = key->word<Tracking>();
    if (const auto key = yaml->find("eval_interval_us"))
        s.progress.eval_interval = read_us(*key, kEvalIntervalUs);
    if (const auto key = yaml->find("copies")) read_copies(*key, s);
    if (const auto key = yaml->find("dispatch")) read_dispatch(*key, s);
    if (const auto key = yaml->find("guard")) s.guard = key->on_off();
    return s;
}

int read_connections(const YamlCursor& yaml, int default_connections) {
    yaml.accept_keys({"connections"});
    const auto key = yaml.find("connections");
    if (!key) return default_connections;
    const std::string note = ", or a word: 'auto' or 'keep'";
    const std::string text = key->text("a whole number from 1 to 32" + note);
    if (text == kKeepWord) return 0;
    if (text == kAutoWord) return kAutoConnections;
    return static_cast<int>(key->integer(kConnections.min, kConnections.max, note));
}

Config config_from_yaml(const YamlCursor& root, const std::string& preset_override) {
    root.accept_keys({"version", "mode", "chains", "scheduler", "cpu", "env", "nvtx"});
    Config config;
    if (root.at("version").text("1") != "1") root.at("version").fail("1");
    if (const auto mode = root.find("mode")) config.mode = mode->word<Mode>();
    config.chains = read_chains(root.at("chains"));
    config.scheduler = read_scheduler(root.find("scheduler"), preset_override);
    if (const auto nvtx = root.find("nvtx")) config.nvtx = nvtx->word<NvtxEvents>();
    if (const auto cpu = root.find("cpu")) {
        cpu->accept_keys({"blocking_sync", "nice"});
        if (const auto key = cpu->find("blocking_sync")) config.blocking_sync = key->on_off();
        if (const auto key = cpu->find("nice"))
            config.nice = static_cast<int>(key->integer(kNice.min, kNice.max, ""));
    }
    if (const auto env = root.find("env")) {
        config.connections = read_connections(*env, config.connections);
    }
    return config;
}

}  // namespace

Result<Config> parse_config(const std::string& text, const std::string& file,
                            const std::string& preset_override) {
    if (!preset_override.empty() && !preset(preset_override)) {
        return Error{"preset: found '" + preset_override + "', accepted: " + preset_names()};
    }
    const Result<YAML::Node> root = parse_yaml(text, file);
    if (!root) return Error{root.error()};
    YamlFault fault{file, {}};
    Config config = config_from_yaml(YamlCursor(*root, fault), preset_override);
    if (!fault.message.empty()) return Error{fault.message};
    return config;
}

Result<Config> read_config(const std::string& path, const std::string& preset_override) {
    const Result<std::string> text = read_file(path);
    if (!text) return Error{text.error()};
    return parse_config(*text, path, preset_override);
}

}  // namespace urgengo::config
