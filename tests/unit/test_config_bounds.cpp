// SPDX-License-Identifier: Apache-2.0
//
// chains.yaml: values and their bounds, keys that are unknown, missing or doubled, and their lines.
#include "tests/support/config_texts.h"

namespace urgengo::config {
namespace {

using namespace std::chrono_literals;

TEST_CASE("Config error names line, path, found and accepted when a value is wrong",
          "[unit][config]") {
    const std::string ms = ", accepted: a number > 0 (milliseconds)";
    CHECK(error_of(with_line(4, "    period_ms: abc")) ==
          "c.yaml:4: chains[0].period_ms: found 'abc'" + ms);
    CHECK(error_of(with_line(4, "    period_ms: 12ms")) ==
          "c.yaml:4: chains[0].period_ms: found '12ms'" + ms);
    CHECK(error_of(with_line(4, "    period_ms: 0")) ==
          "c.yaml:4: chains[0].period_ms: found '0'" + ms);
    CHECK(error_of(with_line(4, "    period_ms: -1")) ==
          "c.yaml:4: chains[0].period_ms: found '-1'" + ms);
    CHECK(error_of(with_line(4, "    period_ms: nan")) ==
          "c.yaml:4: chains[0].period_ms: found 'nan'" + ms);
    CHECK(error_of(with_line(4, "    period_ms: 1e-9")) ==
          "c.yaml:4: chains[0].period_ms: found '1e-9', accepted: a number >= 0.000001 "
          "(milliseconds)");
    CHECK(error_of(with_line(5, "    deadline_ms: 1e9")) ==
          "c.yaml:5: chains[0].deadline_ms: found '1e9', accepted: a number > 0 and at most "
          "86400000 (milliseconds)");
    CHECK(error_of(with_line(5, "    deadline_ms: inf")) ==
          "c.yaml:5: chains[0].deadline_ms: found 'inf', accepted: a number > 0 and at most "
          "86400000 (milliseconds)");
    CHECK(error_of(with_line(1, "version: 2")) == "c.yaml:1: version: found '2', accepted: 1");
    CHECK(error_with("mode: on\n") ==
          "c.yaml:9: mode: found 'on', accepted: off, observe, shadow, enforce");
    CHECK(error_of(with_line(5, "    deadline_ms: 9\n    on_late: drop")) ==
          "c.yaml:6: chains[0].on_late: found 'drop', accepted: continue, demote, exit");
    CHECK(error_of(with_line(7, "      - {name: detect, thread: \"\"}")) ==
          "c.yaml:7: chains[0].tasks[0].thread: found '', accepted: a pattern for thread names, "
          "such as \"det_*\"");
    CHECK(error_of(with_line(3, "  - name: ''")) ==
          "c.yaml:3: chains[0].name: found '', accepted: a name");
}

TEST_CASE("Config error names the accepted range when a scheduler key is out of it",
          "[unit][config]") {
    const auto error = [](const std::string& keys) {
        return error_with("scheduler:\n  " + keys + "\n");
    };
    CHECK(error("preset: best") ==
          "c.yaml:10: scheduler.preset: found 'best', accepted: urgengo, urgency, edf, eqdf, "
          "saedf, lcuf, "
          "sjf, hrrn, static, fifo, paper, paper_binding, paper_delay, paam, dcuda, vanilla");
    CHECK(error("policy: rm") ==
          "c.yaml:10: scheduler.policy: found 'rm', accepted: feasible, urgency, edf, "
          "eqdf, saedf, lcuf, sjf, hrrn, static, fifo, utilization");
    CHECK(error("binding: thread") ==
          "c.yaml:10: scheduler.binding: found 'thread', accepted: none, task, kernel, static");
    CHECK(error("admission: all") ==
          "c.yaml:10: scheduler.admission: found 'all', accepted: none, threshold, packed, "
          "exclusive, buckets, groups");
    CHECK(error("pack_limit: 11") ==
          "c.yaml:10: scheduler.pack_limit: found '11', accepted: a number from 0.1 to 10");
    CHECK(error("pack_limit: 0.05") ==
          "c.yaml:10: scheduler.pack_limit: found '0.05', accepted: a number from 0.1 to 10");
    CHECK(error("hold: {poll_us: 5}") ==
          "c.yaml:10: scheduler.hold.poll_us: found '5', accepted: a whole number from 10 to 10000 "
          "(microseconds)");
    CHECK(error("hold: {poll_us: 50.5}") ==
          "c.yaml:10: scheduler.hold.poll_us: found '50.5', accepted: a whole number from 10 to "
          "10000 (microseconds)");
    CHECK(error("hold: {max_deadlines: 0}") ==
          "c.yaml:10: scheduler.hold.max_deadlines: found '0', accepted: a number from 0.01 to "
          "100");
    CHECK(error("hold: {max_deadlines: 3, max_per_instance_ms: 5}") ==
          "c.yaml:10: scheduler.hold.max_per_instance_ms: found beside max_deadlines, accepted: "
          "one of the two");
    CHECK(error("hold: {max_per_instance_ms: soon}") ==
          "c.yaml:10: scheduler.hold.max_per_instance_ms: found 'soon', accepted: a number > 0 "
          "(milliseconds), or the word 'deadline'");
    CHECK(error("progress: {every_us: 10001}") ==
          "c.yaml:10: scheduler.progress.every_us: found '10001', accepted: a whole number from 0 "
          "to 10000 (microseconds)");
    CHECK(error("dispatch: {where: gpu}") ==
          "c.yaml:10: scheduler.dispatch.where: found 'gpu', accepted: thread, host, device, auto");
    CHECK(error("dispatch: {device: resident}") ==
          "c.yaml:10: scheduler.dispatch.device: found 'resident', accepted: piggyback, leased, "
          "armed");
    CHECK(error("dispatch: {lease_us: 99}") ==
          "c.yaml:10: scheduler.dispatch.lease_us: found '99', accepted: a whole number from 100 "
          "to 10000 (microseconds)");
    CHECK(error("dispatch: {idle_us: 19}") ==
          "c.yaml:10: scheduler.dispatch.idle_us: found '19', accepted: a whole number from 20 "
          "to 10000 (microseconds)");
    CHECK(error("dispatch: {group_us: 19}") ==
          "c.yaml:10: scheduler.dispatch.group_us: found '19', accepted: a whole number from 20 "
          "to 100000 (microseconds)");
    CHECK(error("dispatch: {most_gates: 16}") ==
          "c.yaml:10: scheduler.dispatch.most_gates: found '16', accepted: a whole number from 1 "
          "to 15");
    CHECK(error("run_ahead_us: 49") ==
          "c.yaml:10: scheduler.run_ahead_us: found '49', accepted: a whole number from 50 to "
          "100000 (microseconds)");
    CHECK(
        error("run_ahead_alone_us: 100001") ==
        "c.yaml:10: scheduler.run_ahead_alone_us: found '100001', accepted: a whole number from 50 "
        "to 100000 (microseconds)");
    CHECK(error_with("env: {connections: 33}\n") ==
          "c.yaml:9: env.connections: found '33', accepted: a whole number from 1 to 32, or a "
          "word: 'auto' or 'keep'");
}

TEST_CASE("Connections are asked for where there are more than six tasks or gates, or as written",
          "[unit][config]") {
    Config config;
    config.chains.resize(2);
    config.chains[0].tasks.resize(3);
    config.chains[1].tasks.resize(3);
    CHECK(connections_of(config) == 0);
    config.scheduler.dispatch.where = Dispatch::kAuto;
    CHECK(connections_of(config) == 32);
    config.scheduler.dispatch.where = Dispatch::kThread;
    config.chains[1].tasks.resize(4);
    CHECK(connections_of(config) == 32);
    config.connections = 0;  // keep
    CHECK(connections_of(config) == 0);
    config.connections = 8;
    CHECK(connections_of(config) == 8);
    const auto written =
        parse_config(kMinimal + std::string("env: {connections: auto}\n"), "c.yaml");
    REQUIRE(written);
    CHECK(written->connections == kAutoConnections);
}

TEST_CASE("Scheduler keys of policies and admissions are read and bounded", "[unit][config]") {
    const auto with = [](const std::string& keys) {
        return config::parse_config(std::string(kMinimal) + "scheduler: {" + keys + "}\n", "c.yaml")
            ->scheduler;
    };
    CHECK(with("policy: hrrn").policy == config::Policy::kHrrn);
    CHECK(with("binding: task").binding == config::Binding::kTask);
    CHECK(with("admission: buckets").admission == config::Admission::kBuckets);
    CHECK(with("priority_levels: 3").priority.levels == 3);
    CHECK(with("launchers: 0").packing.launchers == 0);
    CHECK(with("launchers: 256").packing.launchers == 256);
    CHECK(with("lambda: -1").parameters.lambda == -1);
    CHECK(with("plan_margin: 0.1").parameters.plan_margin == 0.1);
    CHECK(with("share_limit: 2").packing.share_limit == 2);
    CHECK(with("share_slack_us: 2000").packing.share_slack == std::chrono::milliseconds(2));
    CHECK(with("exempt_utilization: 0.2").parameters.exempt_utilization == 0.2);
    CHECK(with("urgent_percentile: 90").parameters.urgent_percentile == 90);
    CHECK(with("quantum_us: 2000").parameters.quantum == std::chrono::milliseconds(2));
    const auto paper = with("preset: paper, urgent_percentile: 99");
    CHECK(paper.parameters.urgent_percentile == 99);
    CHECK(paper.admission == config::Admission::kThreshold);
    const auto error = [](const std::string& key) {
        return error_with("scheduler: {" + key + "}\n").substr(0, 40);
    };
    CHECK(error("priority_levels: 65") == "c.yaml:9: scheduler.priority_levels: fou");
    CHECK(error("launchers: -1") == "c.yaml:9: scheduler.launchers: found '-1");
    CHECK(error("lambda: 101") == "c.yaml:9: scheduler.lambda: found '101',");
    CHECK(error("plan_margin: -1") == "c.yaml:9: scheduler.plan_margin: found '");
    CHECK(error("exempt_utilization: 2") == "c.yaml:9: scheduler.exempt_utilization: ");
    CHECK(error("urgent_percentile: 0") == "c.yaml:9: scheduler.urgent_percentile: f");
    CHECK(error("quantum_us: 1") == "c.yaml:9: scheduler.quantum_us: found '1");
}

TEST_CASE("A chain's criticality and limit of misses are read and bounded", "[unit][config]") {
    const auto chain = [](const std::string& line) {
        return config::parse_config(with_line(5, "    deadline_ms: 9\n    " + line), "c.yaml")
            ->chains[0];
    };
    CHECK(chain("criticality: 7").criticality == 7);
    CHECK(chain("mode: enforce").criticality == 1);
    CHECK(chain("max_consecutive_misses: 3").max_consecutive_misses == 3);
    CHECK(chain("on_late: demote").on_late == config::OnLate::kDemote);
    CHECK(error_of(with_line(5, "    deadline_ms: 9\n    criticality: 1001")) ==
          "c.yaml:6: chains[0].criticality: found '1001', accepted: a whole number from 0 to 1000");
    CHECK(error_of(with_line(5, "    deadline_ms: 9\n    max_consecutive_misses: -1")) ==
          "c.yaml:6: chains[0].max_consecutive_misses: found '-1', accepted: a whole number from 0 "
          "to 1000000");
}

TEST_CASE("Guard is on where nothing else is asked for, and off with a baseline's preset",
          "[unit][config]") {
    const auto guard = [](const std::string& scheduler, const std::string& preset = "") {
        const auto config =
            parse_config(std::string(kMinimal) + "scheduler: {" + scheduler + "}\n", "c", preset);
        REQUIRE(config);
        return config->scheduler.guard;
    };
    CHECK(guard("lambda: 1"));
    CHECK(guard("preset: urgengo"));
    CHECK_FALSE(guard("guard: off"));
    for (const char* preset : {"vanilla", "edf", "paper", "paam", "dcuda"}) {
        CHECK_FALSE(guard("preset: " + std::string(preset)));
        CHECK_FALSE(guard("lambda: 1", preset));
        CHECK(guard("guard: on, preset: " + std::string(preset)));
    }
    CHECK(error_with("scheduler: {guard: perhaps}\n") ==
          "c.yaml:9: scheduler.guard: found 'perhaps', accepted: on, off, true, false");
}

TEST_CASE("Config error names the accepted keys and the likely one when a key is unknown",
          "[unit][config]") {
    CHECK(error_of(with_line(4, "    perod_ms: 150")) ==
          "c.yaml:4: chains[0].perod_ms: unknown key, accepted: name, period_ms, deadline_ms, "
          "arrival, mode, on_late, criticality, max_consecutive_misses, tasks (did you mean "
          "'period_ms'?)");
    CHECK(error_with("limits: {realtime: off}\n") ==
          "c.yaml:9: limits: unknown key, accepted: version, mode, chains, scheduler, cpu, env, "
          "nvtx");
    CHECK(
        error_with("scheduler:\n  dispatcher: thread\n") ==
        "c.yaml:10: scheduler.dispatcher: unknown key, accepted: preset, policy, binding, "
        "admission, pack_limit, hold, progress, run_ahead_us, run_ahead_alone_us, priority_via, "
        "tracking, eval_interval_us, share_limit, share_slack_us, priority_levels, launchers, "
        "lambda, "
        "plan_margin, "
        "exempt_utilization, urgent_percentile, quantum_us, copies, dispatch, guard (did you mean "
        "'dispatch'?)");
    CHECK(error_with("cpu: {realtime: off}\n") ==
          "c.yaml:9: cpu.realtime: unknown key, accepted: blocking_sync, nice");
    CHECK(
        error_with("scheduler:\n  progress:\n    sorce: auto\n") ==
        "c.yaml:11: scheduler.progress.sorce: unknown key, accepted: source, every_us, learn (did "
        "you mean 'source'?)");
}

TEST_CASE("Config error says what is missing when a required key is not there", "[unit][config]") {
    CHECK(error_of("chains: []\n") == "c.yaml:1: version: missing, and required");
    CHECK(error_of("version: 1\n") == "c.yaml:1: chains: missing, and required");
    CHECK(error_of(with_line(4, "    on_late: exit")) ==
          "c.yaml:3: chains[0].period_ms: missing, and required");
    CHECK(error_of(with_line(8, "      - {thread: x}")) ==
          "c.yaml:8: chains[0].tasks[1].name: missing, and required");
    CHECK(error_of("") == "c.yaml: found 0 YAML documents, accepted: one");
    CHECK(error_of("a: 1\n---\nb: 2\n") == "c.yaml: found 2 YAML documents, accepted: one");
    // The library would make documents of it for ever.
    CHECK(error_of(", a") == "c.yaml: found at least 100 YAML documents, accepted: one");
}

TEST_CASE("Config error says so when a key or a name is there twice", "[unit][config]") {
    CHECK(error_with("mode: off\nmode: off\n") ==
          "c.yaml:10: mode: the key is there twice, accepted: once");
    CHECK(error_of(with_line(8, "      - {name: detect}")) ==
          "c.yaml:8: chains[0].tasks[1].name: found 'detect', accepted: a name not used before (it "
          "is in line 7)");
    CHECK(error_with("  - {name: lidar, period_ms: 1, deadline_ms: 1, tasks: [{name: a}]}\n") ==
          "c.yaml:9: chains[1].name: found 'lidar', accepted: a name not used before (it is in "
          "line 3)");
}

TEST_CASE("Config error names the kind when a node is of the wrong kind", "[unit][config]") {
    CHECK(error_of("- version\n") ==
          "c.yaml:1: found a list, accepted: a map with version, mode, chains, scheduler, cpu, "
          "env, nvtx");
    CHECK(error_of("version: 1\nchains: {}\n") ==
          "c.yaml:2: chains: found a map, accepted: a list of chains");
    CHECK(error_of("version: 1\nchains: []\n") ==
          "c.yaml:2: chains: found no chain, accepted: 1 to 256");
    CHECK(error_of("version: 1\nchains:\n  - lidar\n") ==
          "c.yaml:3: chains[0]: found 'lidar', accepted: a map with name, period_ms, deadline_ms, "
          "arrival, mode, on_late, criticality, max_consecutive_misses, tasks");
    CHECK(error_of(with_line(4, "    period_ms: [1]")) ==
          "c.yaml:4: chains[0].period_ms: found a list, accepted: a number > 0 (milliseconds)");
    CHECK(error_of(with_line(4, "    period_ms:")) ==
          "c.yaml:4: chains[0].period_ms: found nothing, accepted: a number > 0 (milliseconds)");
    CHECK(error_with("scheduler: fast\n") ==
          "c.yaml:9: scheduler: found 'fast', accepted: a map with preset, policy, binding, "
          "admission, pack_limit, hold, progress, run_ahead_us, run_ahead_alone_us, priority_via, "
          "tracking, eval_interval_us, share_limit, share_slack_us, priority_levels, launchers, "
          "lambda, "
          "plan_margin, "
          "exempt_utilization, urgent_percentile, quantum_us, copies, dispatch, guard");
    CHECK(
        error_of("version: 1\nchains:\n  - {name: a, period_ms: 1, deadline_ms: 1, tasks: []}\n") ==
        "c.yaml:3: chains[0].tasks: found no task, accepted: at least one");
}

TEST_CASE("Config error names line and column when the YAML has a syntax error", "[unit][config]") {
    CHECK_THAT(error_of("version: 1\nchains: [\n"),
               Catch::Matchers::StartsWith("c.yaml:3:1: not valid YAML: "));
    CHECK_THAT(error_of("version: 1\n mode: off\n"),
               Catch::Matchers::StartsWith("c.yaml:2:6: not valid YAML: "));
    CHECK_THAT(error_of("a: *unknown\n"),
               Catch::Matchers::StartsWith("c.yaml:1:4: not valid YAML: "));
}

TEST_CASE("Config error says so when there are too many chains or tasks", "[unit][config]") {
    std::string tasks;
    for (int i = 0; i < 257; ++i) tasks += "\n      - {name: t" + std::to_string(i) + "}";
    CHECK(error_of(with_line(6, "    tasks:" + tasks)) ==
          "c.yaml:2: chains: found 259 tasks in all, accepted: 1 to 256");

    std::string chains = "version: 1\nchains:\n";
    for (int i = 0; i < 257; ++i) {
        chains += "  - {name: c" + std::to_string(i) +
                  ", period_ms: 1, deadline_ms: 1, tasks: [{name: a}]}\n";
    }
    CHECK(error_of(chains) == "c.yaml:2: chains: found 257 chains, accepted: 1 to 256");
    chains.erase(chains.rfind("  - {name"));
    CHECK(error_of(chains) == "no error");
}

TEST_CASE("Config error names the file and the reason when it cannot be read", "[unit][config]") {
    CHECK(read_config("/nonexistent/c.yaml").error() ==
          "/nonexistent/c.yaml: cannot be read: No such file or directory");
    CHECK(read_config("/").error() == "/: cannot be read: not a regular file");
}

TEST_CASE("Preset vanilla schedules nothing when it is asked for", "[unit][config]") {
    const auto vanilla = preset("vanilla");
    REQUIRE(vanilla);
    CHECK(vanilla->binding == Binding::kNone);
    CHECK(vanilla->admission == Admission::kNone);
    CHECK_FALSE(preset("Vanilla"));
    CHECK(preset_names() ==
          "urgengo, urgency, edf, eqdf, saedf, lcuf, "
          "sjf, hrrn, static, fifo, paper, paper_binding, paper_delay, paam, dcuda, vanilla");
}

}  // namespace
}  // namespace urgengo::config
