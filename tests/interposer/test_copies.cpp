// SPDX-License-Identifier: Apache-2.0
//
// Copies in slices, from end to end: the program does the same as bare (as in test_twins.cpp, with
// more ways to cut and hold), and an urgent copy comes between the slices of a large one.
#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/interposer/kernels.h"
#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using nlohmann::json;

namespace {

auto with_copies(bool hold, std::int64_t slice_bytes) {
    return [=](config::Config& config) {
        config.scheduler.copies.hold = hold;
        config.scheduler.copies.slice_bytes = slice_bytes;
    };
}

struct CopiesRun {
    Outcome outcome;
    std::uint64_t num_cut = 0;
    std::vector<json> chains;
};

CopiesRun run_with(const char* scenario, std::vector<config::Chain> chains, bool hold,
                   std::int64_t slice_bytes, const Environment& more = {}) {
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    const auto path = write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                                   std::move(chains), nullptr, with_copies(hold, slice_bytes));
    Environment environment = configured(preloaded(), path, stats);
    environment.insert(more.begin(), more.end());
    CopiesRun run;
    run.outcome = run_twin({scenario}, environment);
    CHECK(run.outcome.exit_status == 0);
    const json root = json::parse(read_text(stats), nullptr, false);
    REQUIRE(!root.is_discarded());
    CHECK(root.at("tripped") == "");
    for (const json& chain : root.at("chains")) {
        run.chains.push_back(chain);
        run.num_cut += chain.at("copies_cut").get<std::uint64_t>();
    }
    return run;
}

}  // namespace

TEST_CASE("Large copies do the same when they are cut", "[interposer][copies]") {
    // Of the captured one only what goes beside the capture is cut.
    const auto [scenario, cuts] =
        GENERATE(table<const char*, bool>({{"large_copies", true},
                                           {"large_copies_captured", true},
                                           {"large_copies_refused", false}}));
    const Outcome alone = run_twin({scenario}, bare());
    if (alone.exit_status == twin::kNotForThisGpu) return;
    REQUIRE(alone.exit_status == 0);
    REQUIRE(!alone.out.empty());
    const std::vector<config::Chain> chains{chain("main", 400ms, {{"main", "twin"}}),
                                            chain("other", 100ms, {{"work", "nobody"}})};
    for (const bool hold : {false, true})
        for (const std::int64_t slice : {0, 65'536, 100'001, 1 << 20}) {
            INFO(scenario << ", hold " << hold << ", slices of " << slice);
            const CopiesRun run = run_with(scenario, chains, hold, slice);
            CHECK(run.outcome.out == alone.out);
            CHECK(run.outcome.exit_status == 0);
            CHECK((run.num_cut > 0) == (cuts && slice > 0));
        }
}

TEST_CASE("Copies of no chain are not cut", "[interposer][copies]") {
    CHECK(run_with("large_copies", {chain("other", 100ms, {{"work", "nobody"}})}, true, 65'536)
              .num_cut == 0);
}

TEST_CASE("Urgent copy waits for two slices of a large one, not for all of it",
          "[interposer][copies]") {
    if (on_real_gpu()) return;  // `urgengo bench copies` is for that
    // 64 MiB take 134 ms at 0.5 GB/s, a slice 2.1 ms.
    const Environment slow{{"SIMGPU_COPY_GBPS", "0.5"}};
    const std::vector<config::Chain> chains{chain("tight", 50ms, {{"work", ""}}),
                                            chain("loose", 10s, {{"work", ""}})};
    const auto times = [](const CopiesRun& run) {
        std::istringstream line(run.outcome.out);
        std::pair<int, int> both_us;
        line >> both_us.first >> both_us.second;
        return both_us;
    };
    const auto [whole_us, bulk_us] = times(run_with("copies_beside", chains, false, 0, slow));
    CHECK(whole_us > 60'000);
    CHECK(bulk_us > 130'000);
    const CopiesRun run = run_with("copies_beside", chains, true, 1 << 20, slow);
    const auto [wait_us, cut_bulk_us] = times(run);
    CHECK(wait_us < 20'000);
    CHECK(cut_bulk_us < bulk_us * 3 / 2);
    CHECK(run.chains[1].at("copies_cut") == 5);
    CHECK(run.chains[0].at("holds") == 0);
}
