// SPDX-License-Identifier: Apache-2.0
//
// Children that are forked while another thread of their parent is inside UrgenGo. (Others:
// test_twins.cpp.)
#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;

// AddressSanitizer's allocator has locks that a child finds taken.
#if !SANITIZED
TEST_CASE("Child goes on as usual when it is forked while another thread starts UrgenGo",
          "[interposer][fork]") {
    const Folder folder;
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                     {chain("main", std::chrono::seconds(10), {{"main", "twin*"}})});
    // So much to read that many children are forked meanwhile.
    write_text(config, read_text(config) + std::string(32 << 20, ' '));
    const Outcome expected = run_twin({"fork_starting"}, bare());
    REQUIRE(expected.exit_status == 0);
    const auto stats = folder.path() / "stats.json";
    const Outcome found = run_twin({"fork_starting"}, configured(preloaded(), config, stats));
    CHECK(found.exit_status == 0);
    CHECK(found.out == expected.out);
    CHECK(found.err == "");
    // The parent's own.
    CHECK(read_text(stats).find("\"launches\": 2") != std::string::npos);
}
#endif
