// SPDX-License-Identifier: Apache-2.0
//
// What `priority_via: auto` comes to, the cache of answers, and questions asked in a child.
#include "tools/urgengo/doctor/priority_probe.h"

#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tools/urgengo/doctor/driver_question.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using config::PriorityVia;

PriorityMeasurement measured(Honoured launch, Honoured stream) {
    PriorityMeasurement m;
    m.least = 0;
    m.greatest = -5;
    m.busy_us = 15'000.5;
    m.plain = {14'954, 14'900};
    m.launch_attribute = {launch, {744, 14'800}};
    m.stream_attribute = {stream, {745, 14'700}};
    m.stream = {Honoured::kYes, {746, 14'600}};
    return m;
}

TEST_CASE("Priority goes by the first way that is honoured", "[unit][cli]") {
    const auto via = [](Honoured launch, Honoured stream) {
        return choose_priority(measured(launch, stream)).via;
    };
    CHECK(via(Honoured::kYes, Honoured::kYes) == PriorityVia::kLaunchAttribute);
    CHECK(via(Honoured::kYes, Honoured::kNo) == PriorityVia::kLaunchAttribute);
    CHECK(via(Honoured::kNo, Honoured::kYes) == PriorityVia::kStreamAttribute);
    CHECK(via(Honoured::kRefused, Honoured::kYes) == PriorityVia::kStreamAttribute);
    CHECK(via(Honoured::kNo, Honoured::kRefused) == PriorityVia::kStreamPool);
    CHECK(via(Honoured::kRefused, Honoured::kNo) == PriorityVia::kStreamPool);
    const PriorityChoice failed = choose_priority(Error{"no GPU"});
    CHECK(failed.via == PriorityVia::kLaunchAttribute);
    CHECK(failed.reason == "not measured (no GPU)");
    CHECK(choose_priority(measured(Honoured::kRefused, Honoured::kNo)).reason ==
          "on a launch refused by the driver, on a stream ignored (waited 745 us behind 14700 us "
          "of other work)");
}

TEST_CASE("Priority answer is the same when written and read back", "[unit][cli]") {
    const std::string text = priority_json(measured(Honoured::kNo, Honoured::kRefused));
    const auto read = parse_priority_json(text, "p.json");
    REQUIRE(read);
    CHECK(read->launch_attribute.honoured == Honoured::kNo);
    CHECK(read->stream_attribute.honoured == Honoured::kRefused);
    CHECK(read->plain.us == 14'954);
    CHECK(priority_json(*read) == text);

    std::string wrong = text;
    wrong.replace(wrong.find("\"ignored\""), 9, "\"maybe\"");
    CHECK(parse_priority_json(wrong, "p.json").error() ==
          "p.json: $.launch_attribute.found: found '\"maybe\"', accepted: one of honoured, "
          "ignored, refused");
}

TEST_CASE("Priority cache answers for the GPU, driver and version that it was asked for",
          "[unit][cli]") {
    const testing::Folder folder;
    const PriorityCache cache(folder.path("a/urgengo"));
    const PriorityKey key{"NVIDIA H200", "13.0 580.95.05", "1 (abc)"};
    CHECK_FALSE(cache.find(key));
    REQUIRE(cache.store(key, measured(Honoured::kNo, Honoured::kYes)));
    REQUIRE(cache.find(key));
    CHECK(cache.find(key)->launch_attribute.honoured == Honoured::kNo);
    CHECK_FALSE(cache.find({"NVIDIA H100", key.driver, key.urgengo}));
    CHECK_FALSE(cache.find({key.gpu, "13.0 580.95.06", key.urgengo}));
    CHECK_FALSE(cache.find({key.gpu, key.driver, "2 (abc)"}));
    // A file of that name that is of something else, is cut or garbled counts for nothing.
    const PriorityKey other{"NVIDIA H100", key.driver, key.urgengo};
    fs::copy_file(cache.path(key), cache.path(other));
    CHECK_FALSE(cache.find(other));
    std::ofstream(cache.path(key), std::ios::app) << "}";
    CHECK_FALSE(cache.find(key));
    REQUIRE(cache.store(key, measured(Honoured::kYes, Honoured::kYes)));
    CHECK(cache.find(key));

    const PriorityCache none("");
    CHECK_FALSE(none.store(key, measured(Honoured::kYes, Honoured::kYes)));
    CHECK_FALSE(none.find(key));
    const PriorityCache impossible("/dev/null/urgengo");
    CHECK_FALSE(impossible.store(key, measured(Honoured::kYes, Honoured::kYes)));
}

TEST_CASE("Priority cache is whole at any time when several processes write it", "[unit][cli]") {
    const testing::Folder folder;
    const PriorityCache cache(folder.path().string());
    const PriorityKey key{"G", "D", "U"};
    REQUIRE(cache.store(key, measured(Honoured::kYes, Honoured::kYes)));
    pid_t children[2];
    for (pid_t& child : children) {
        child = fork();
        if (child != 0) continue;
        bool all = true;
        for (int i = 0; i < 200; ++i) {
            const Honoured launch = i % 2 ? Honoured::kYes : Honoured::kRefused;
            all = all && cache.store(key, measured(launch, Honoured::kYes));
        }
        _exit(all ? 0 : 1);
    }
    int whole = 0;
    for (int i = 0; i < 400; ++i) whole += cache.find(key) ? 1 : 0;
    CHECK(whole == 400);
    for (const pid_t child : children) {
        int status = -1;
        REQUIRE(waitpid(child, &status, 0) == child);
        CHECK(status == 0);
    }
    CHECK(std::distance(fs::directory_iterator(folder.path()), {}) == 1);  // nothing left over
}

TEST_CASE("Priority key has the driver's release when its file names it", "[unit][cli]") {
    const testing::Folder folder;
    const std::string real = folder.path("libcuda.so.580.95.05");
    const std::string link = folder.path("libcuda.so.1");
    std::ofstream(real) << "x";
    fs::create_symlink(real, link);
    CHECK(priority_key("G", "13.0", link).driver == "13.0 580.95.05");
    fs::remove(link);
    std::ofstream(link) << "x";
    CHECK(priority_key("G", "13.0", link).driver == "13.0");
    CHECK(priority_key("G", "13.0", "").driver == "13.0");
}

TEST_CASE("Question has an answer in time whatever the child does", "[unit][cli]") {
    CHECK(*ask_in_child([] { return std::string("yes"); }, 5s) == "yes");
    CHECK(ask_in_child([] { return std::string(); }, 5s)->empty());
    const std::string much(300'000, 'x');  // more than a pipe holds
    CHECK(*ask_in_child([&] { return much; }, 5s) == much);
    CHECK(ask_in_child([]() -> std::string { abort(); }, 5s).error() == "the driver crashed");
    CHECK(ask_in_child([]() -> std::string { _exit(0); }, 5s).error() == "the driver crashed");
    const auto start = std::chrono::steady_clock::now();
    const auto hangs = [] {
        for (;;) pause();
        return std::string();
    };
    CHECK(ask_in_child(hangs, 50ms).error() == "the driver does not answer");
    CHECK(std::chrono::steady_clock::now() - start < 3s);
    // What the driver starts and leaves behind holds the pipe open.
    const auto leaves_a_child = [] {
        if (fork() == 0) {
            sleep(5);
            _exit(0);
        }
        return std::string("left");
    };
    CHECK(*ask_in_child(leaves_a_child, 3s) == "left");
}

TEST_CASE("Question is asked without tools and blocking launches", "[unit][cli]") {
    setenv("CUDA_INJECTION64_PATH", "/tool.so", 1);
    setenv("CUDA_LAUNCH_BLOCKING", "1", 1);
    const auto answer = ask_in_child(
        [] {
            const bool clean = !getenv("CUDA_INJECTION64_PATH") && !getenv("CUDA_LAUNCH_BLOCKING");
            return std::string(clean ? "clean" : "not clean");
        },
        5s);
    CHECK(*answer == "clean");
    CHECK(getenv("CUDA_LAUNCH_BLOCKING") != nullptr);
    unsetenv("CUDA_INJECTION64_PATH");
    unsetenv("CUDA_LAUNCH_BLOCKING");
}

}  // namespace
}  // namespace urgengo::cli
