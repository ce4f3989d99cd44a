// SPDX-License-Identifier: Apache-2.0
//
// The workload program's handling of files, and the names in them.
#include <filesystem>

#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tools/chains/files.h"
#include "tools/chains/scenario.h"
#include "tools/chains/spec.h"

using namespace urgengo::chains;
using urgengo::testing::Folder;

TEST_CASE("thread_name fits a thread for every task of the paper", "[unit][chains]") {
    for (const ChainSpec& spec : paper_chains()) {
        for (const TaskSpec& task_spec : spec.tasks) {
            Chain chain;
            chain.name = spec.name;
            Task task;
            task.name = task_spec.name;
            CHECK(thread_name(Threads::kPerTask, chain, task).size() <= 15);
            CHECK(thread_name(Threads::kPerChain, chain, task) == spec.name);
        }
    }
}

TEST_CASE("check_scenario names the chains when a tight one is unknown", "[unit][chains]") {
    Workload workload;
    workload.chains = {{"C0", 150, 120, {}}, {"C1", 500, 120, {}}};
    CHECK_NOTHROW(check_scenario(Scenario{1, 1, {"C1"}}, workload));
    CHECK_THROWS_WITH(check_scenario(Scenario{1, 1, {"C7"}}, workload),
                      "--tight: found \"C7\", accepted: C0, C1");
}

TEST_CASE("write_file replaces the file and leaves nothing beside it", "[unit][chains]") {
    const Folder folder;
    const std::string path = folder.path("report.json");
    write_file(path, "first, and longer");
    write_file(path, "second");
    CHECK(read_file(path) == "second");
    CHECK(std::distance(std::filesystem::directory_iterator(folder.path()), {}) == 1);
}

TEST_CASE("write_file keeps the old file when it cannot write", "[unit][chains]") {
    const Folder folder;
    const std::string path = folder.path("taken");
    std::filesystem::create_directories(folder.path("taken/inside"));
    CHECK_THROWS_WITH(write_file(path, "new"),
                      path + ": cannot rename a temporary file to it: Is a directory");
    CHECK(std::filesystem::is_directory(path));
    CHECK(std::distance(std::filesystem::directory_iterator(folder.path()), {}) == 1);
}

TEST_CASE("read_file names the file when it is missing", "[unit][chains]") {
    CHECK_THROWS_WITH(read_file("/nonexistent/w.json"),
                      "cannot read /nonexistent/w.json: No such file or directory");
}

TEST_CASE("parse_kernel_driver_version finds the version of either kernel module",
          "[unit][chains]") {
    CHECK(parse_kernel_driver_version(
              "NVRM version: NVIDIA UNIX x86_64 Kernel Module  535.183.01  Sun May 12 2024\n"
              "GCC version:  gcc version 12.2.0 (Debian 12.2.0-14)\n") == "535.183.01");
    CHECK(parse_kernel_driver_version("NVRM version: NVIDIA UNIX Open Kernel Module for x86_64  "
                                      "580.159.04  Release Build  (builder@host)\n") ==
          "580.159.04");
    CHECK(parse_kernel_driver_version("something else 1.2.3 here\n").empty());
}
