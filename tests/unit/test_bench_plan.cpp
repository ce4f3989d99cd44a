// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench: what it runs, the configs that it writes, and how it reads and shows results.
#include "tests/support/bench_options.h"

namespace urgengo::cli {
namespace {

TEST_CASE("Bench plan gives every row the same arrivals", "[unit][cli]") {
    BenchOptions options = two_rows();
    options.repeats = 2;
    options.umin = 0.5;
    options.sync = "block";
    const BenchPlan plan = make_plan(options, kPaths, 6);
    CHECK(shell_line(plan.calibrate) == "/bin/chains calibrate --out /t/w.json --umin 0.5");
    REQUIRE(plan.runs.size() == 4);
    const std::string program =
        "/bin/chains run --workload /t/w.json --f-a 0.9 --f-d 1 --seconds 12 --seed ";
    CHECK(shell_line(plan.runs[0].arguments) ==
          program + "5 --sync block --json /t/bare_0.9_0.json --instances --quiet");
    CHECK(shell_line(plan.runs[1].arguments) ==
          "/bin/urgengo run -c /t/f_a_0.9.yaml --quiet --profile /t/learned.profile.json --preset "
          "urgengo --stats /t/urgengo_0.9_0.stats.json -- " +
              program + "5 --sync block --json /t/urgengo_0.9_0.json --instances --quiet");
    CHECK(plan.runs[0].yaml.empty());
    CHECK(plan.runs[1].yaml == "/t/f_a_0.9.yaml");
    CHECK(plan.runs[1].trace.empty());
    CHECK(plan.runs[2].seed == 6);
    CHECK(plan.runs[2].row == "bare");
    CHECK(plan.scheduled == Environment{{"URGENGO_REAL_LIBCUDA", "/sim"}});

    options.workload = "/given.json";
    CHECK(make_plan(options, kPaths, 6).calibrate.empty());
}

TEST_CASE("Bench plan learns one profile, on arrivals that no row sees", "[unit][cli]") {
    BenchOptions options = two_rows();
    options.f_a = {0.6, 0.9};
    options.repeats = 3;
    options.rows = {"bare", "vanilla", "urgengo"};
    options.variable = true;
    const BenchPlan plan = make_plan(options, kPaths, 6);
    REQUIRE(plan.yamls.size() == 2);  // the profile's is one of the rows'
    CHECK(plan.yamls[0].source == "/s/h.yaml");
    CHECK(plan.yamls[0].f_a == 0.6);
    CHECK(plan.yamls[0].path == "/t/f_a_0.6.yaml");
    REQUIRE(plan.profiles.size() == 1);
    CHECK(plan.profiles[0].way == "in-situ");
    CHECK(plan.profiles[0].seconds == 6);
    CHECK(shell_line(plan.profiles[0].arguments) ==
          "/bin/urgengo profile -c /t/f_a_0.6.yaml --in-situ -o /t/learned.profile.json -- "
          "/bin/chains run --workload /t/w.json --f-a 0.6 --f-d 1 --seconds 6 --seed 8 --variable "
          "--quiet");

    options.profile_isolated = true;
    options.profile_seconds = 2.5;
    const PlannedProfile isolated = make_plan(options, kPaths, 6).profiles.at(0);
    CHECK(isolated.way == "isolated");
    CHECK(isolated.seconds == 2.5);
    CHECK(isolated.arguments.at(4) == "--isolated");

    options.profile = "/given.json";
    const BenchPlan given = make_plan(options, kPaths, 6);
    CHECK(given.profiles.at(0).arguments.empty());
    CHECK(given.profiles.at(0).path == "/given.json");
    CHECK(given.runs.at(1).arguments.at(6) == "/given.json");

    options.rows = {"bare", "bare-nohints"};
    const BenchPlan bare = make_plan(options, kPaths, 6);
    CHECK(bare.profiles.empty());
    CHECK(bare.yamls.empty());
}

TEST_CASE("Bench plan keeps rows without hints apart", "[unit][cli]") {
    BenchOptions options = two_rows();
    options.rows = {"bare-nohints", "urgengo", "urgengo-nohints"};
    const BenchPlan plan = make_plan(options, kPaths, 6);
    REQUIRE(plan.yamls.size() == 4);
    CHECK(plan.yamls[2].source == "/s/n.yaml");
    CHECK(plan.yamls[2].path == "/t/f_a_0.9-nohints.yaml");
    REQUIRE(plan.profiles.size() == 2);
    CHECK(plan.profiles[0].hints);
    CHECK_FALSE(plan.profiles[1].hints);
    CHECK(shell_line(plan.profiles[1].arguments) ==
          "/bin/urgengo profile -c /t/f_a_0.6-nohints.yaml --in-situ -o "
          "/t/learned-nohints.profile.json -- /bin/chains run --workload /t/w.json --f-a 0.6 --f-d "
          "1 --seconds 6 --seed 6 --no-hints --quiet");
    REQUIRE(plan.runs.size() == 3);
    CHECK(plan.runs[0].arguments[0] == "/bin/chains");
    CHECK(shell_line(plan.runs[0].arguments).find(" --no-hints ") != std::string::npos);
    CHECK(shell_line(plan.runs[1].arguments).find(" --no-hints ") == std::string::npos);
    CHECK(shell_line(plan.runs[2].arguments) ==
          "/bin/urgengo run -c /t/f_a_0.9-nohints.yaml --quiet --profile "
          "/t/learned-nohints.profile.json --preset urgengo --stats "
          "/t/urgengo-nohints_0.9_0.stats.json -- /bin/chains run --workload /t/w.json --f-a 0.9 "
          "--f-d 1 --seconds 12 --seed 5 --no-hints --json /t/urgengo-nohints_0.9_0.json "
          "--instances --quiet");
}

TEST_CASE("Bench plan gives a row with a way of tracking a config of its own", "[unit][cli]") {
    BenchOptions options = two_rows();
    options.rows = {"urgengo", "urgengo+batched", "edf+memop-nohints", "edf+batched"};
    options.eval_interval_us = 250;
    CHECK(check(options).empty());
    const BenchPlan plan = make_plan(options, kPaths, 6);
    const auto keys = [&](const std::string& path) -> std::string {
        for (const PlannedYaml& yaml : plan.yamls)
            if (yaml.path == path) return yaml.f_a == 0.9 ? yaml.scheduler : "another load";
        return "not planned";
    };
    CHECK(plan.yamls.size() == 6);  // two of them for the profiles
    CHECK(keys("/t/f_a_0.9.yaml").empty());
    CHECK(keys("/t/f_a_0.9+batched.yaml") == "{tracking: batched, eval_interval_us: 250}");
    CHECK(keys("/t/f_a_0.9+memop-nohints.yaml") == "{progress: {source: memop}}");
    CHECK(plan.runs[0].yaml == "/t/f_a_0.9.yaml");
    CHECK(plan.runs[1].yaml == "/t/f_a_0.9+batched.yaml");
    CHECK(plan.runs[1].stats == "/t/urgengo+batched_0.9_0.stats.json");
    CHECK(shell_line(plan.runs[1].arguments).find(" --preset urgengo ") != std::string::npos);
    CHECK(plan.runs[2].yaml == "/t/f_a_0.9+memop-nohints.yaml");
    CHECK(plan.runs[2].seed == plan.runs[1].seed);
    CHECK(plan.runs[3].yaml == plan.runs[1].yaml);
    CHECK(shell_line(plan.runs[3].arguments).find(" --preset edf ") != std::string::npos);
}

TEST_CASE("Bench row changes what its name says", "[unit][cli]") {
    const auto keys = [](const char* text) {
        const auto variant = parse_variant(text);
        return variant ? scheduler_keys(*variant) : "refused: " + variant.error();
    };
    CHECK(keys("batched@100") == "{tracking: batched, eval_interval_us: 100}");
    CHECK(keys("overlapped@5000") == "{tracking: overlapped, eval_interval_us: 5000}");
    CHECK(keys("async") == "{tracking: async}");
    CHECK(keys("event+every=20+learn") == "{progress: {source: event, every_us: 20, learn: on}}");
    CHECK(keys("sync+kernel") == "{tracking: sync, progress: {source: kernel}}");
    CHECK(keys("noise=30").empty());
    CHECK(keys("nice=-15").empty());
    CHECK(cpu_keys(*parse_variant("nice=-15+sync")) == "{nice: -15}");
    CHECK(cpu_keys(*parse_variant("sync")).empty());
    CHECK(parse_variant("noise=30+learn")->noise_pct == 30);
    CHECK(parse_variant("noise=30+learn")->learn);
    for (const char* wrong :
         {"", "+", "batched@", "batched@1", "batched@100x", "async@100", "sync+async",
          "event+memop", "learn+learn", "noise=0", "noise=101", "noise=30+noise=30", "nice=0",
          "nice=5", "nice=-21", "nice=", "nice=-15+nice=-15", "every=10001", "event+"}) {
        INFO(wrong);
        CHECK(keys(wrong).find("refused: accepted after each '+'") == 0);
    }
}

TEST_CASE("Bench plan compares intervals within one run of it", "[unit][cli]") {
    BenchOptions options = two_rows();
    options.rows = {"urgengo+batched@100", "urgengo+batched@5000", "urgengo+batched"};
    options.eval_interval_us = 250;
    CHECK(check(options).empty());
    const BenchPlan plan = make_plan(options, kPaths, 6);
    REQUIRE(plan.yamls.size() == 5);
    CHECK(plan.yamls[1].path == "/t/f_a_0.9+batched@100.yaml");
    CHECK(plan.yamls[1].scheduler == "{tracking: batched, eval_interval_us: 100}");
    CHECK(plan.yamls[2].scheduler == "{tracking: batched, eval_interval_us: 5000}");
    CHECK(plan.yamls[3].scheduler == "{tracking: batched, eval_interval_us: 250}");
    CHECK(plan.runs[0].yaml == plan.yamls[1].path);
    CHECK(plan.runs[0].seed == plan.runs[2].seed);
}

TEST_CASE("Bench plan gives all rows of a seed the same wrong profile", "[unit][cli]") {
    BenchOptions options = two_rows();
    options.rows = {"urgengo", "urgengo+noise=30", "urgengo+noise=30+learn", "edf+noise=100"};
    options.f_a = {0.9, 1.1};
    options.repeats = 2;
    const BenchPlan plan = make_plan(options, kPaths, 6);
    REQUIRE(plan.noises.size() == 4);
    CHECK(plan.noises[0].source == "/t/learned.profile.json");
    CHECK(plan.noises[0].path == "/t/noise_30_seed_5.profile.json");
    CHECK(plan.noises[1].seed == 6);
    CHECK(plan.noises[3].pct == 100);
    const auto profile = [&](std::size_t run) { return plan.runs.at(run).arguments.at(6); };
    CHECK(profile(0) == "/t/learned.profile.json");
    CHECK(profile(1) == plan.noises[0].path);
    CHECK(profile(2) == plan.noises[0].path);
    CHECK(profile(3) == plan.noises[2].path);
    CHECK(profile(5) == plan.noises[1].path);
    CHECK(profile(9) == plan.noises[0].path);  // at another load
    CHECK(plan.runs[2].yaml == "/t/f_a_0.9+noise=30+learn.yaml");

    options.profile = "/given.json";
    CHECK(make_plan(options, kPaths, 6).noises.at(0).source == "/given.json");
}

TEST_CASE("Noise makes a whole task's estimates wrong, by at most so much", "[unit][cli]") {
    config::Profile profile;
    profile.chains.resize(1);
    for (int i = 0; i < 400; ++i) {
        config::TaskProfile task{"t", std::chrono::nanoseconds(5)};
        task.kernels.resize(3);
        for (config::KernelProfile& kernel : task.kernels)
            kernel.gpu_time = std::chrono::nanoseconds(1'000'000);
        task.sizes = task.kernels;
        profile.chains[0].tasks.push_back(task);
    }
    const auto factors = [&](unsigned pct, std::uint32_t seed) {
        config::Profile wrong = profile;
        add_noise(wrong, pct, seed);
        std::vector<double> list;
        for (const config::TaskProfile& task : wrong.chains[0].tasks) {
            CHECK(task.cpu_time == std::chrono::nanoseconds(5));
            CHECK(task.kernels[2].gpu_time == task.kernels[0].gpu_time);
            CHECK(task.sizes[0].gpu_time == task.kernels[0].gpu_time);
            list.push_back(double(task.kernels[0].gpu_time.count()) / 1e6);
        }
        return list;
    };
    const auto some = factors(30, 1), most = factors(100, 1);
    const auto spread_of = spread(some);
    CHECK(spread_of.min >= 0.7);
    CHECK(spread_of.min < 0.72);
    CHECK(spread_of.max <= 1.3);
    CHECK(spread_of.max > 1.28);
    CHECK(std::abs(spread_of.median - 1) < 0.05);
    CHECK(spread(most).min >= 1e-6);
    CHECK(spread(most).max > 1.9);
    for (std::size_t i = 0; i < some.size(); ++i)
        CHECK(std::abs((most[i] - 1) * 0.3 - (some[i] - 1)) < 1e-5);
    CHECK(factors(30, 1) == some);
    CHECK(factors(30, 2) != some);
}

TEST_CASE("Bench plan asks for a trace when it wants the truth", "[unit][cli]") {
    BenchOptions options = two_rows();
    options.rows = {"urgengo-nohints"};
    options.truth = true;
    const PlannedRun run = make_plan(options, kPaths, 6).runs.at(0);
    CHECK(run.trace == "/t/urgengo-nohints_0.9_0.ugtrace");
    CHECK(shell_line(run.arguments).ends_with(" --instances --quiet"));
}

TEST_CASE("Bench learns a profile for five frames of the slowest chain", "[unit][cli]") {
    using namespace std::chrono_literals;
    CHECK(default_profile_seconds(500ms) == 6);
    CHECK(default_profile_seconds(5s) == 59);
}

TEST_CASE("Bench options are refused when a row or a level makes no sense", "[unit][cli]") {
    BenchOptions options;
    CHECK(check(options).empty());
    const std::string accepted =
        "accepted: bare, floor, urgengo, urgency, edf, eqdf, saedf, lcuf, sjf, hrrn, static, fifo, "
        "paper, paper_binding, paper_delay, paam, dcuda, vanilla; without hints: "
        "bare-nohints, ...";
    options.rows = {"bare", "best"};
    CHECK(check(options) == "--rows: found 'best', " + accepted);
    options.rows = {"floor-nohints"};
    CHECK(check(options) == "--rows: found 'floor-nohints', " + accepted);
    options.rows = {"floor"};
    CHECK(check(options).empty());
    CHECK_FALSE(check_row("floor").empty());  // not of other benches
    options.rows = {"-nohints"};
    CHECK(check(options) == "--rows: found '-nohints', " + accepted);
    options.rows = {"bare+batched"};
    CHECK(check(options) == "--rows: found 'bare+batched', " + accepted);
    for (const char* row : {"urgengo+batch", "urgengo+"}) {
        options.rows = {row};
        CHECK(check(options) ==
              std::string("--rows: found '") + row +
                  "', accepted after each '+': progress, async, sync, batched, overlapped, auto, "
                  "kernel, memop, event, learn, every=US, noise=PERCENT (up to 100), "
                  "nice=-20 to -1, each thing once; batched@US, overlapped@US (10 to 100000); and "
                  "KEY=VALUE, as the config "
                  "takes "
                  "them: policy, binding, admission, pack_limit, lambda, run_ahead_us, "
                  "run_ahead_alone_us, exempt_utilization, urgent_percentile, quantum_us, "
                  "priority_levels, launchers, "
                  "plan_margin, share_limit, share_slack_us, guard, hold, "
                  "dispatch");
    }
    options.rows = {"urgengo+kernel"};
    options.eval_interval_us = 100;
    CHECK(check(options) ==
          "--eval-interval-us: found no row that uses it, accepted: with a row such as "
          "urgengo+overlapped");
    options.rows = {"urgengo+overlapped@50"};  // says it itself
    CHECK_FALSE(check(options).empty());
    options.rows = {"urgengo+overlapped"};
    CHECK(check(options).empty());
    options.eval_interval_us.reset();
    options.rows = {"bare", "bare"};
    CHECK(check(options) == "--rows: found 'bare' twice, accepted: once");
    options.rows = {"bare-nohints", "edf-nohints"};
    CHECK(check(options).empty());
    options.threads = "task";
    CHECK(check(options) == "--threads: found 'task', accepted without hints: chain");
    options.threads.clear();
    options.profile = "p.json";
    CHECK(check(options) ==
          "--profile: found no row with hints that uses it, accepted: --profile-nohints");
    options.profile.clear();
    options.rows = {"bare"};
    options.f_a = {1, 1};
    CHECK(check(options) == "--f-a: found the same number twice, accepted: once");
}

}  // namespace
}  // namespace urgengo::cli
