// SPDX-License-Identifier: Apache-2.0
//
// A run through NVTXW, into a backend of ours that checks the protocol
// (tests/support/nvtxw_recorder.cpp).
#include "tools/trace/run_nsys.h"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <vector>

#include "host/observe/miss_cause.h"
#include "tests/support/run_builder.h"
#include "tools/trace/nvtxw_backend.h"
#include "tools/urgengo/cmd_trace.h"

using namespace urgengo;
using nlohmann::json;
using testing::RunBuilder;

namespace {

constexpr std::int64_t kMs = RunBuilder::kMs;

class Variable {
  public:
    Variable(const char* name, const std::string& value) : name_(name) {
        setenv(name, value.c_str(), 1);
    }
    ~Variable() { unsetenv(name_); }
    Variable(const Variable&) = delete;
    Variable& operator=(const Variable&) = delete;

  private:
    const char* name_;
};

struct Fixture {
    RunBuilder builder;
    testing::Folder folder;

    Fixture() {
        builder.add_a_late_frame();
        auto mode = RunBuilder::record(abi::RunKind::kMode, -1, -1, 0, 1100);
        mode.mode = abi::StatusMode::kObserve;
        builder.recorder.add(mode);
        auto priority = RunBuilder::record(abi::RunKind::kPriority, 0, 0, 1000, 1004);
        priority.priority = {-3, 0};
        builder.recorder.add(priority);
        builder.add(abi::RunKind::kFrameDropped, 1, -1, 0, 1101);
        builder.add(abi::RunKind::kTrip, -1, -1, 0, 1102);
    }
    int exported(const std::string& out) const {
        cli::TraceOptions options;
        options.what = "export";
        options.file = builder.path();
        options.nsys = true;
        options.out = out;
        return cli::cmd_trace(options);
    }
    json told() const {
        const Variable library("NVTXW3_LIBRARY", NVTXW_RECORDER_PATH);
        REQUIRE(exported(folder.path("session")) == 0);
        std::ifstream file(folder.path("session"));
        return json::parse(file);
    }
};

/// @returns the one event of that schema in the stream
json event_of(const json& stream, const std::string& schema, std::size_t index = 0) {
    std::vector<json> found;
    for (const json& event : stream.at("events"))
        if (event.at("schema") == "urgengo.written." + schema) found.push_back(event);
    REQUIRE(found.size() > index);
    return found[index];
}

}  // namespace

TEST_CASE("Run is written through NVTXW as its backend expects it", "[trace][run][nsys]") {
    const json told = Fixture().told();
    CHECK(told.at("wrong") == json::array());
    CHECK(told.at("domain") == "urgengo");
    CHECK(told.at("categories") == json{"launch", "hold", "chain", "dispatch"});
    REQUIRE(told.at("streams").size() == 3);
    const json& lidar = told.at("streams")[0];
    const json& camera = told.at("streams")[1];
    const json& own = told.at("streams")[2];
    CHECK(lidar.at("name") == "1 lidar");
    CHECK(own.at("name") == "urgengo");

    const json frame = event_of(lidar, "frame");
    CHECK(frame.at("message") == "lidar");
    CHECK(frame.at("begin_ns") == 1000 * kMs);
    CHECK(frame.at("end_ns") == 1095 * kMs);
    CHECK(frame.at("frame") == 17);
    CHECK(frame.at("deadline_ns") == 1080 * kMs);
    CHECK(frame.at("outcome") == "late");
    CHECK(frame.at("reason") == "held");
    CHECK(frame.at("behind") == "camera");
    const json hold = event_of(lidar, "hold");
    CHECK(hold.at("message") == "hold");
    CHECK(hold.at("behind") == "camera");
    CHECK(hold.at("why") == "rank");
    CHECK(hold.at("begin_ns") == 1006 * kMs);
    CHECK(hold.at("end_ns") == 1056 * kMs);
    const json miss = event_of(lidar, "miss");
    CHECK(miss.at("message") == "miss");
    CHECK(miss.at("at_ns") == 1095 * kMs);
    const json launches = event_of(lidar, "launches", 1);
    CHECK(launches.at("begin_ns") == 1069 * kMs);
    CHECK(launches.at("first_launch") == 3);
    CHECK(launches.at("end_launch") == 5);
    CHECK(launches.at("stream") == 2);
    CHECK(event_of(lidar, "task").at("task") == "detect");
    CHECK(event_of(camera, "miss").at("message") == "dropped");
    CHECK(event_of(own, "mode").at("mode") == "observe");
    CHECK(event_of(own, "mode", 1).at("message") == "trip");

    std::map<std::string, json> samples;
    for (const json& sample : lidar.at("samples"))
        samples[sample[0].get<std::string>()] = {sample[1], sample[2]};
    CHECK(samples.size() == 4);
    CHECK(samples["lidar executing"] == json{1069 * kMs, 3});
    CHECK(samples["lidar laxity"] == json{1070 * kMs, -5 * kMs});
    CHECK(samples["lidar priority"] == json{1004 * kMs, -3});
    CHECK(samples["lidar held"] == json{1056 * kMs, 50 * kMs});
    REQUIRE(told.at("syncs").size() == 1);  // CLOCK_MONOTONIC and CLOCK_REALTIME
    CHECK(told.at("syncs")[0][0] == 14);
    CHECK(told.at("syncs")[0][1] == 12);
}

TEST_CASE("Page on NVTX lists all that is written through NVTXW, and nothing else",
          "[trace][run][nsys]") {
    std::ifstream file(SOURCE_FOLDER "/docs/nvtx.md");
    const std::string page{std::istreambuf_iterator<char>(file), {}};
    const std::string table = page.substr(page.find("### Written schemas"));
    std::map<std::string, std::vector<std::string>> documented;
    std::istringstream lines(table);
    for (std::string line; std::getline(lines, line);) {
        if (!line.starts_with("| `")) continue;
        std::vector<std::string> words;
        for (std::size_t at = 0; (at = line.find('`', at)) != std::string::npos;) {
            const std::size_t end = line.find('`', at + 1);
            words.push_back(line.substr(at + 1, end - at - 1));
            at = end + 1;
        }
        documented[words[0]] = {words.begin() + 1, words.end()};
    }
    const json told = Fixture().told();
    CHECK(told.at("schemas") == json(documented));
    // Each of them has its row among ranges and marks, and is written here.
    std::set<std::string> written;
    for (const json& stream : told.at("streams"))
        for (const json& event : stream.at("events"))
            written.insert(event.at("schema").get<std::string>());
    const std::string above = page.substr(0, page.find("### Written schemas"));
    for (const auto& [schema, entries] : documented) {
        CHECK(written.count(schema) == 1);
        CHECK(above.find("| `" + schema + '`') != std::string::npos);
    }
    // Texts are the documented words, causes of misses, and names of the run.
    std::set<std::string> texts(observe::nvtx::kWords.begin(), observe::nvtx::kWords.end());
    for (const std::string name : {"lidar", "camera", "detect", "track"}) texts.insert(name);
    for (std::size_t i = 0; i < observe::kNumCauses; ++i)
        texts.insert(observe::to_word(static_cast<abi::MissCause>(i)));
    for (const json& text : told.at("strings")) CHECK(texts.count(text.get<std::string>()) == 1);
    std::set<std::string> counters;
    for (const char* chain : {"lidar ", "camera "})
        for (const observe::nvtx::CounterInfo& counter : observe::nvtx::kCounters)
            counters.insert(std::string(chain) + counter.name);
    for (const auto& [counter, description] : told.at("counters").items())
        CHECK(counters.erase(counter) == 1);
    CHECK(counters.empty());
}

TEST_CASE("Without a backend of NVTXW it is said what was looked for, and where",
          "[trace][run][nsys]") {
    const Fixture f;
    const auto none = trace::load_nvtxw_backend();
    REQUIRE_FALSE(none);
    for (const char* part : {"NVTXW3_LIBRARY", "NVTXW_BACKEND", "libnvtxw3.so", "/bin"})
        CHECK(none.error().find(part) != std::string::npos);
    CHECK(f.exported(f.folder.path("session")) == 1);
    {
        const Variable library("NVTXW_BACKEND", "/nonexistent/libnvtxw3.so");
        CHECK(trace::load_nvtxw_backend().error().find(
                  "NVTXW_BACKEND: found /nonexistent/libnvtxw3.so") == 0);
    }
    {
        const Variable library("NVTXW3_LIBRARY", "libc.so.6");
        const auto found = trace::load_nvtxw_backend();
        REQUIRE_FALSE(found);
        CHECK(found.error() ==
              "libc.so.6: found no backend, accepted: a backend of NVTXW, version 2 "
              "(nvtxwGetInterface)");
        CHECK(f.exported(f.folder.path("session")) == 1);
    }
    CHECK_FALSE(std::filesystem::exists(f.folder.path("session")));
}

TEST_CASE("What a backend of NVTXW refuses is a failure, and no session ends",
          "[trace][run][nsys]") {
    const Fixture f;
    const Variable library("NVTXW3_LIBRARY", NVTXW_RECORDER_PATH);
    const std::string what =
        GENERATE("version", "streams", "SessionBegin", "StringRegister", "EventWrite");
    const Variable refusal("NVTXW_RECORDER_REFUSES", what);
    const auto backend = trace::load_nvtxw_backend();
    CHECK(static_cast<bool>(backend) == (what != "version"));
    if (backend) {
        const auto run = trace::read_run(f.builder.path());
        const auto written = trace::write_nsys(*run, trace::tell(*run), *backend->interface,
                                               f.folder.path("session"));
        REQUIRE_FALSE(written);
        CHECK(written.error().find(what) != std::string::npos);
    }
    CHECK(f.exported(f.folder.path("session")) == 1);
    CHECK_FALSE(std::filesystem::exists(f.folder.path("session")));
}
