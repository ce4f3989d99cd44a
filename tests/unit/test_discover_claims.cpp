// SPDX-License-Identifier: Apache-2.0
//
// A config held against traces: what matched, by which rule, what matched twice, what nobody
// explains.
#include "tools/discover/claims.h"

#include "host/config/config_reader.h"
#include "tests/support/catch.h"
#include "tests/support/trace_builder.h"

namespace urgengo::discover {
namespace {

using testing::TestKernel;
using testing::TraceBuilder;
using testing::TracedThread;

constexpr std::int64_t kMs = 1'000'000;
const TestKernel kStem{"stem", 64, 256}, kConv{"conv", 32, 128};

void run_frames(TracedThread& thread, int count, std::int64_t period_ns,
                const std::vector<TestKernel>& kernels, int task = -1) {
    for (int frame = 0; frame < count; ++frame) {
        thread.sleep_until((100 + frame * period_ns / kMs) * kMs);
        for (const TestKernel& kernel : kernels) thread.launch(kernel, task);
        thread.wait();
    }
}

struct Checked {
    Claims claims;
    std::string report;

    bool says(const std::string& text) const { return report.find(text) != std::string::npos; }
    std::size_t by(std::size_t task, MatchedBy by) const {
        return claims.tasks.at(task).by[static_cast<std::size_t>(by)];
    }
};

/// @param tasks  of one chain with a period of 50 ms
Checked check(TraceBuilder& builder, const std::string& tasks) {
    const auto config = config::parse_config(
        "version: 1\nchains: [{name: c, period_ms: 50, deadline_ms: 50, tasks: [" + tasks + "]}]\n",
        "c.yaml");
    INFO((config ? "" : config.error()));
    REQUIRE(config);
    const auto trace = trace::parse_trace(builder.bytes(), "t.ugtrace");
    REQUIRE(trace);
    const Observation seen = observe(*trace, trace::TaskMatcher(*config, *trace));
    Checked checked{find_claims(*config, seen), ""};
    checked.report = format_claims(*config, checked.claims);
    return checked;
}

TEST_CASE("Check names the rule when launches match by thread, range, kernel or hint",
          "[tools][discover]") {
    TraceBuilder builder;
    TracedThread lidar(builder, 1, "lidar"), a(builder, 2, "x"), b(builder, 3, "x"),
        c(builder, 4, "x"), d(builder, 5, "x");
    run_frames(lidar, 20, 50 * kMs, {kStem, kStem});
    run_frames(a, 20, 50 * kMs, {kConv, kStem});
    for (int frame = 0; frame < 20; ++frame) {
        b.sleep_until((100 + frame * 50) * kMs);
        b.push("plan");
        b.launch(kStem);
        b.wait();
        b.pop();
        c.sleep_until((100 + frame * 50) * kMs);
        c.task_begin(3, static_cast<std::uint32_t>(frame + 1));
        c.launch(kStem, 3);
        c.wait();
        c.task_end(3, static_cast<std::uint32_t>(frame + 1));
    }
    run_frames(d, 20, 50 * kMs, {kStem}, 4);  // as the runtime knew
    const Checked checked =
        check(builder,
              "{name: t, thread: \"lid*\"}, {name: k, kernels: conv}, {name: n, nvtx: plan}, "
              "{name: h}, {name: s, thread: nobody}");
    CHECK(checked.by(0, MatchedBy::kThread) == 40);
    CHECK(checked.by(1, MatchedBy::kKernels) == 40);
    CHECK(checked.by(2, MatchedBy::kNvtx) == 20);
    CHECK(checked.by(3, MatchedBy::kHint) == 20);
    CHECK(checked.by(4, MatchedBy::kStream) == 20);
    for (const TaskClaims& task : checked.claims.tasks) {
        CHECK(task.instances.instances.size() >= 18);
        std::size_t sum = 0;
        for (const std::size_t count : task.by) sum += count;
        CHECK(sum == task.launches);
    }
    CHECK(all_matched(checked.claims));
    CHECK(checked.claims.doubles.empty());
    CHECK(checked.says("All GPU time is explained."));
}

TEST_CASE("Check does not call GPU time explained of which nothing is known", "[tools][discover]") {
    TraceBuilder builder;
    std::strcpy(builder.add(1, trace::TraceKind::kThread, 0).name, "lidar");
    const std::uint64_t stem = builder.text(1, "stem");
    for (int frame = 0; frame < 20; ++frame) {
        const std::int64_t time_ns = (100 + frame * 50) * kMs;
        builder.add(1, trace::TraceKind::kLaunch, time_ns).launch.name_hash = stem;
        abi::TraceRecord& wait = builder.add(1, trace::TraceKind::kWait, time_ns + 1);
        wait.flags = abi::kTraceCovers;
        wait.wait.end_ns = time_ns + kMs;
    }
    const Checked checked = check(builder, "{name: t, thread: lidar}");
    CHECK(checked.claims.tasks[0].launches == 20);
    CHECK(checked.says("No GPU time is known: no kernel was timed."));
    CHECK_FALSE(checked.says("explained"));
}

TEST_CASE("Check counts what two tasks claim when their rules overlap", "[tools][discover]") {
    TraceBuilder builder;
    TracedThread lidar(builder, 1, "lidar");
    run_frames(lidar, 20, 50 * kMs, {kConv, kStem});
    const Checked checked = check(builder, "{name: t, thread: lidar}, {name: k, kernels: conv}");
    CHECK(checked.claims.tasks[1].launches == 40);
    CHECK(checked.claims.doubles == std::map<std::pair<int, int>, std::size_t>{{{1, 0}, 40}});
    CHECK(checked.says("Claimed by two tasks:\n  40 launches of c/k fit the rules of c/t, too\n"));
    CHECK_FALSE(all_matched(checked.claims));
}

TEST_CASE("Check shows the names that were seen when nothing matches a task", "[tools][discover]") {
    TraceBuilder builder;
    TracedThread lidar(builder, 1, "lidar");
    for (int frame = 0; frame < 10; ++frame) {
        lidar.sleep_until((100 + frame * 50) * kMs);
        lidar.push("plan");
        lidar.launch(kStem);
        lidar.wait();
        lidar.pop();
    }
    const Checked checked =
        check(builder,
              "{name: a, thread: ldr}, {name: b, nvtx: x}, {name: d, kernels: \"c@1x2\"}, "
              "{name: e}");
    CHECK_FALSE(all_matched(checked.claims));
    CHECK(checked.says("Nothing matched c/a:\n  thread: found lidar (10), accepted: ldr\n"));
    CHECK(checked.says("Nothing matched c/b:\n  nvtx: found plan (10), accepted: x\n"));
    CHECK(
        checked.says("Nothing matched c/d:\n  kernels: found first stem (10), accepted: c@1x2\n"));
    CHECK(checked.says("Nothing matched c/e:\n  it has no rule, and no hint named it\n"));
    CHECK(
        checked.says("GPU time that no task explains: 1 ms, 100.0 % of all\n  threads named "
                     "'lidar': 10 launches, 1 ms, 100.0 %: stem (1 ms)\n"));
}

TEST_CASE("Check marks a period when it is not the config's", "[tools][discover]") {
    TraceBuilder builder;
    TracedThread slow(builder, 1, "slow"), right(builder, 2, "right");
    run_frames(slow, 20, 80 * kMs, {kStem});
    run_frames(right, 20, 50 * kMs, {kStem});
    const Checked checked = check(builder, "{name: s, thread: slow}, {name: r, thread: right}");
    CHECK(checked.says("!80 "));
    CHECK_FALSE(checked.says("!50"));
}

}  // namespace
}  // namespace urgengo::discover
