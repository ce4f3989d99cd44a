// SPDX-License-Identifier: Apache-2.0
#include "tools/report/run_report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "tests/support/run_builder.h"

using namespace urgengo;
using abi::RunKind;
using nlohmann::json;
using namespace urgengo::report;
using testing::RunBuilder;

namespace {

constexpr std::int64_t kMs = RunBuilder::kMs;

struct Told {
    trace::Run run;
    trace::RunStory story;
};

Told tell(const RunBuilder& builder) {
    auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    trace::RunStory story = trace::tell(*run);
    return {std::move(*run), std::move(story)};
}

ReportedRun reported(const RunBuilder& builder, const std::string& label = "here") {
    auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    return report_run(label, std::move(*run), 10);
}

/// A GPU segment of a chain's first task, in a frame that arrived then.
void add_segment(RunBuilder& builder, int chain, std::int64_t arrival, std::int64_t begin,
                 std::int64_t end) {
    const int task = chain == 0 ? 0 : 2;
    builder.frame_begins(chain, 1, arrival);
    builder.add(RunKind::kTaskBegin, chain, task, arrival, begin);
    builder.add(RunKind::kSegmentBegin, chain, task, arrival, begin, begin);
    builder.add(RunKind::kSegmentEnd, chain, task, arrival, end, begin);
}

void add_priority(RunBuilder& builder, int chain, std::int64_t time, int priority) {
    auto record = RunBuilder::record(RunKind::kPriority, chain, chain == 0 ? 0 : 2, 0, time);
    record.priority = {priority, 0};
    builder.recorder.add(record);
}

void add_cpu_use(RunBuilder& builder, std::int64_t time, std::int64_t used) {
    auto record = RunBuilder::record(RunKind::kCpuUse, -1, -1, 0, time);
    record.cpu = {used * kMs, 0};
    builder.recorder.add(record);
}

}  // namespace

TEST_CASE("Interval of a miss ratio is Wilson's when frames are late one by one", "[report]") {
    std::vector<bool> missed(200);
    for (std::size_t i = 0; i < missed.size(); i += 20) missed[i] = true;
    const MissRatio ratio = miss_ratio(missed);
    CHECK(ratio.ratio == 0.05);
    // scipy.stats: binomtest(10, 200).proportion_ci(method='wilson')
    CHECK(std::abs(ratio.low - 0.02738) < 1e-4);
    CHECK(std::abs(ratio.high - 0.08959) < 1e-4);
}

TEST_CASE("Interval of a miss ratio is wider when frames are late together", "[report]") {
    std::vector<bool> apart(200), together(200);
    for (std::size_t i = 0; i < 20; ++i) apart[10 * i] = together[100 + i] = true;
    const auto width = [](const MissRatio& ratio) { return ratio.high - ratio.low; };
    CHECK(miss_ratio(together).ratio == miss_ratio(apart).ratio);
    CHECK(width(miss_ratio(together)) > 2 * width(miss_ratio(apart)));
}

TEST_CASE("Miss ratio of no frames, of none and of all missed has an interval", "[report]") {
    CHECK(miss_ratio({}).high == 1);
    const MissRatio none = miss_ratio(std::vector<bool>(100, false));
    CHECK(none.ratio == 0);
    CHECK(none.low == 0);
    CHECK(std::abs(none.high - 0.0370) < 1e-4);
    const MissRatio all = miss_ratio(std::vector<bool>(100, true));
    CHECK(all.ratio == 1);
    CHECK(all.high == 1);
    CHECK(std::abs(all.low - 0.9630) < 1e-4);
}

TEST_CASE("Chains are on the GPU while they have segments that are not held", "[report]") {
    RunBuilder builder;
    add_segment(builder, 0, 1000, 1000, 1040);
    add_segment(builder, 1, 1000, 1020, 1060);
    builder.hold(true, 1, 2, 1000, 1030, 1020, 0, 0);
    builder.frame_ends(0, 1000, 1100);
    const Told told = tell(builder);
    const GpuSharing sharing = gpu_sharing(told.run, told.story);
    CHECK(sharing.is_known);
    CHECK(sharing.span_ns == 100 * kMs);
    CHECK(sharing.by_chains_ns == std::vector<std::int64_t>{40 * kMs, 50 * kMs, 10 * kMs});
    CHECK(sharing.busy_share() == 0.6);
}

TEST_CASE("Launches behind a gate do not take their chain from the GPU", "[report]") {
    RunBuilder builder;
    add_segment(builder, 0, 1000, 1000, 1040);
    builder.hold(true, 0, 0, 1000, 1030, 1010, 1, 2, abi::kRunGate);
    const Told told = tell(builder);
    CHECK(gpu_sharing(told.run, told.story).by_chains_ns[1] == 40 * kMs);
}

TEST_CASE("Collision is of chains whose later deadline does not go behind", "[report]") {
    RunBuilder builder;
    // Both have 80 ms: lidar's frame is the earlier one.
    add_segment(builder, 0, 1000, 1000, 1040);
    add_segment(builder, 1, 1010, 1010, 1050);
    add_priority(builder, 0, 1020, -2);  // from here on the more urgent one goes first
    const Told told = tell(builder);
    const GpuSharing sharing = gpu_sharing(told.run, told.story);
    CHECK(sharing.collisions_ns == std::vector<std::int64_t>{0, 0, 10 * kMs});
    CHECK(sharing.collision_share() == 0.2);
}

TEST_CASE("Report tells of gates and parks where there were some", "[report]") {
    RunBuilder builder;
    builder.frame_begins(0, 1, 1000);
    builder.frame_ends(0, 1000, 1100);
    CHECK(to_text({reported(builder)}).find("gates") == std::string::npos);
    CHECK_FALSE(to_json({reported(builder)}, false).at("runs").at(0).contains("gates"));
    builder.park(1010, 1017, 1, 3, 2);
    builder.rounds(1020, 1021, 4);
    const std::string words =
        "1 rounds of the host opened 4 gates; no gate was closed in 1 parks, ";
    CHECK(to_text({reported(builder)}).find("  gates: " + words) != std::string::npos);
    CHECK(to_json({reported(builder)}, true)
              .at("runs")
              .at(0)
              .at("gates")
              .get<std::string>()
              .find(words) == 0);
}

TEST_CASE("Run in which nothing was on the GPU says so", "[report]") {
    RunBuilder builder;
    builder.frame_begins(0, 1, 1000);
    builder.frame_ends(0, 1000, 1100);
    const ReportedRun run = reported(builder);
    CHECK_FALSE(run.numbers.gpu.is_known);
    CHECK_FALSE(to_json({run}, false).at("runs").at(0).contains("gpu"));
    CHECK(to_text({run}).find("GPU") == std::string::npos);
}

TEST_CASE("Frames that were dropped or ended early count as missed", "[report]") {
    RunBuilder builder;
    for (std::uint32_t i = 1; i <= 4; ++i) builder.frame_begins(0, i, 100 * i);
    builder.frame_ends(0, 100, 150);
    builder.frame_ends(0, 200, 300, abi::MissCause::kHeld, 1, 30);
    auto exited = RunBuilder::record(RunKind::kFrameEnd, 0, -1, 300, 310, 300);
    exited.flags = abi::kRunExited;
    exited.cause = abi::MissCause::kGivenUp;
    exited.frame = {10 * kMs, 0};
    builder.recorder.add(exited);
    builder.add(RunKind::kFrameDropped, 0, -1, 0, 400);
    const ReportedRun run = reported(builder);
    const ChainNumbers& lidar = run.numbers.chains[0];
    CHECK(lidar.misses.ratio == 0.75);
    CHECK(lidar.latencies_ms == std::vector<double>{50, 100});
    CHECK(run.numbers.misses.ratio == 0.75);
    CHECK(run.numbers.mean_miss_ratio == 0.75);  // camera had no frames
}

TEST_CASE("Misses and CPU use are told over time", "[report]") {
    RunBuilder builder;
    builder.frame_begins(0, 1, 0);
    builder.frame_ends(0, 0, 100);
    add_cpu_use(builder, 100, 50);
    builder.frame_begins(0, 2, 2000);
    builder.frame_ends(0, 2000, 2090, abi::MissCause::kArrivedLate);
    add_cpu_use(builder, 2100, 3050);
    const RunNumbers numbers = reported(builder).numbers;
    CHECK(numbers.bin_s == 0.1);
    REQUIRE(numbers.bins.size() == 21);
    CHECK(numbers.bins[20].over == 1);
    REQUIRE(numbers.bins[20].missed.size() == 1);
    CHECK(numbers.bins[20].missed[0].first == abi::MissCause::kArrivedLate);
    CHECK(numbers.bins[10].cpu_cores == 1.5);
    CHECK(numbers.bins[0].cpu_cores < 0);
    CHECK(numbers.cpu_cores == 1.5);
}

TEST_CASE("Window around a miss has its own tasks first and ends behind it", "[report]") {
    RunBuilder builder;
    builder.add_a_late_frame();
    const Told told = tell(builder);
    const std::size_t frame = told.story.find(0, 17);
    REQUIRE(frame != trace::kNoFrame);
    const MissWindow window = miss_window(told.run, told.story, frame);
    CHECK(window.deadline_ms == 80);
    CHECK(window.ended_ms == 95);
    CHECK(window.begin_ms < 0);
    CHECK(window.end_ms > 95);
    CHECK(window.rows == std::vector<std::string>{"lidar/detect", "camera/detect"});
    const auto held = std::find_if(window.bars.begin(), window.bars.end(),
                                   [](const Bar& bar) { return bar.kind == BarKind::kHeld; });
    REQUIRE(held != window.bars.end());
    CHECK(held->row == 0);
    CHECK(held->begin_ms == 6);
    CHECK(held->end_ms == 56);
    CHECK(held->words == "lidar #17: held behind camera, more urgent work fills the GPU");
    const std::size_t other = told.story.find(1, 5);
    REQUIRE(other != trace::kNoFrame);
    CHECK(miss_window(told.run, told.story, other).rows ==
          std::vector<std::string>{"camera/detect", "lidar/detect"});
    for (const Bar& bar : window.bars) {
        CHECK(bar.begin_ms >= window.begin_ms);
        CHECK(bar.end_ms <= window.end_ms);
    }
}

TEST_CASE("Misses are chosen from all chains, the longest first", "[report]") {
    RunBuilder builder;
    for (std::uint32_t i = 0; i < 5; ++i) {
        builder.frame_begins(0, i + 1, 1000 * i);
        builder.frame_ends(0, 1000 * i, 1000 * i + 100 + 10 * i, abi::MissCause::kHeld);
    }
    builder.frame_begins(1, 1, 7000);
    builder.frame_ends(1, 7000, 7090, abi::MissCause::kGpuLonger);
    const Told told = tell(builder);
    const std::vector<std::size_t> chosen = choose_misses(told.run, told.story, 3);
    REQUIRE(chosen.size() == 3);
    CHECK(told.story.frames[chosen[0]].number == 4);
    CHECK(told.story.frames[chosen[1]].number == 5);
    CHECK(told.story.frames[chosen[2]].chain == 1);
    CHECK(choose_misses(told.run, told.story, 100).size() == 6);
    CHECK(choose_misses(told.run, told.story, 0).empty());
}

TEST_CASE("Page needs nothing but itself, whatever names are in the run", "[report]") {
    RunBuilder builder;
    builder.add_a_late_frame();
    const std::string bad = "</script><script>alert(1)</script>\xff";
    const std::string page = to_html({reported(builder, bad), reported(builder, "b")});
    CHECK(page.find(bad.substr(0, 20)) == std::string::npos);
    for (const char* const loads : {" src=", "<link", "@import", "url(", "import("})
        CHECK(page.find(loads) == std::string::npos);
    const std::string begin = "id=\"data\">";
    const std::size_t at = page.find(begin) + begin.size();
    const json data = json::parse(page.substr(at, page.find("</script>", at) - at));
    CHECK(data.at("runs").at(0).at("label") == bad.substr(0, bad.size() - 1) + "\xef\xbf\xbd");
    const json& miss = data.at("runs").at(1).at("misses").at(0);
    CHECK(miss.at("name") == "lidar #17");
    CHECK(miss.at("words") == "late by 15.000 ms: held behind camera (50.000 ms)");
    CHECK(miss.at("held_behind").at(0).at("ms") == 50);
    CHECK(data.at("bar_kinds").size() == std::size(kBarKinds));
    // Each element that the script fills is there.
    CHECK(page.find("</html>") != std::string::npos);
}

TEST_CASE("Script fills elements that the page has", "[report]") {
    RunBuilder builder;
    const std::string page = to_html({reported(builder)});
    std::size_t count = 0;
    const std::string asked = "byId(\"";
    for (std::size_t at = page.find(asked); at != std::string::npos; at = page.find(asked, at)) {
        at += asked.size();
        const std::string id = page.substr(at, page.find('"', at) - at);
        INFO(id);
        CHECK(page.find("id=\"" + id + "\"") != std::string::npos);
        ++count;
    }
    CHECK(count > 8);
}

TEST_CASE("Report of runs as JSON, a table and a summary agrees", "[report]") {
    RunBuilder builder;
    builder.add_a_late_frame();
    const std::vector<ReportedRun> runs{reported(builder, "a, \"b\""), reported(builder, "c")};
    const json root = json::parse(to_json(runs, false).dump());
    CHECK(root.at("format_version") == 1);
    const json& lidar = root.at("runs").at(0).at("chains").at(0);
    CHECK(lidar.at("late") == 1);
    CHECK(lidar.at("missed").at("pct") == 100);
    CHECK(lidar.at("max_ms") == 95);
    CHECK_FALSE(lidar.contains("latencies_ms"));
    CHECK_FALSE(root.at("runs").at(0).contains("misses"));
    const std::string csv = to_csv(runs);
    CHECK(std::count(csv.begin(), csv.end(), '\n') == 5);
    CHECK(csv.find("\"a, \"\"b\"\"\",lidar,80.000,1,1,1,0,0,100.000,") != std::string::npos);
    const std::string text = to_text(runs);
    CHECK(text.find("1 x held behind camera") != std::string::npos);
    CHECK(text.find("a, \"b\": ") == 0);
}

TEST_CASE("Conditions are read from the records, and need not be there", "[report]") {
    RunBuilder builder;
    CHECK(conditions_of(tell(builder).run).facts.empty());
    trace::Run run = tell(builder).run;
    run.gpu = "Some GPU";
    run.conditions =
        R"({"command": "./stack", "cores": 8, "config": {"chains": []}, "kernels": {"names": ["conv"]}})";
    const Conditions conditions = conditions_of(run);
    using Fact = std::pair<std::string, std::string>;
    CHECK(conditions.facts ==
          std::vector<Fact>{{"GPU", "Some GPU"}, {"command", "./stack"}, {"cores", "8"}});
    CHECK(conditions.config == "{\n  \"chains\": []\n}");
    const std::string deep(200'000, '[');
    run.conditions = "{\"config\": " + deep + std::string(deep.size(), ']') + "}";
    CHECK(conditions_of(run).config.size() < 10'000);
    run.conditions = "{\"a\": ";
    CHECK(conditions_of(run).config.empty());
}
