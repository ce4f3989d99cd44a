// SPDX-License-Identifier: Apache-2.0
//
// What observing costs in calls of the driver: the names of kernels and the kinds of streams, each
// once; no launch, mark, priority or question besides.
#include <cstdint>
#include <sstream>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;

namespace {

using Calls = std::map<std::string, std::int64_t>;

/// @returns how often the simulated driver was called, by function
Calls calls_of(const std::string& scenario, Environment environment, const Folder& folder) {
    const auto path = folder.path() / "calls.txt";
    environment["SIMGPU_COUNT_CALLS"] = path.string();
    REQUIRE(run_twin({scenario}, environment).exit_status == 0);
    std::istringstream lines(read_text(path));
    Calls calls;
    std::string name;
    for (std::int64_t count = 0; lines >> name >> count;) calls[name] = count;
    REQUIRE_FALSE(calls.empty());
    return calls;
}

/// @returns the calls that `more` has and `less` has not, or the other way round
Calls difference(const Calls& more, const Calls& less) {
    Calls all = more;
    for (const auto& [name, count] : less) all[name] -= count;
    std::erase_if(all, [](const auto& call) { return call.second == 0; });
    return all;
}

}  // namespace

TEST_CASE("Observing calls the driver for names of kernels and kinds of streams alone",
          "[interposer][observe]") {
    if (on_real_gpu()) return;  // nothing counts its calls
    const std::string scenario = GENERATE("streams", "threads", "copies", "hints", "nvtx");
    const Folder folder;
    std::vector<config::Chain> chains{chain("main", 400ms, {{"main", "twin"}}),
                                      chain("hinted", 500ms, {{"front", ""}, {"back", ""}})};
    for (int i = 0; i < 8; ++i) {
        const std::string name = "twin_" + std::to_string(i);
        chains.push_back(chain(name, 100ms, {{"work", name}}));
    }
    const auto under = [&](config::Mode mode) {
        const auto config = write_config(folder.path() / "config.json", "urgengo", mode, chains);
        return calls_of(scenario, configured(preloaded(), config), folder);
    };
    INFO(scenario);
    const Calls alone = calls_of(scenario, bare(), folder);
    std::int64_t added = 0;
    for (const auto& [name, count] : difference(under(config::Mode::kObserve), alone)) {
        INFO(name << " " << count);
        CHECK((name == "cuFuncGetName" || name == "cuStreamGetFlags"));
        CHECK(count > 0);
        added += count;
    }
    // Once a kernel and thread, and once a stream.
    CHECK(added > 0);
    CHECK(added <= 40);
    const Calls enforced = difference(under(config::Mode::kEnforce), alone);
    CHECK(enforced.contains("cuMemHostRegister_v2"));
}
