// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench: the configs that it writes, what it learns, and how it reads and shows results.
#include "tests/support/bench_options.h"

namespace urgengo::cli {
namespace {

TEST_CASE("scale_level divides periods and leaves the rest", "[unit][cli]") {
    const std::string yaml =
        "version: 1\nchains:\n  - name: C0\n    period_ms: 150\n    deadline_ms: 60\n"
        "    arrival: {from: hint}\n    on_late: exit\n    tasks: [{name: a, thread: \"C0*\"}]\n"
        "  - {name: C1, period_ms: 500, deadline_ms: 120, tasks: [{name: b, thread: \"*\"}]}\n"
        "scheduler: {pack_limit: 2}\n";
    const auto scaled = scale_level(yaml, "c.yaml", 0.6);
    REQUIRE(scaled);
    const auto before = config::parse_config(yaml, "c.yaml");
    const auto after = config::parse_config(*scaled, "scaled.yaml");
    REQUIRE(before);
    REQUIRE(after);
    CHECK(after->chains[0].period == std::chrono::milliseconds(250));
    CHECK(after->chains[1].period.count() == 833'333'333);
    CHECK(after->chains[0].deadline == before->chains[0].deadline);
    CHECK(after->chains[0].arrival == config::ArrivalFrom::kHint);
    CHECK(after->chains[0].on_late == config::OnLate::kExit);
    CHECK(after->chains[0].tasks[0].thread_glob == "C0*");
    CHECK(after->chains[1].tasks[0].thread_glob == "*");
    CHECK(after->scheduler.packing.limit == 2);
    const auto longer = scale_level(yaml, "c.yaml", 1, 1.5);
    REQUIRE(longer);
    CHECK(config::parse_config(*longer, "c.yaml")->chains[0].deadline ==
          std::chrono::milliseconds(90));
    CHECK(scale_level("version: 1\n", "c.yaml", 0.6).error().find("c.yaml") == 0);
}

TEST_CASE("set_keys sets these and leaves the rest", "[unit][cli]") {
    const std::string chains =
        "version: 1\nchains: [{name: C, period_ms: 1, deadline_ms: 1, tasks: [{name: t}]}]\n";
    const auto set = [&](const std::string& rest, const std::string& keys) {
        const auto text = set_keys(chains + rest, "c.yaml", "scheduler", keys);
        INFO((text ? "" : text.error()));
        REQUIRE(text);
        return config::parse_config(*text, "c.yaml")->scheduler;
    };
    CHECK(set("", "{tracking: sync}").progress.tracking == config::Tracking::kSync);
    const auto both = set("scheduler: {pack_limit: 2, tracking: sync}\n", "{tracking: batched}");
    CHECK(both.progress.tracking == config::Tracking::kBatched);
    CHECK(both.packing.limit == 2);
    CHECK(set("", "{progress: {source: memop}}").progress.source == config::ProgressSource::kMemop);
    CHECK_FALSE(set_keys(chains, "c.yaml", "scheduler", "{tracking: no}"));
    const auto nice =
        set_keys(chains + "cpu: {blocking_sync: on}\n", "c.yaml", "cpu", "{nice: -15}");
    REQUIRE(nice);
    CHECK(config::parse_config(*nice, "c.yaml")->nice == -15);
    CHECK(config::parse_config(*nice, "c.yaml")->blocking_sync);
}

TEST_CASE("The workload's configs are valid", "[unit][cli]") {
    const std::string folder = URGENGO_CHAINS_FOLDER "/";
    for (const char* file : {"chains.yaml", "chains_nohints.yaml"}) {
        const auto longest = longest_period(folder + file);
        INFO((longest ? "" : longest.error()));
        REQUIRE(longest);
        CHECK(*longest == std::chrono::milliseconds(500));
    }
    const auto missing = longest_period("/nonexistent.yaml");
    REQUIRE_FALSE(missing);
    CHECK(missing.error().find("/nonexistent.yaml") == 0);
}

/// A shell script that stands in for urgengo and for the workload program.
class Stub {
  public:
    explicit Stub(const std::string& script) { folder_.write("stub", "#!/bin/sh\n" + script); }
    std::string path(const std::string& name) const { return folder_.path(name); }
    Arguments call(Arguments arguments) const {
        arguments.insert(arguments.begin(), {"/bin/sh", path("stub")});
        return arguments;
    }

  private:
    testing::Folder folder_;
};

constexpr char kProfile[] =
    R"({"format_version":2,"gpu":"G","driver":"13.0","chains":[{"name":"C0","tasks":[
{"name":"t","cpu_time_ns":1,"instances":7,"kernels":[
{"name":"k","grid_blocks":1,"block_threads":1,"gpu_time_ns":1,"utilization":0.5}]}]}]})";

TEST_CASE("Bench learns before it runs, and says what it learned", "[unit][cli]") {
    const Stub stub(
        "echo \"$URGENGO_REAL_LIBCUDA $URGENGO_TRACE $*\" >>\"$LOG\"\n"
        "[ $1 = profile ] && cp \"$PROFILE\" \"$2\"\n"
        "[ $1 = run ] && cp \"$REPORT\" \"$2\"\n"
        "exit 0\n");
    std::ofstream(stub.path("c.yaml"))
        << "version: 1\nchains: [{name: C0, period_ms: 1, deadline_ms: 1, tasks: [{name: t}]}]\n";
    std::ofstream(stub.path("profile")) << kProfile;
    std::ofstream(stub.path("report"))
        << R"({"gpu":"G","cuda_driver_version":"13.0","urgengo":"scheduling",
"overall_miss_ratio":0,"cpu_cores":1,"chains":[
{"name":"C0","deadline_ms":1,"miss_ratio":0,"exited":0}]})";
    BenchPlan plan;
    plan.scheduled["URGENGO_REAL_LIBCUDA"] = "real";
    plan.yamls = {{stub.path("c.yaml"), 0.5, stub.path("half.yaml")}};
    const std::string learned = stub.path("learned");
    plan.noises = {{learned, stub.path("noisy"), 100, 1}};
    plan.profiles = {{true, "in-situ", 6, learned, stub.call({"profile", learned})}};
    PlannedRun run;
    run.row = "urgengo";
    run.json = stub.path("run.json");
    run.yaml = stub.path("half.yaml");
    run.trace = "trace";
    run.arguments = stub.call({"run", run.json});
    plan.runs = {run};
    const Environment environment{{"LOG", stub.path("log")},
                                  {"PROFILE", stub.path("profile")},
                                  {"REPORT", stub.path("report")},
                                  {"PATH", "/usr/bin:/bin"}};
    const auto outcome = carry_out(plan, environment);
    INFO((outcome ? "" : outcome.error()));
    REQUIRE(outcome);
    CHECK(*config::read_file(stub.path("log")) ==
          "real  profile " + learned + "\nreal trace run " + run.json + "\n");
    CHECK(*longest_period(stub.path("half.yaml")) == std::chrono::milliseconds(2));
    CHECK(config::read_file(stub.path("noisy"))->find("\"gpu_time_ns\":") != std::string::npos);
    CHECK(outcome->runs.at(0).trace == "trace");
    CHECK(outcome->runs.at(0).yaml == run.yaml);
    REQUIRE(outcome->profiles.size() == 1);
    CHECK(describe(outcome->profiles[0]) ==
          "learned in-situ in 6 s at f_a 0.6, from 7 or more instances of each task");
    const auto json = profiles_json(outcome->profiles);
    CHECK(json.dump() == R"([{"hints":true,"way":"in-situ","f_a":0.6,"seconds":6.0,)"
                         R"("instances":{"C0.t":7}}])");

    plan.profiles[0].arguments.clear();
    plan.profiles[0].way = "given";
    const auto given = carry_out(plan, environment);
    REQUIRE(given);
    CHECK(describe(given->profiles[0]) == "given, from 7 or more instances of each task");
    CHECK(profiles_json(given->profiles)[0]["seconds"].is_null());
}

TEST_CASE("Bench stops when a profile knows nothing of a task", "[unit][cli]") {
    const Stub stub("");
    std::ofstream(stub.path("p.json"))
        << R"({"format_version":2,"gpu":"G","driver":"13.0","chains":[{"name":"C9","tasks":[
{"name":"calibrate","cpu_time_ns":1,"kernels":[]}]}]})";
    const auto summary = summarize_profile({true, "in-situ", 6, stub.path("p.json"), {}});
    REQUIRE_FALSE(summary);
    CHECK(summary.error() == stub.path("p.json") +
                                 ": found no kernel of C9.calibrate, accepted: a profile of every "
                                 "task (a longer --profile-seconds?)");
}

TEST_CASE("Bench table shows medians and ranges when there are repeats", "[unit][cli]") {
    BenchResults results;
    results.rows = {"bare", "urgengo"};
    results.levels = {0.9};
    const auto add = [&](const char* row, double miss_pct, double exited) {
        RunResult run;
        run.row = row;
        run.f_a = 0.9;
        run.miss_pct = miss_pct;
        run.exited = exited;
        run.cpu_cores = 1.5;
        run.chains = {{"C0", 42, miss_pct}};
        results.runs.push_back(run);
    };
    for (const double miss_pct : {30.0, 10.0, 20.0}) add("bare", miss_pct, 0);
    for (const double miss_pct : {1.0, 1.0, 1.0}) add("urgengo", miss_pct, miss_pct * 4);
    CHECK(format_table(results) ==
          "                   f_a 0.9\n"
          "                    miss %  exited  cores\n"
          "bare     20.0 (10.0..30.0)       0   1.50\n"
          "urgengo                1.0       4   1.50\n"
          "\n"
          "miss %                         f_a 0.9\n"
          "chain   deadline ms               bare  urgengo\n"
          "C0             42.0  20.0 (10.0..30.0)      1.0\n");
    CHECK(spread({4, 1, 2, 3}).median == 2.5);
}

TEST_CASE("Bench reads a report, and says what is wrong, when it is there", "[unit][cli]") {
    const std::string good =
        R"({"gpu":"G","kernel_driver_version":null,"cuda_driver_version":"13.0","urgengo":"off",
"overall_miss_ratio":0.25,"cpu_cores":1.5,"chains":[
{"name":"C0","deadline_ms":42,"miss_ratio":0.5,"exited":3},
{"name":"C1","deadline_ms":90,"miss_ratio":0,"exited":1}]})";
    const auto run = parse_report(good, "r.json");
    REQUIRE(run);
    CHECK(run->driver == "CUDA 13.0");
    CHECK(run->miss_pct == 25);
    CHECK(run->exited == 4);
    REQUIRE(run->chains.size() == 2);
    CHECK(run->chains[0].miss_pct == 50);
    CHECK(parse_report("{}", "r.json").error() == "r.json: $.gpu: missing, and required");
}

}  // namespace
}  // namespace urgengo::cli
