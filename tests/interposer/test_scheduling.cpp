// SPDX-License-Identifier: Apache-2.0
//
// Scheduling from end to end against the simulated GPU: statistics as the program leaves them, and
// what the GPU says that it ran. Nothing here depends on how fast the test's machine is: kernels
// take 50 ms of simulated time, so that threads have time to meet.
#include <nlohmann/json.hpp>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using nlohmann::json;

namespace {

struct ScheduledRun {
    Outcome outcome;
    json tight, loose;
};

std::function<void(config::Config&)> with_source(config::ProgressSource source) {
    return [source](config::Config& config) {
        config.scheduler.progress.source = source;
        config.scheduler.packing.share_slack = std::chrono::hours(1);  // deadlines here are far off
    };
}

/// Every source of progress, in turn.
config::ProgressSource each_source() {
    return GENERATE(config::ProgressSource::kAuto, config::ProgressSource::kMemop,
                    config::ProgressSource::kEvent);
}

ScheduledRun run_scheduled(const std::string& preset, config::Mode mode,
                           config::ProgressSource source = config::ProgressSource::kAuto) {
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    config::Profile profile;
    profile.chains = {{"tight", {scheduling_profile("tight")}},
                      {"loose", {scheduling_profile("loose")}}};
    const auto config =
        write_config(folder.path() / "config.json", preset, mode,
                     {chain("tight", 60s, {{"work", ""}}), chain("loose", 3600s, {{"work", ""}})},
                     &profile, with_source(source));
    ScheduledRun result;
    result.outcome = run_twin({"scheduling"}, configured(preloaded(), config, stats));
    REQUIRE(result.outcome.exit_status == 0);
    CHECK(result.outcome.err == "");
    const json root = json::parse(read_text(stats), nullptr, false);
    REQUIRE(!root.is_discarded());
    CHECK(root.at("tripped") == "");
    result.tight = root.at("chains").at(0);
    result.loose = root.at("chains").at(1);
    return result;
}

/// "tight_0 -5\n..." in launch order, for one chain; priorities cut off if not asked for.
std::vector<std::string> kernels_of(const std::string& chain_name, const std::string& out,
                                    bool priorities) {
    std::vector<std::string> found;
    for (const std::string& line : lines_of(out))
        if (line.rfind(chain_name, 0) == 0)
            found.push_back(priorities ? line : line.substr(0, line.find(' ')));
    return found;
}

std::vector<std::string> in_launch_order(const std::string& chain_name, const char* priority) {
    std::vector<std::string> expected;
    for (int i = 0; i < kSchedulingKernels; ++i)
        expected.push_back(chain_name + "_" + std::to_string(i) + priority);
    return expected;
}

}  // namespace

TEST_CASE("Kernels run at their streams' priority when UrgenGo is not there",
          "[interposer][scheduling]") {
    const Outcome outcome = run_twin({"scheduling"}, bare());
    REQUIRE(outcome.exit_status == 0);
    CHECK(kernels_of("tight", outcome.out, true) == in_launch_order("tight", " 0"));
    CHECK(kernels_of("loose", outcome.out, true) == in_launch_order("loose", " 0"));
}

TEST_CASE("Kernels run at their streams' priority when UrgenGo only looks on",
          "[interposer][scheduling]") {
    const auto [preset, mode] = GENERATE(table<std::string, config::Mode>(
        {{"urgengo", config::Mode::kObserve}, {"vanilla", config::Mode::kEnforce}}));
    const ScheduledRun run = run_scheduled(preset, mode);
    CHECK(kernels_of("tight", run.outcome.out, true) == in_launch_order("tight", " 0"));
    CHECK(kernels_of("loose", run.outcome.out, true) == in_launch_order("loose", " 0"));
    for (const json& chain : {run.tight, run.loose}) {
        CHECK(chain.at("launches") == kSchedulingKernels);
        CHECK(chain.at("finished") == 1);
        CHECK(chain.at("holds") == 0);
    }
}

TEST_CASE("Urgent chain runs at the greatest priority and the other is held when both want the GPU",
          "[interposer][scheduling]") {
    const ScheduledRun run = run_scheduled("urgengo", config::Mode::kEnforce, each_source());
    CHECK(kernels_of("tight", run.outcome.out, true) == in_launch_order("tight", " -5"));
    CHECK(kernels_of("loose", run.outcome.out, false) == in_launch_order("loose", ""));
    for (const json& chain : {run.tight, run.loose}) {
        CHECK(chain.at("instances") == 1);
        CHECK(chain.at("finished") == 1);
        CHECK(chain.at("missed") == 0);
        CHECK(chain.at("launches") == kSchedulingKernels);
        CHECK(chain.at("marks") > 0);
    }
    CHECK(run.tight.at("holds") == 0);
    CHECK(run.loose.at("holds") > 0);
}

TEST_CASE("Every kind of launch runs at its task's priority and leaves its stream its own",
          "[interposer][scheduling]") {
    const auto via =
        GENERATE(config::PriorityVia::kAuto, config::PriorityVia::kLaunchAttribute,
                 config::PriorityVia::kStreamAttribute, config::PriorityVia::kStreamPool);
    const Folder folder;
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                     {chain("main", 10s, {{"m", "twin"}})}, nullptr,
                     [via](config::Config& its) { its.scheduler.priority.via = via; });
    const Outcome outcome =
        run_twin({"priorities_of_launches"}, configured(preloaded(), config, {}));
    CHECK(outcome.err == "");
    CHECK(lines_of(outcome.out) ==
          std::vector<std::string>{"flags 8", "by_plain -5", "by_extended -5", "by_cooperative -5",
                                   "by_old -5", "by_graph -5", "by_nodes -5", "by_nodes -5",
                                   "stream 0"});
    CHECK(lines_of(run_twin({"priorities_of_launches"}, bare()).out) ==
          std::vector<std::string>{"flags 8", "by_plain 0", "by_extended 0", "by_cooperative 0",
                                   "by_old 0", "by_graph 0", "by_nodes 0", "by_nodes 0",
                                   "stream 0"});
}

TEST_CASE("Any thread may ask where the GPU is in a task", "[interposer][scheduling]") {
    const Folder folder;
    config::Profile profile;
    profile.chains = {{"tight", {scheduling_profile("tight")}}};
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                     {chain("tight", 60s, {{"work", ""}})}, &profile, with_source(each_source()));
    const Outcome outcome = run_twin({"position"}, configured(preloaded(), config, {}));
    CHECK(outcome.err == "");
    CHECK(lines_of(outcome.out) ==
          std::vector<std::string>{"before 0", "goes back 0, fits 1, moves 1", "after 1",
                                   "busy 0, launch 5, instance 1, overdue 0, remaining 0, "
                                   "unexecuted 0, uncertain 0",
                                   "unknown 0 0 0 0", "small 0, null 0"});
}

TEST_CASE("Nobody says where the GPU is when UrgenGo is not there", "[interposer][scheduling]") {
    const auto lines = lines_of(run_twin({"position"}, bare()).out);
    REQUIRE(lines.size() == 6);
    CHECK(lines[2] == "after 0");
}

namespace {

/// Runs a scenario whose main thread is a task. @returns its chain's statistics
json run_as_task(const std::vector<std::string>& arguments,
                 const config::Profile* profile = nullptr, const char* failures = "",
                 const std::function<void(config::Config&)>& change = {}) {
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                     {chain("main", 10s, {{"m", "twin"}})}, profile, change);
    Environment environment = configured(preloaded(), config, stats);
    if (*failures) environment["SIMGPU_FAIL"] = failures;
    const Outcome outcome = run_twin(arguments, environment);
    CHECK(outcome.out == "done\n");
    CHECK(outcome.err == "");
    const json root = json::parse(read_text(stats), nullptr, false);
    REQUIRE(!root.is_discarded());
    return root.at("chains").at(0);
}

}  // namespace

TEST_CASE("Progress is followed into another context when the first one was not waited for",
          "[interposer][scheduling]") {
    const auto marks_all = [source = each_source()](config::Config& config) {
        config.scheduler.progress.source = source;
        config.scheduler.progress.mark_every = std::chrono::nanoseconds(0);
    };
    const json main = run_as_task({"unsynchronised_contexts"}, nullptr, "", marks_all);
    CHECK(main.at("launches") == 201);
    // As many as may be under way at once, at least; the first context has one launch.
    CHECK(main.at("marks") > 50);
    CHECK(main.at("holds_opened") == 0);  // without progress the bound alone ends the wait
}

TEST_CASE("Instance ends when the program waits for its context as in CUDA 13",
          "[interposer][scheduling]") {
    const json main = run_as_task({"waits_for_contexts"});
    CHECK(main.at("launches") == 3);
    CHECK(main.at("finished") == 3);
}

TEST_CASE("Capture is over when the stream that it began on is destroyed",
          "[interposer][scheduling]") {
    // Asked about the launch that is captured, and never again: the failure would cost a launch.
    const json main = run_as_task({"abandoned_capture"}, nullptr, "cuStreamIsCapturing:2:1");
    CHECK(main.at("launches") == 4);
}

TEST_CASE("Call that waits for all GPU work is seen as such", "[interposer][scheduling]") {
    const std::string call = GENERATE(as<std::string>{}, "cuMemFree", "cuMemFreeHost",
                                      "cuMemHostUnregister", "cuMemUnmap", "cuArrayDestroy",
                                      "cuMipmappedArrayDestroy", "cuCtxSetLimit", "cuModuleUnload");
    INFO(call);
    CHECK(run_as_task({"waits_for_all_work", call}).at("implicit_syncs") == 1);
}

TEST_CASE("First launch of a kernel counts as a wait for all GPU work",
          "[interposer][scheduling]") {
    const json main = run_as_task({"first_launches"});
    CHECK(main.at("launches") == 7);
    CHECK(main.at("implicit_syncs") == 2);
}

// A sanitizer's allocator gives no address out again so soon.
#if !SANITIZED
TEST_CASE("Kernel is known by its own name when it has the handle of one that is gone",
          "[interposer][scheduling]") {
    config::TaskProfile task;
    task.name = "m";
    task.kernels = {{"known", 4, 64, 10us, 0.1}};
    config::Profile profile;
    profile.chains = {{"main", {task}}};
    // The time is made up: where it is not learned, a busy machine has it corrected, and said so.
    const auto learns = [](config::Config& config) { config.scheduler.progress.learn = true; };
    const json main = run_as_task({"reused_handles"}, &profile, "", learns);
    CHECK(main.at("unknown") == 5);  // those of the other name
}
#endif

TEST_CASE("Forked child writes no statistics when it exits", "[interposer][scheduling]") {
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    const auto config = write_config(folder.path() / "config.json", "urgengo",
                                     config::Mode::kEnforce, {chain("main", 10s, {{"m", "twin"}})});
    Environment environment = configured(preloaded(), config, stats);
    environment["URGENGO_SUMMARY"] = "1";
    const Outcome outcome = run_twin({"fork_and_leave"}, environment);
    CHECK(outcome.exit_status == 0);
    CHECK(outcome.err == "");
    CHECK_FALSE(std::filesystem::exists(stats));
}

// Of the others there is always one that is in time, and comes first; and what is on the GPU at a
// low priority stays behind all that they launch.
TEST_CASE("Chain that the others leave nothing gets the GPU all the same",
          "[interposer][scheduling]") {
    const Folder folder;
    const std::string preset = GENERATE("urgengo", "paper", "edf");
    std::vector<config::Chain> chains{chain("light", 50ms, {{"work", "light"}})};
    for (const std::string number : {"0", "1", "2", "3"})
        chains.push_back(chain("greedy_" + number, 40ms, {{"work", "greedy_" + number}}));
    const auto config =
        write_config(folder.path() / "config.json", preset, config::Mode::kEnforce, chains);
    const Outcome outcome = run_twin({"overload"}, configured(preloaded(), config));
    CHECK(outcome.exit_status == 0);
    CHECK(outcome.err == "");
    std::string all_ended;
    for (int frame = 0; frame < 8; ++frame)
        all_ended += "frame " + std::to_string(frame) + " ended\n";
    CHECK(outcome.out == all_ended);
}

TEST_CASE("Chain that waits for a lock which a held launch's thread has gets it soon",
          "[interposer][scheduling]") {
    const Folder folder;
    const std::string preset = GENERATE("urgengo", "edf");
    std::vector<config::Chain> chains{chain("urgent", 15ms, {{"work", "urgent"}}),
                                      chain("middle", 500ms, {{"work", "middle"}}),
                                      chain("loose", 5s, {{"work", "loose"}})};
    chains[0].period = 20ms;
    const auto config =
        write_config(folder.path() / "config.json", preset, config::Mode::kEnforce, chains);
    const Outcome outcome = run_twin({"locks"}, configured(preloaded(), config));
    CHECK(outcome.exit_status == 0);
    CHECK(outcome.out == "the lock came in time\n");
}
