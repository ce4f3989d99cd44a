// SPDX-License-Identifier: Apache-2.0
//
// Calls that change which context is current: launches need no asking up to them, and again from
// the second one after them on.
#include <nlohmann/json.hpp>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo::testing;
using namespace std::chrono_literals;

namespace {

/// @returns launches of the scenario that needed no asking
int as_planned(const char* call, const char* version) {
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", urgengo::config::Mode::kEnforce,
                     {chain("one", 60s, {{"work", "caller"}})});
    const Outcome outcome =
        run_twin({"context_call", call, version}, configured(preloaded(), config, stats));
    INFO(call << " " << version << ": " << outcome.err);
    REQUIRE(outcome.exit_status == 0);
    const auto root = nlohmann::json::parse(read_text(stats), nullptr, false);
    REQUIRE(!root.is_discarded());
    const auto& counted = root.at("chains").at(0);
    CHECK(counted.at("launches") == 8);
    return counted.at("as_planned").get<int>();
}

}  // namespace

TEST_CASE("A launch behind a call that changes the context is asked about",
          "[interposer][context]") {
    const int undisturbed = as_planned("cuCtxGetCurrent", "4000");
    REQUIRE(undisturbed > 2);
    CHECK(as_planned("cuCtxSetCurrent", "4000") == undisturbed - 1);
    CHECK(as_planned("cuCtxPushCurrent", "2000") == undisturbed - 1);
    CHECK(as_planned("cuCtxPushCurrent", "4000") == undisturbed - 1);
    CHECK(as_planned("cuCtxPopCurrent", "2000") == undisturbed - 1);
    CHECK(as_planned("cuCtxPopCurrent", "4000") == undisturbed - 1);
}
