// SPDX-License-Identifier: Apache-2.0
//
// Drafts of programs that live in virtual time: which chains, known by what, with which periods.
#include "tools/discover/draft.h"

#include <set>

#include "host/config/config_reader.h"
#include "tests/support/catch.h"
#include "tests/support/trace_builder.h"

namespace urgengo::discover {
namespace {

using testing::TestKernel;
using testing::TraceBuilder;
using testing::TracedThread;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kBegin = 100 * kMs;

const TestKernel kStem{"stem", 64, 256}, kConv{"conv", 32, 128}, kConvBig{"conv", 64, 128},
    kGemm{"gemm", 16, 64}, kCopy{"copy", 8, 32};

/// `count` frames, each of these kernels and a wait, at the thread's own pace.
void run_frames(TracedThread& thread, int count, std::int64_t period_ns,
                const std::vector<TestKernel>& kernels, std::int64_t begin_ns = kBegin) {
    for (int frame = 0; frame < count; ++frame) {
        thread.sleep_until(begin_ns + frame * period_ns);
        for (const TestKernel& kernel : kernels) thread.launch(kernel);
        thread.wait();
    }
}

struct Discovered {
    Draft draft;
    config::Config config;  ///< the draft, read back

    const config::Chain& chain(const std::string& name) const {
        INFO(draft.yaml);
        for (const config::Chain& chain : config.chains) {
            if (chain.name == name) return chain;
        }
        FAIL("there is no chain " + name);
        return config.chains.front();
    }
    const config::Task& task(const std::string& name) const { return chain(name).tasks.at(0); }
    bool says(const std::string& text) const {
        const bool found = draft.yaml.find(text) != std::string::npos;
        if (!found) UNSCOPED_INFO(draft.yaml);
        return found;
    }
};

Discovered discover(TraceBuilder& builder) {
    const auto trace = trace::parse_trace(builder.bytes(), "t.ugtrace");
    REQUIRE(trace);
    const config::Config nothing_known;
    const Observation seen = observe(*trace, trace::TaskMatcher(nothing_known, *trace));
    Activities activities = find_activities(seen);
    const std::vector<Rule> rules = choose_rules(seen, activities);
    Discovered result{write_draft(seen, activities, rules, "./stack --fast"), {}};
    if (result.draft.chains.empty()) return result;
    const auto config = config::parse_config(result.draft.yaml, "draft.yaml");
    INFO(result.draft.yaml);
    INFO((config ? "" : config.error()));
    REQUIRE(config);
    result.config = *config;
    return result;
}

double ms(std::chrono::nanoseconds time) {
    return static_cast<double>(time.count()) / kMs;
}

TEST_CASE("Chain has the thread's name and the measured period when its thread has its own",
          "[tools][discover]") {
    TraceBuilder builder;
    TracedThread lidar(builder, 1, "lidar"), camera(builder, 2, "cam[0]");
    for (int i = 0; i < 7; ++i) lidar.launch(kCopy);  // it starts up
    lidar.wait();
    run_frames(lidar, 30, 50 * kMs, {kStem, kConv});
    run_frames(camera, 40, 33 * kMs, {kStem, kGemm, kGemm});
    const Discovered found = discover(builder);
    REQUIRE(found.config.chains.size() == 2);
    CHECK(found.task("lidar").thread_glob == "lidar");
    CHECK(found.task("lidar").kernels.empty());
    CHECK(ms(found.chain("lidar").period) == Approx(50).epsilon(0.01));
    CHECK(found.chain("lidar").deadline == found.chain("lidar").period);
    CHECK(found.task("cam_0").thread_glob == "cam\\[0]");
    CHECK(ms(found.chain("cam_0").period) == Approx(33).epsilon(0.01));
    CHECK(found.says("# a first guess: the period"));
    CHECK(found.says("start-up left out: 7 launches"));
    CHECK(found.says("per frame: 3 launches (3 to 3) in 1 segment, waited for by: stream"));
    CHECK(found.says("of: ./stack --fast"));
}

TEST_CASE("Chains are known by a kernel when threads of one name run different networks",
          "[tools][discover]") {
    TraceBuilder builder;
    TracedThread main(builder, 1, "python3"), a(builder, 2, "python3"), b(builder, 3, "python3"),
        c(builder, 4, "python3");
    main.launch(kCopy);
    main.wait();
    run_frames(a, 30, 40 * kMs, {kStem, kConv, kGemm});
    run_frames(b, 30, 50 * kMs, {kStem, kConvBig, kGemm});
    run_frames(c, 30, 60 * kMs, {kCopy, kStem});
    const Discovered found = discover(builder);
    REQUIRE(found.config.chains.size() == 3);
    std::set<std::string> kernels;
    for (const config::Chain& chain : found.config.chains) {
        REQUIRE(chain.tasks.at(0).kernels.size() == 1);
        const config::KernelPattern& pattern = chain.tasks[0].kernels[0];
        const std::string rule = pattern.name_glob + std::to_string(pattern.grid_blocks);
        kernels.insert(rule);
        const double period = rule == "conv32" ? 40 : rule == "conv64" ? 50 : 60;
        CHECK(ms(chain.period) == Approx(period).epsilon(0.01));
    }
    // The stem is everybody's; the sizes tell two apart; one has a kernel of its own.
    CHECK(kernels == std::set<std::string>{"conv32", "conv64", "copy0"});
    CHECK(found.says("known by kernel 2 of its frames, conv: others launch the ones before it"));
    CHECK(found.says("known by the first kernel of its frames, copy"));
}

TEST_CASE("Threads are one chain and said to be when nothing tells them apart",
          "[tools][discover]") {
    TraceBuilder builder;
    TracedThread a(builder, 1, "python3"), b(builder, 2, "python3"), c(builder, 3, "python3");
    run_frames(a, 30, 40 * kMs, {kStem, kConv});
    run_frames(b, 30, 40 * kMs, {kStem, kConv}, kBegin + 3 * kMs);
    run_frames(c, 30, 40 * kMs, {kGemm});
    const Discovered found = discover(builder);
    REQUIRE(found.config.chains.size() == 2);
    CHECK(found.task("stem").kernels.at(0).name_glob == "stem");
    CHECK(ms(found.chain("stem").period) == Approx(40).epsilon(0.01));
    CHECK(
        found.says("by 2 threads named 'python3', each with frames of its own; nothing tells "
                   "them apart"));
}

TEST_CASE("Threads are one chain when they take turns at its frames", "[tools][discover]") {
    TraceBuilder builder;
    TracedThread pool[] = {{builder, 1, "pool"}, {builder, 2, "pool"}, {builder, 3, "pool"}};
    // No thread's own frames are regular.
    const std::string turns = "accabcbccacabbcaacbccbbcaacacbcacaacababbccbcbbccbabaaababcb";
    for (int frame = 0; frame < 60; ++frame) {
        TracedThread& thread =
            pool[static_cast<std::size_t>(turns[static_cast<std::size_t>(frame)] - 'a')];
        thread.sleep_until(kBegin + frame * 20 * kMs);
        thread.launch(kStem);
        thread.launch(kConv);
        thread.wait();
    }
    const Discovered found = discover(builder);
    REQUIRE(found.config.chains.size() == 1);
    CHECK(ms(found.config.chains[0].period) == Approx(20).epsilon(0.01));
    CHECK(found.says("by 3 threads named 'pool', which take turns"));
}

TEST_CASE("One thread has several chains when it does several things at rates of their own",
          "[tools][discover]") {
    TraceBuilder builder;
    TracedThread executor(builder, 1, "executor");
    for (int tick = 0; tick < 120; ++tick) {
        executor.sleep_until(kBegin + tick * 10 * kMs);
        if (tick % 2 == 0) executor.launch(kStem), executor.launch(kConv), executor.wait();
        if (tick % 6 == 3) executor.launch(kGemm), executor.wait();
    }
    const Discovered found = discover(builder);
    REQUIRE(found.config.chains.size() == 2);
    CHECK(ms(found.chain("stem").period) == Approx(20).epsilon(0.02));
    CHECK(ms(found.chain("gemm").period) == Approx(60).epsilon(0.02));
    CHECK(found.task("gemm").kernels.at(0).name_glob == "gemm");
}

TEST_CASE("Chain is known by its NVTX range when neither thread nor kernel tells",
          "[tools][discover]") {
    TraceBuilder builder;
    TracedThread a(builder, 1, "worker"), b(builder, 2, "worker");
    for (int frame = 0; frame < 30; ++frame) {
        a.sleep_until(kBegin + frame * 40 * kMs);
        a.push("plan " + std::to_string(frame));
        a.launch(kStem);
        a.wait();
        a.pop();
        b.sleep_until(kBegin + 5 * kMs + frame * 40 * kMs);
        b.push("track");
        b.launch(kStem);
        b.wait();
        b.pop();
    }
    const Discovered found = discover(builder);
    REQUIRE(found.config.chains.size() == 2);
    std::set<std::string> ranges;
    for (const config::Chain& chain : found.config.chains) {
        ranges.insert(chain.tasks.at(0).nvtx_glob);
        CHECK(chain.tasks[0].kernels.empty());
    }
    CHECK(ranges == std::set<std::string>{"plan *", "track"});
}

TEST_CASE("What is not periodic is left out and named when its GPU time counts",
          "[tools][discover]") {
    TraceBuilder builder;
    TracedThread lidar(builder, 1, "lidar"), odd(builder, 2, "map builder");
    run_frames(lidar, 30, 50 * kMs, {kStem});
    std::int64_t gap = 3 * kMs;
    for (int i = 0; i < 20; ++i) {
        odd.sleep(gap);
        for (int k = 0; k <= i % 3; ++k) odd.launch({"rebuild", 1, 32, 300'000});
        odd.wait();
        gap = gap * 7 % (97 * kMs) + kMs;
    }
    const Discovered found = discover(builder);
    REQUIRE(found.config.chains.size() == 1);
    CHECK(found.config.chains[0].name == "lidar");
    CHECK(
        found.says("# Left out:\n# - not periodic, or only once, by threads named 'map builder': "
                   "39 launches, 11.7 ms, 79.6 % of all GPU time: rebuild (11.7 ms)"));
}

TEST_CASE("Chains that always follow each other are noted when they have the same rate",
          "[tools][discover]") {
    TraceBuilder builder;
    TracedThread detect(builder, 1, "detect"), track(builder, 2, "track"),
        other(builder, 3, "other");
    for (int frame = 0; frame < 30; ++frame) {
        detect.sleep_until(kBegin + frame * 40 * kMs);
        detect.launch(kStem);
        detect.wait();
        track.sleep_until(detect.now_ns() + 200'000);
        track.launch(kConv);
        track.wait();
        other.sleep_until(kBegin + 20 * kMs + frame * 40 * kMs);
        other.launch(kGemm);
        other.wait();
    }
    const Discovered found = discover(builder);
    REQUIRE(found.config.chains.size() == 3);
    CHECK(
        found.says("# track always begins 0.2 ms after detect has ended: likely two tasks of "
                   "one chain."));
    CHECK_FALSE(found.says("# other always"));
    CHECK_FALSE(found.says("after track has ended"));
}

TEST_CASE("Chain that never pauses is said to be perhaps background work", "[tools][discover]") {
    TraceBuilder builder;
    TracedThread train(builder, 1, "train"), lidar(builder, 2, "lidar"), eval(builder, 3, "eval");
    run_frames(train, 200, 0, {kStem, kConv, kGemm});
    run_frames(eval, 200, 0, {kStem, kConv, kGemm});
    run_frames(lidar, 30, 50 * kMs, {kStem});
    const Discovered found = discover(builder);
    REQUIRE(found.config.chains.size() == 3);
    std::size_t notes = 0;
    for (std::size_t at = 0;
         (at = found.draft.yaml.find("It never pauses", at)) != std::string::npos; ++at) {
        ++notes;
    }
    CHECK(notes == 2);
    CHECK_FALSE(found.says("always begins"));  // of course they do
}

TEST_CASE("Draft has no chain when nothing is periodic", "[tools][discover]") {
    TraceBuilder few;
    TracedThread thread(few, 1, "lidar");
    run_frames(thread, 3, 50 * kMs, {kStem});
    CHECK(discover(few).draft.chains.empty());
    TraceBuilder none;
    CHECK(discover(none).draft.chains.empty());
}

TEST_CASE("Draft is valid when names are odd or very long", "[tools][discover]") {
    TraceBuilder builder;
    TracedThread a(builder, 1, "#: \"\\\t*"), b(builder, 2, "python3"), c(builder, 3, "python3");
    const std::string prefix(200, 'k');
    run_frames(a, 30, 40 * kMs, {kStem});
    run_frames(b, 30, 40 * kMs, {{prefix + "_one"}});
    run_frames(c, 30, 50 * kMs, {{prefix + "_two"}});
    const Discovered found = discover(builder);
    REQUIRE(found.config.chains.size() == 3);
    std::set<std::string> globs;
    for (const config::Chain& chain : found.config.chains) {
        if (!chain.tasks[0].kernels.empty()) globs.insert(chain.tasks[0].kernels[0].name_glob);
    }
    CHECK(globs == std::set<std::string>{prefix + "_o*", prefix + "_t*"});
}

}  // namespace
}  // namespace urgengo::discover
