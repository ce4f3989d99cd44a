// SPDX-License-Identifier: Apache-2.0
//
// Profiles learned from traces, what is warned of, and merging.
#include "tools/trace/profile_builder.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "host/config/profile_json.h"
#include "host/config/profile_reader.h"
#include "tests/support/catch.h"
#include "tests/support/trace_builder.h"
#include "tools/trace/kernel_set.h"
#include "tools/trace/profile_merge.h"

namespace urgengo::trace {
namespace {

using namespace std::chrono_literals;
using config::Profile;
using config::TaskProfile;
using testing::TestKernel;
using testing::TraceBuilder;
using testing::TracedThread;

constexpr std::int64_t kMs = 1'000'000;

config::Config config_of(const std::string& thread, std::chrono::nanoseconds period = 20ms) {
    config::Config config;
    config.chains.push_back({"C0", period, period, {}, {{"t", thread}}});
    return config;
}

LearnedProfile learn(TraceBuilder& builder, const config::Config& config) {
    const auto trace = parse_trace(builder.bytes(), "a.trace");
    REQUIRE(trace);
    return learn_profile(*trace, config, "stack");
}

/// A detector: an input of 4 ms, three equal layers of different times, and a head.
void frames(TraceBuilder& builder, const std::string& name, int count,
            std::uint32_t input_blocks = 40, std::int64_t head_ns = 50'000) {
    TracedThread thread(builder, 7, name);
    for (int i = 0; i < count; ++i) {
        thread.sleep_until((i + 1) * 20 * kMs);
        thread.compute(600'000);
        thread.launch({"input", input_blocks, 256, 4 * kMs, 0.25});
        for (const std::int64_t us : {100, 200, 600}) {
            thread.launch({"layer", 10, 128, us * 1000, 0.5});
        }
        thread.wait(abi::TraceWait::kEvent);
        thread.compute(30'000);
        thread.launch({"head", 5, 64, head_ns, 0.1});
        thread.wait();
    }
}

bool has_warning(const LearnedProfile& learned, const std::string& text) {
    return std::any_of(
        learned.warnings.begin(), learned.warnings.end(),
        [&](const std::string& each) { return each.find(text) != std::string::npos; });
}

TEST_CASE("Profile has the kernels, segments and times of a task", "[unit][trace]") {
    TraceBuilder builder;
    frames(builder, "det", 25);
    const LearnedProfile learned = learn(builder, config_of("det"));
    CHECK(learned.warnings.empty());
    const Profile& profile = learned.profile;
    CHECK(profile.gpu == "Test GPU");
    CHECK(profile.driver == "13.0");
    CHECK(profile.sm_clock_mhz == 1980);
    CHECK(profile.memory_clock_mhz == 3201);
    CHECK(profile.program == "stack");
    CHECK(profile.runs == 1);
    CHECK(profile.kernel_set_hash == kernel_set_hash({"head", "input", "layer"}));
    const TaskProfile& task = profile.chains.at(0).tasks.at(0);
    CHECK(task.name == "t");
    CHECK(task.instances == 25);
    CHECK(task.cpu_time == 630us);
    REQUIRE(task.kernels.size() == 5);
    CHECK(task.kernels[0].name == "input");
    CHECK(task.kernels[0].grid_blocks == 40);
    CHECK(task.kernels[0].block_threads == 256);
    CHECK(task.kernels[0].gpu_time == 4ms);
    CHECK(task.kernels[0].utilization == Approx(0.25).margin(1e-3));
    CHECK(task.kernels[0].samples == 25);
    CHECK(task.kernels[1].gpu_time == 100us);
    CHECK(task.kernels[3].gpu_time == 600us);
    REQUIRE(task.segments.size() == 2);
    CHECK(task.segments[0].num_launches == 4);
    CHECK(task.segments[0].closed_by == "event");
    CHECK(task.segments[0].cpu_time == 600us);
    CHECK(task.segments[1].closed_by == "stream");
    CHECK(task.segments[1].cpu_time == 30us);
    REQUIRE(task.sizes.size() == 3);
    CHECK(task.sizes[2].name == "layer");
    CHECK(task.sizes[2].gpu_time == 300us);  // the mean over the positions
    const TaskReport& report = learned.tasks.at(0);
    CHECK(report.samples == 125);
    CHECK(report.clean_samples == 125);
    CHECK(report.period == 20ms);
}

TEST_CASE("Profile that was learned is one that can be read", "[unit][trace]") {
    TraceBuilder builder;
    frames(builder, "det", 6);
    builder.add(7, TraceKind::kLaunch, 800 * kMs).flags = abi::kTraceGraph;
    const Profile profile = learn(builder, config_of("det")).profile;
    const auto read = config::parse_profile(config::to_profile_text(profile), "p.json");
    REQUIRE(read);
    CHECK(read->chains.at(0).tasks.at(0).kernels.size() == 5);
    CHECK(read->kernel_set_hash == profile.kernel_set_hash);
}

TEST_CASE("Profile of varying sizes has the mean at the position and a look-up", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 7, "det");
    for (int i = 0; i < 30; ++i) {
        thread.sleep_until((i + 1) * 20 * kMs);
        const auto blocks = static_cast<std::uint32_t>(100 * (1 + i % 3));
        thread.launch({"voxelize", blocks, 256, blocks * 10'000, 0.5});
        thread.wait();
    }
    const TaskProfile task = learn(builder, config_of("det")).profile.chains[0].tasks[0];
    CHECK(task.instances == 30);
    REQUIRE(task.kernels.size() == 1);
    CHECK(task.kernels[0].gpu_time == 2ms);
    CHECK(task.kernels[0].samples == 30);
    REQUIRE(task.sizes.size() == 3);
    CHECK(task.sizes[0].grid_blocks == 100);
    CHECK(task.sizes[0].gpu_time == 1ms);
    CHECK(task.sizes[2].grid_blocks == 300);
    CHECK(task.sizes[2].gpu_time == 3ms);
}

TEST_CASE("Profile takes the most frequent instance, and the range of its launches",
          "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 7, "det");
    for (int i = 0; i < 40; ++i) {
        thread.sleep_until((i + 1) * 20 * kMs);
        thread.launch({"a"});
        const int extra = i % 10 == 3 ? 7 : i % 10 == 6 ? 1 : 4;
        for (int k = 0; k < extra; ++k) thread.launch({"b"});
        thread.wait();
    }
    const TaskProfile task = learn(builder, config_of("det")).profile.chains[0].tasks[0];
    CHECK(task.kernels.size() == 5);
    REQUIRE(task.segments.size() == 1);
    CHECK(task.segments[0].num_launches == 5);
    CHECK(task.segments[0].min_launches == 2);
    CHECK(task.segments[0].max_launches == 8);
}

TEST_CASE("Profile says what was not found, and which threads there were", "[unit][trace]") {
    TraceBuilder builder;
    frames(builder, "detector_0", 10);
    config::Config config = config_of("det_*");
    const LearnedProfile learned = learn(builder, config);
    CHECK(has_warning(learned,
                      "task 't' of chain 'C0': nothing launched matched it (thread: "
                      "det_*); threads that launched: detector_0 (50)"));
    CHECK(learned.profile.chains[0].tasks[0].kernels.empty());
    CHECK(learned.profile.kernel_set_hash == 0);
    config.chains[0].tasks[0].thread_glob = "";
    CHECK(has_warning(learn(builder, config), "(by hints only)"));
}

TEST_CASE("Profile warns of few instances, another period, and no pattern", "[unit][trace]") {
    TraceBuilder builder;
    frames(builder, "det", 4);
    const LearnedProfile few = learn(builder, config_of("det", 30ms));
    CHECK(has_warning(few, "only 4 instances were seen, accepted: 5 or more"));
    CHECK(has_warning(few,
                      "measured period 20.00 ms, accepted: within 20 % of its period_ms, "
                      "30.00"));
    CHECK_FALSE(has_warning(learn(builder, config_of("det", 24ms)), "period"));

    TraceBuilder odd;
    TracedThread thread(odd, 7, "det");
    for (int i = 0; i < 30; ++i) {
        thread.launch({"k" + std::to_string(i * i % 31), 1, 32});
        thread.wait();
    }
    CHECK(has_warning(learn(odd, config_of("det")), "every segment was taken for an instance"));
}

TEST_CASE("Profile warns of launches without a time, and of times that are never alone",
          "[unit][trace]") {
    TraceBuilder builder;
    std::int64_t time = 0;
    for (int i = 0; i < 10; ++i) {
        builder.add(1, TraceKind::kLaunch, time += 20 * kMs);
        abi::TraceRecord& wait = builder.add(1, TraceKind::kWait, time + 1);
        wait.flags = abi::kTraceCovers;
        wait.wait.end_ns = time + 2;
    }
    abi::TraceRecord& name = builder.add(1, TraceKind::kThread, 0);
    std::strcpy(name.name, "det");
    const LearnedProfile unmarked = learn(builder, config_of("det"));
    CHECK(has_warning(unmarked, "10 of 10 launches have no GPU time"));
    CHECK(has_warning(unmarked, "all of its kernels would take no time"));
    CHECK(unmarked.profile.chains[0].tasks[0].kernels.empty());

    TraceBuilder busy;
    frames(busy, "det", 10);
    TracedThread other(busy, 9, "other");
    for (int i = 0; i < 30; ++i) other.launch({"fill", 1, 32, 10 * kMs, 1});
    const LearnedProfile contended = learn(busy, config_of("det"));
    CHECK(has_warning(contended, "all launches ran beside others' work"));
    CHECK(contended.tasks[0].clean_samples == 0);
}

TEST_CASE("Profile goes by launches whose begin mark waited, and by a plausible mark",
          "[unit][trace]") {
    // Seven of ten begin marks executed at once: launching is in those kernels' times.
    TraceBuilder builder;
    TracedThread thread(builder, 7, "det");
    for (int i = 0; i < 10; ++i) {
        thread.sleep_until((i + 1) * 20 * kMs);
        const bool loose = i % 3 != 0;
        thread.launch({"layer", 10, 128, loose ? 15'000 : 10'000, 0.5}, -1, 0,
                      loose ? abi::kTraceLoose : std::uint8_t{0});
        thread.wait();
    }
    const auto time = [&] {
        return busy_time(learn(builder, config_of("det")).profile.chains[0].tasks[0]);
    };
    CHECK(time() == 10us);
    for (const std::uint32_t pause_ns : {0, 4000}) {  // not measured, implausible
        builder.header.pause_ns = pause_ns;
        CHECK(time() == 10'500ns);
        CHECK(has_warning(learn(builder, config_of("det")), "the GPU's pause between a kernel"));
    }
    builder.header.mark_ns = 202'000;  // measured beside somebody's kernel
    CHECK(time() == 11'500ns);         // the mark and the pause are in it
    CHECK(has_warning(learn(builder, config_of("det")),
                      "what a mark takes was measured as 202.0 us"));
}

Profile learned(int count, std::uint32_t input_blocks = 40, std::int64_t head_ns = 50'000) {
    TraceBuilder builder;
    frames(builder, "det", count, input_blocks, head_ns);
    return learn(builder, config_of("det")).profile;
}

TEST_CASE("Merged profile weighs times by their samples", "[unit][trace]") {
    const auto merged = merge_profiles(learned(30), learned(10, 40, 90'000));
    REQUIRE(merged);
    CHECK(merged->runs == 2);
    const TaskProfile& task = merged->chains.at(0).tasks.at(0);
    CHECK(task.instances == 40);
    REQUIRE(task.kernels.size() == 5);
    CHECK(task.kernels[4].gpu_time == 60us);
    CHECK(task.kernels[4].samples == 40);
    CHECK(task.kernels[0].gpu_time == 4ms);
    CHECK(task.cpu_time == 630us);
    CHECK(task.sizes.size() == 3);
}

TEST_CASE("Merged profile has the sizes and tasks of both", "[unit][trace]") {
    Profile older = learned(6), newer = learned(30, 80);
    older.chains.push_back({"gone", {}});
    newer.chains.push_back({"new", {}});
    const auto merged = merge_profiles(older, newer);
    REQUIRE(merged);
    CHECK(merged->chains.size() == 3);
    const TaskProfile& task = merged->chains[0].tasks[0];
    CHECK(task.sizes.size() == 4);
    CHECK(task.kernels[0].grid_blocks == 80);  // of more samples
    // A task that was not seen in one run is the other's.
    older.chains[0].tasks[0] = {};
    older.chains[0].tasks[0].name = "t";
    CHECK(merge_profiles(older, newer)->chains[0].tasks[0].instances == 30);
    CHECK(merge_profiles(newer, older)->chains[0].tasks[0].instances == 30);
}

TEST_CASE("Merging keeps the typical instance of more instances when they differ",
          "[unit][trace]") {
    Profile older = learned(30), newer = learned(10);
    newer.chains[0].tasks[0].kernels.pop_back();
    newer.chains[0].tasks[0].segments[1].max_launches = 9;
    const auto merged = merge_profiles(older, newer);
    REQUIRE(merged);
    CHECK(merged->chains[0].tasks[0].kernels.size() == 5);
    CHECK(merged->chains[0].tasks[0].segments[1].max_launches == 9);
    CHECK(merged->chains[0].tasks[0].instances == 40);
}

TEST_CASE("Profiles of another GPU, clock, program or kernel set are not merged", "[unit][trace]") {
    const Profile older = learned(6);
    const auto refusal = [&older](auto&& change) {
        Profile newer = older;
        change(newer);
        const auto merged = merge_profiles(older, newer);
        return merged ? "" : merged.error();
    };
    CHECK(refusal([](Profile&) {}).empty());
    CHECK(refusal([](Profile& p) { p.gpu = "B"; }) ==
          "cannot be merged: another GPU: found B, accepted: Test GPU");
    CHECK(refusal([](Profile& p) { p.sm_clock_mhz = 5; }).find("SM clock") != std::string::npos);
    CHECK(refusal([](Profile& p) { p.memory_clock_mhz = 5; }).find("memory clock") !=
          std::string::npos);
    CHECK(refusal([](Profile& p) { p.program = "b"; }).find("another program") !=
          std::string::npos);
    CHECK(refusal([](Profile& p) { p.sm_clock_mhz = 0; }).empty());
    CHECK(refusal([](Profile& p) { p.driver = "12.4"; }).empty());
    const auto rename = [](Profile& p) {
        for (auto& kernel : p.chains[0].tasks[0].kernels) kernel.name += "_v2";
    };
    CHECK(refusal([&](Profile& p) {
              rename(p);
              p.chains[0].tasks[0].sizes.clear();
          }).find("another set of kernels: found 'head_v2'") != std::string::npos);
    CHECK(refusal([&](Profile& p) { rename(p); }).empty());  // has all of the older's, and more
}

}  // namespace
}  // namespace urgengo::trace
