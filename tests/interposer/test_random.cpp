// SPDX-License-Identifier: Apache-2.0
//
// Random conformance: programs of random_program.h must end with the same memory, results and order
// bare and under UrgenGo, with what it holds of itself and with holds at random.
//
//   URGENGO_TEST_PROGRAMS   how many, for a long soak
//   URGENGO_TEST_FIRST      the first seed
#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "tests/interposer/kernels.h"
#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
namespace fs = std::filesystem;

namespace {

// A process each, so that a run that does not end is noticed early.
constexpr std::uint64_t kProgramsPerRun = 500;
constexpr unsigned kLongestRun_s = 120;

// What ends the line of a program that went as CUDA promises; in scenario_random.cpp too.
const std::string kRight = "all kept";
constexpr int kBareRepeats = 30;

std::uint64_t number_from(const char* variable, std::uint64_t otherwise) {
    const char* const text = std::getenv(variable);
    if (!text || !*text) return otherwise;
    char* end = nullptr;
    const std::uint64_t number = std::strtoull(text, &end, 10);
    INFO(variable << ": found '" << text << "', accepted: a whole number from 1");
    REQUIRE((*end == '\0' && number > 0));
    return number;
}

std::uint64_t default_count() {
    if (on_real_gpu()) return 1000;
    return SANITIZED ? 300 : 10000;
}

/// Chains for the names that random programs give their threads, tight and loose.
std::vector<config::Chain> chains() {
    std::vector<config::Chain> all{chain("main", 5ms, {{"main", "twin"}})};
    for (int i = 0; i < 8; ++i) {
        const std::string name = "twin_" + std::to_string(i);
        all.push_back(chain(name, 20ms * (8 - i) + 1ms, {{"work", name}}));
    }
    all.push_back(chain("others", 3s, {{"work", "twin*"}}));
    return all;
}

/// Wide kernels are known to fill the GPU, so that those of looser chains wait for them.
config::Profile profile(std::chrono::nanoseconds wide_time, std::chrono::nanoseconds long_time,
                        std::uint64_t num_blocks) {
    config::Profile profile;
    for (const config::Chain& its : chains()) {
        config::TaskProfile task;
        task.name = its.tasks.front().name;
        task.kernels = {{"wide", num_blocks, 1024, wide_time, 1.0},
                        {"long", num_blocks, 1024, long_time, 1.0}};
        task.sizes = task.kernels;
        profile.chains.push_back({its.name, {task}});
    }
    return profile;
}

/// One chain for all threads, whose plan is one kernel again and again: wherever a program launches
/// it several times in a row, no launch but the first is asked about.
std::vector<config::Chain> one_chain() {
    return {chain("all", 3s, {{"work", "twin*"}})};
}
config::Profile plan_of_mixes() {
    constexpr std::uint32_t kLaunches = 1000;
    config::TaskProfile task;
    task.name = "work";
    task.kernels.assign(kLaunches, config::KernelProfile{twin::kMixName, 1, 1, 2us, 0.1});
    task.segments = {{0ns, kLaunches, 1, kLaunches, "stream"}};
    config::Profile profile;
    profile.chains = {{"all", {task}}};
    return profile;
}

struct SetUp {
    const char* name;
    Environment environment;
    fs::path stats;
    int every = 1;  ///< so many runs
    bool held_at_random = false;
    int holds = 0;  ///< counted so far
    int as_planned = 0;
    int synchronisations = 0;
    int gates = 0;
    int rounds_by_gpu = 0;
};

Environment with_fast_gpu(Environment environment) {
    if (!on_real_gpu()) environment["SIMGPU_TIME_SCALE"] = "0.02";
    return environment;
}

std::vector<SetUp> set_ups(const fs::path& folder) {
    const Outcome about = run_twin({"about_gpu"}, bare());
    INFO("no GPU that the driver can use");  // in tests/interposer/CMakeLists.txt too
    REQUIRE(about.exit_status == 0);
    const config::Profile known = on_real_gpu() ? profile(300us, 5ms, std::stoul(about.out))
                                                : profile(6us, 100us, std::stoul(about.out));
    const auto with = [&](const char* name, const char* file, int every = 1,
                          const std::function<void(config::Config&)>& change = {}) {
        const fs::path config = write_config(folder / file, "urgengo", config::Mode::kEnforce,
                                             chains(), &known, change);
        const fs::path stats = folder / ("statistics of " + std::string(name) + ".json");
        return SetUp{name, with_fast_gpu(configured(preloaded(), config, stats)), stats, every,
                     std::string_view(file) != "config.json"};
    };
    const fs::path planned = folder / "as planned.json";
    const config::Profile mixes = plan_of_mixes();
    const Environment as_planned =
        with_fast_gpu(configured(preloaded(),
                                 write_config(folder / "planned.json", "urgengo",
                                              config::Mode::kEnforce, one_chain(), &mixes),
                                 planned));
    return {
        with("urgengo", "config.json"),
        {"as planned", as_planned, planned, 2},
        with("by stream attribute, stream writes", "attribute.json", 4, by_stream_attribute),
        with("by stream pool, events, waits sleep", "pool.json", 4, by_stream_pool),
        with("gates opened by the host", "host.json", 2, dispatched_by(config::Dispatch::kHost)),
        with("gates opened by marks", "marks.json", 4,
             dispatched_by(config::DeviceDispatch::kPiggyback)),
        with("gates opened by a resident kernel", "leased.json", 4,
             dispatched_by(config::DeviceDispatch::kLeased)),
        with("gates opened by arms", "armed.json", 4,
             dispatched_by(config::DeviceDispatch::kArmed)),
        with("async", "async.json", 20, tracked_by(config::Tracking::kAsync)),
        with("sync", "sync.json", 20, tracked_by(config::Tracking::kSync)),
        with("batched", "batched.json", 20, tracked_by(config::Tracking::kBatched)),
        with("overlapped", "overlapped.json", 20, tracked_by(config::Tracking::kOverlapped)),
        with("urgengo, holds at random", "held.json")};
}

bool ends_right(const std::string& line) {
    return line.size() > kRight.size() &&
           line.compare(line.size() - kRight.size(), kRight.size(), kRight) == 0;
}

/// What a program promises has to hold with the driver alone, or nothing can be said of UrgenGo.
void require_right(const Outcome& alone, std::uint64_t first, std::uint64_t num) {
    const auto lines = lines_of(alone.out);
    for (const std::string& line : lines)
        if (!ends_right(line))
            FAIL(
                "the test's own fault, not UrgenGo's: the driver alone does not do what "
                "random_program.h says that it must\n  "
                << line);
    INFO("the driver alone; stderr: " << alone.err);
    INFO((lines.empty() ? "no program ended" : "the last that ended: " + lines.back()));
    REQUIRE(alone.exit_status == 0);
    INFO("seeds " << first << " to " << first + num - 1);
    REQUIRE(lines.size() == num);
}

/// @returns whose fault it is that the seed's line under UrgenGo is not the bare one
std::string whose_fault(const std::string& expected, std::uint64_t seed) {
    for (int i = 0; i < kBareRepeats; ++i) {
        const Outcome again =
            run_twin({"random", std::to_string(seed), "1"}, with_fast_gpu(bare()));
        const auto lines = lines_of(again.out);
        const std::string line = lines.empty() ? "no end" : lines.front();
        if (line != expected)
            return "the test's own fault, not UrgenGo's: the driver alone also gives\n         " +
                   line;
    }
    return "UrgenGo's doing, as far as " + std::to_string(kBareRepeats) +
           " more bare runs tell: they are all as the first";
}

void check_same(const Outcome& alone, const Outcome& found, std::uint64_t first) {
    const auto expected = lines_of(alone.out), lines = lines_of(found.out);
    for (std::size_t i = 0; i < expected.size(); ++i) {
        if (i < lines.size() && lines[i] == expected[i]) continue;
        FAIL_CHECK("seed " << first + i << " (see it: twin random " << first + i
                           << " 1 verbose)\n  bare:  " << expected[i]
                           << "\n  found: " << (i < lines.size() ? lines[i] : "no end") << "\n  "
                           << whose_fault(expected[i], first + i));
        break;
    }
    INFO("stderr: " << found.err);
    CHECK(found.exit_status == alone.exit_status);
    auto errors = lines_of(found.err);
    std::erase_if(errors, [](const std::string& line) {
        return line.starts_with("urgengo: warning: ") ||
               line.starts_with("urgengo: guard: ");  // where the machine is busy
    });
    CHECK(errors.empty());
}

/// A gate opens at its bound even so: a thread that sees to it waits for a core among all of these.
constexpr double kMostPastBound_us = 500'000;

/// UrgenGo was at work.
void check_statistics(SetUp& set_up) {
    const auto stats = nlohmann::json::parse(read_text(set_up.stats), nullptr, false);
    REQUIRE(!stats.is_discarded());
    CHECK(stats.at("tripped") == "");
    int scheduled = 0;
    for (const auto& one : stats.at("chains")) {
        scheduled += one.at("scheduled").get<int>();
        set_up.holds += one.at("holds").get<int>();
        set_up.as_planned += one.at("as_planned").get<int>();
        set_up.synchronisations += one.at("synchronisations").get<int>();
    }
    CHECK(scheduled > 0);
    set_up.gates += stats.at("gates").at("closed").get<int>();
    CHECK(stats.at("gates").at("most_past_us").get<double>() < kMostPastBound_us);
    set_up.rounds_by_gpu += stats.at("gates").at("gpu_rounds").get<int>();
}

}  // namespace

TEST_CASE("Random programs do the same when UrgenGo schedules and holds them",
          "[interposer][random]") {
    const std::uint64_t count = number_from("URGENGO_TEST_PROGRAMS", default_count());
    const std::uint64_t begin = number_from("URGENGO_TEST_FIRST", 1), end = begin + count;
    const Folder folder;
    std::vector<SetUp> all = set_ups(folder.path());
    for (std::uint64_t first = begin; first < end; first += kProgramsPerRun) {
        const std::uint64_t num = std::min(kProgramsPerRun, end - first);
        const std::vector<std::string> arguments = {TWIN_PATH, "random", std::to_string(first),
                                                    std::to_string(num)};
        for (SetUp& set_up : all)
            if (set_up.held_at_random)
                set_up.environment["URGENGO_TEST_HOLDS"] = std::to_string(first);
        Running alone(arguments, with_fast_gpu(bare()), kLongestRun_s);
        std::vector<std::unique_ptr<Running>> running;
        const auto takes_part = [&](const SetUp& set_up) {
            return (first - begin) / kProgramsPerRun % std::uint64_t(set_up.every) == 0;
        };
        for (const SetUp& set_up : all)
            running.push_back(takes_part(set_up) ? std::make_unique<Running>(
                                                       arguments, set_up.environment, kLongestRun_s)
                                                 : nullptr);
        const Outcome expected = alone.wait();
        std::vector<Outcome> found;
        for (const auto& one : running) found.push_back(one ? one->wait() : Outcome{});
        require_right(expected, first, num);
        for (std::size_t i = 0; i < all.size(); ++i) {
            if (!running[i]) continue;
            INFO("set-up '" << all[i].name << "', URGENGO_TEST_HOLDS " << first);
            check_same(expected, found[i], first);
            if (found[i].exit_status == 0) check_statistics(all[i]);
        }
    }
    INFO("of themselves " << all.front().holds << ", at random too " << all.back().holds);
    CHECK(all.front().holds > 0);
    CHECK(all.back().holds > all.front().holds);
    const SetUp& planned = all[1];
    INFO("as planned " << planned.as_planned);
    CHECK(planned.as_planned > 0);
    for (const SetUp& set_up : all) {
        const std::string_view name = set_up.name;
        INFO(name << " waited " << set_up.synchronisations << " times");
        CHECK((set_up.synchronisations > 0) ==
              (name == "sync" || name == "batched" || name == "overlapped"));
        INFO(name << " closed " << set_up.gates << " gates, rounds of the GPU "
                  << set_up.rounds_by_gpu);
        CHECK((set_up.gates > 0) == name.starts_with("gates opened by"));
        // A resident kernel is none any more after the first cooperative launch of the program's.
        if (name != "gates opened by a resident kernel")
            CHECK((set_up.rounds_by_gpu > 0) ==
                  (name == "gates opened by marks" || name == "gates opened by arms"));
    }
}
