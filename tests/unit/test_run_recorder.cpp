// SPDX-License-Identifier: Apache-2.0
#include "host/observe/run_recorder.h"

#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstring>
#include <thread>
#include <vector>

#include "tests/support/run_builder.h"
#include "tools/trace/run_reader.h"

using namespace urgengo;
using abi::RunKeeps;
using abi::RunKind;
using testing::RunBuilder;

namespace {

trace::Run read(const std::string& path) {
    auto run = trace::read_run(path);
    REQUIRE(run);
    return std::move(*run);
}

/// Frames that arrive at one millisecond after the other.
void add_frames(RunBuilder& builder, std::uint32_t count, std::uint32_t first = 1) {
    for (std::uint32_t i = 0; i < count; ++i)
        builder.frame_begins(0, first + i, static_cast<std::int64_t>(first + i));
}

}  // namespace

TEST_CASE("Recorder's file tells whose it is, and is its owner's alone", "[observe][recorder]") {
    const RunBuilder builder;
    struct stat status {};
    REQUIRE(stat(builder.path().c_str(), &status) == 0);
    CHECK((status.st_mode & 07777) == 0600);
    CHECK(status.st_size % 4096 == 0);
    const trace::Run run = read(builder.path());
    CHECK(run.process == static_cast<std::uint32_t>(getpid()));
    CHECK(run.records.empty());
    CHECK(run.warnings.empty());
    REQUIRE(run.chains.size() == 2);
    REQUIRE(run.tasks.size() == 3);
    CHECK(run.chains[1].name == "camera");
    CHECK(run.chains[1].deadline_ns == 80 * RunBuilder::kMs);
    CHECK(run.tasks[1].name == "track");
    CHECK(run.tasks[2].chain == 1);
    CHECK(run.begin_ns > 0);
    CHECK(run.begin_realtime_ns > run.begin_ns);
}

TEST_CASE("Trace keeps its oldest records in one ring after the other, and counts what is lost",
          "[observe][recorder]") {
    RunBuilder builder(RunKeeps::kOldest, 64, 3);
    add_frames(builder, 3 * 64 + 7);
    const trace::Run run = read(builder.path());
    REQUIRE(run.records.size() == 3 * 64);
    for (std::size_t i = 0; i < run.records.size(); ++i) CHECK(run.records[i].number == i + 1);
    CHECK(run.lost == 7);
    REQUIRE(run.warnings.size() == 1);
    CHECK(run.warnings[0].find("7 records found no room") != std::string::npos);
}

TEST_CASE("Flight recorder keeps a thread's newest records", "[observe][recorder]") {
    RunBuilder builder(RunKeeps::kNewest, 64, 3);
    add_frames(builder, 1000);
    const trace::Run run = read(builder.path());
    REQUIRE(run.records.size() == 63);  // one may be half written
    CHECK(run.records.back().number == 1000);
    CHECK(run.records.front().number == 1000 - 62);
    CHECK(run.overwritten == 1000 - 63);
    CHECK(run.warnings.empty());
}

TEST_CASE("Threads write rings of their own, and a ring that one has left is another one's",
          "[observe][recorder]") {
    const auto keeps = GENERATE(RunKeeps::kNewest, RunKeeps::kOldest);
    RunBuilder builder(keeps, 64, 2);
    for (std::uint32_t i = 0; i < 10; ++i) {
        std::thread thread([&] {
            add_frames(builder, 3, 1 + 3 * i);
            builder.recorder.thread_ends();
        });
        thread.join();
    }
    std::thread stays([&] { add_frames(builder, 2, 100); });
    stays.join();
    std::thread other([&] { add_frames(builder, 2, 200); });
    other.join();
    std::thread lost([&] { add_frames(builder, 2, 300); });
    lost.join();
    const trace::Run run = read(builder.path());
    CHECK(run.records.size() == 30 + 2 + 2);
    CHECK(run.records.back().number == 201);
    CHECK(run.lost == 2);
    CHECK(run.records[0].thread != 0);
    CHECK(run.records[0].thread != run.records.back().thread);
}

TEST_CASE("Threads that record at the same time lose nothing", "[observe][recorder]") {
    RunBuilder builder(RunKeeps::kOldest, 64, 64);
    constexpr std::uint32_t kThreads = 8, kRecords = 300;
    std::vector<std::thread> threads;
    for (std::uint32_t i = 0; i < kThreads; ++i)
        threads.emplace_back([&builder, i] {
            add_frames(builder, kRecords / 2, 1 + i * kRecords);
            builder.recorder.thread_ends();
            add_frames(builder, kRecords / 2, 1 + i * kRecords + kRecords / 2);
            builder.recorder.thread_ends();
        });
    for (std::thread& thread : threads) thread.join();
    const trace::Run run = read(builder.path());
    REQUIRE(run.records.size() == kThreads * kRecords);
    for (std::size_t i = 0; i < run.records.size(); ++i) CHECK(run.records[i].number == i + 1);
}

TEST_CASE("Recorder's file is whole when its process is killed", "[observe][recorder]") {
    RunBuilder builder(RunKeeps::kOldest, 64, 8);
    const pid_t child = fork();
    if (child == 0) {
        add_frames(builder, 100);
        raise(SIGKILL);
    }
    int status = 0;
    REQUIRE(waitpid(child, &status, 0) == child);
    REQUIRE(WIFSIGNALED(status));
    const trace::Run run = read(builder.path());
    CHECK(run.records.size() == 100);
    CHECK(run.warnings.empty());
}

TEST_CASE("Recorder loses what is written after its file has become another one's, and no more",
          "[observe][recorder]") {
    RunBuilder builder(RunKeeps::kOldest, 64, 8);
    add_frames(builder, 64);
    REQUIRE(unlink(builder.path().c_str()) == 0);
    std::ofstream(builder.path()) << "another's";
    add_frames(builder, 64);
    CHECK(builder.bytes() == "another's");
    builder.recorder.finish();
}

TEST_CASE("Recorder says why it is not on", "[observe][recorder]") {
    observe::RunRecorder recorder;
    const config::Config config = testing::lidar_and_camera();
    CHECK(recorder.start("/nonexistent/run", RunKeeps::kOldest, 64, 4, "", config) ==
          "/nonexistent/run: No such file or directory");
    CHECK(recorder.start("/nonexistent/run", RunKeeps::kOldest, 64, 4, "no such group", config) ==
          "no group 'no such group'");
    CHECK_FALSE(recorder.is_on());
    recorder.thread_ends();
    recorder.finish();
}

TEST_CASE("Copy of a ring that is written meanwhile has nothing of what was overwritten",
          "[observe][recorder]") {
    RunBuilder builder(RunKeeps::kNewest, 64, 1);
    add_frames(builder, 70);
    std::string copy = builder.bytes();
    add_frames(builder, 20, 71);
    const std::string later = builder.bytes();
    trace::mark_overwritten(copy, [&](std::uint64_t offset) {
        std::uint64_t written = 0;
        std::memcpy(&written, later.data() + offset, sizeof written);
        return written;
    });
    const auto run = trace::parse_run(copy, "copy");
    REQUIRE(run);
    // Up to 98 may be under way by then: the 64 before those are not safe.
    REQUIRE(run->records.size() == 70 - (90 + abi::kRunMargin - 64));
    CHECK(run->records.front().number == 90 + abi::kRunMargin - 64 + 1);
    CHECK(run->records.back().number == 70);
}

TEST_CASE("Recorder leaves half of a small folder to the program, and a GiB of a large one",
          "[observe][recorder]") {
    constexpr std::uint64_t kMiB = 1 << 20;
    CHECK(observe::leaves_enough(64 * kMiB, 40 * kMiB, 8 * kMiB));
    CHECK_FALSE(observe::leaves_enough(64 * kMiB, 40 * kMiB, 9 * kMiB));
    CHECK_FALSE(observe::leaves_enough(64 * kMiB, kMiB, 2 * kMiB));
    CHECK(observe::leaves_enough(100'000 * kMiB, 1025 * kMiB, kMiB));
    CHECK_FALSE(observe::leaves_enough(100'000 * kMiB, 1024 * kMiB, kMiB));
    CHECK_FALSE(observe::leaves_enough("/nowhere", 1));
}

TEST_CASE("Recorder's file tells under what the program runs, and on which GPU",
          "[observe][recorder]") {
    const testing::Folder folder;
    const std::string path = folder.path("run.ugtrace");
    const std::string conditions = R"({"command": "./stack"})";
    observe::RunRecorder recorder;
    REQUIRE(recorder.start(path, RunKeeps::kOldest, 64, 4, "", testing::lidar_and_camera(),
                           conditions) == "");
    CHECK(read(path).conditions == conditions);
    CHECK(read(path).gpu.empty());
    recorder.set_gpu((std::string(100, 'x') + "y").c_str());
    CHECK(read(path).gpu == std::string(sizeof(abi::RunHeader::gpu) - 1, 'x'));
}
