// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/ctl_dump.h"

#include <unistd.h>

#include <cstdlib>

#include "host/observe/run_recorder.h"
#include "host/observe/status_page.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tools/trace/run_reader.h"
#include "tools/urgengo/page/find_pages.h"

using namespace urgengo;
using urgengo::cli::dump_name;

TEST_CASE("Dumps get numbers where there are several", "[cli][dump]") {
    CHECK(dump_name("run.ugtrace", 1, 1) == "run.ugtrace");
    CHECK(dump_name("run.ugtrace", 3, 5) == "run-3.ugtrace");
    CHECK(dump_name("/a.b/run", 3, 5) == "/a.b/run-3");
    CHECK(dump_name("miss-%n.ugtrace", 3, 5) == "miss-3.ugtrace");
    CHECK(dump_name("miss-%n.ugtrace", 1, 1) == "miss-1.ugtrace");
}

TEST_CASE("Records that are kept of a program are dumped once", "[cli][dump]") {
    const testing::MemoryFolder folder;
    config::Config config;
    config.chains.emplace_back();
    config.chains[0].name = "lidar";
    config.chains[0].tasks = {{"detect", ""}};
    {
        observe::StatusPage page({folder.path().string(), ""}, config, std::chrono::seconds(1));
        observe::RunRecorder recorder;
        REQUIRE(recorder.start(page.stem() + observe::kRecordsSuffix, abi::RunKeeps::kNewest, 64, 1,
                               "", config) == "");
        abi::RunRecord record{};
        record.kind = abi::RunKind::kTrip;
        record.chain = record.task = -1;
        recorder.add(record);
        page.tripped();
    }
    setenv("URGENGO_SHARE", folder.path().c_str(), 1);
    cli::CtlOptions options{.what = "dump"};
    options.quiet = true;
    options.pid = static_cast<std::uint32_t>(getpid());
    options.out = folder.path("run.ugtrace");
    CHECK(cli::find_pages(folder.path().string()).empty());
    CHECK(cli::ctl_dump(options) == 0);
    const auto run = trace::read_run(options.out);
    REQUIRE(run);
    CHECK(run->records.size() == 1);
    CHECK(observe::list_pages(folder.path().string()).empty());
    CHECK(cli::ctl_dump(options) != 0);
    unsetenv("URGENGO_SHARE");
}
