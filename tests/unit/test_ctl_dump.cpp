// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/ctl_dump.h"

#include "tests/support/catch.h"

using urgengo::cli::dump_name;

TEST_CASE("Dumps get numbers where there are several", "[cli][dump]") {
    CHECK(dump_name("run.ugtrace", 1, 1) == "run.ugtrace");
    CHECK(dump_name("run.ugtrace", 3, 5) == "run-3.ugtrace");
    CHECK(dump_name("/a.b/run", 3, 5) == "/a.b/run-3");
    CHECK(dump_name("miss-%n.ugtrace", 3, 5) == "miss-3.ugtrace");
    CHECK(dump_name("miss-%n.ugtrace", 1, 1) == "miss-1.ugtrace");
}
