// SPDX-License-Identifier: Apache-2.0
//
// Reading traces: what is refused, what is only warned of, and what whole ones hold.
#include "tools/trace/trace_reader.h"

#include <unistd.h>

#include <cstdio>
#include <fstream>

#include "tests/support/catch.h"
#include "tests/support/trace_builder.h"
#include "tools/trace/gpu_intervals.h"

namespace urgengo::trace {
namespace {

using testing::TraceBuilder;
using testing::TracedThread;

constexpr char kLongName[] =
    "_ZN2at6native29vectorized_elementwise_kernelILi4ENS0_11FillFunctorIfE";

std::string error_of(const std::string& bytes) {
    const auto trace = parse_trace(bytes, "a.trace");
    return trace ? "" : trace.error();
}

TraceBuilder two_threads() {
    TraceBuilder builder;
    TracedThread a(builder, 11, "camera"), b(builder, 12, "lidar", 1'500'000);
    for (int i = 0; i < 700; ++i) {  // more than one chunk
        a.launch({kLongName, 7, 64});
        a.wait();
    }
    a.rename("renamed");
    a.launch({kLongName, 7, 64});
    b.launch({"other", 3, 128});
    return builder;
}

TEST_CASE("Trace gives threads, events in order, names and texts", "[unit][trace]") {
    TraceBuilder builder = two_threads();
    const auto trace = parse_trace(builder.bytes(), "a.trace");
    REQUIRE(trace);
    CHECK(trace->warnings().empty());
    CHECK(trace->gpu() == "Test GPU");
    CHECK(trace->driver() == "13.0");
    REQUIRE(trace->threads().size() == 2);
    const ThreadTrace& a = trace->threads()[0];
    CHECK(a.id == 11);
    REQUIRE(a.events.size() == 1401);
    for (std::size_t i = 1; i < a.events.size(); ++i) {
        REQUIRE(a.events[i - 1]->time_ns <= a.events[i]->time_ns);
    }
    CHECK(a.name_at(0) == "camera");
    CHECK(a.name_at(a.events[1399]->time_ns) == "camera");
    CHECK(a.name_at(a.events[1400]->time_ns) == "renamed");
    CHECK(launch_name(*trace, *a.events[0]) == kLongName);
    CHECK(launch_name(*trace, *trace->threads()[1].events[0]) == "other");
}

TEST_CASE("Trace calls a launch without a text by its hash, and a graph a graph", "[unit][trace]") {
    TraceBuilder builder;
    builder.add(1, TraceKind::kLaunch, 5).launch.name_hash = 0xabc;
    builder.add(1, TraceKind::kLaunch, 6).flags = abi::kTraceGraph;
    const auto trace = parse_trace(builder.bytes(), "a.trace");
    REQUIRE(trace);
    CHECK(launch_name(*trace, *trace->threads()[0].events[0]) == "(kernel 0000000000000abc)");
    CHECK(launch_name(*trace, *trace->threads()[0].events[1]) == "(graph)");
    CHECK(trace->threads()[0].name_at(5).empty());
}

TEST_CASE("Thread has the name that was read during a launch from that launch on",
          "[unit][trace]") {
    TraceBuilder builder;
    const auto name = [&](std::int64_t time, const char* text) {
        std::strcpy(builder.add(1, TraceKind::kThread, time).name, text);
    };
    name(11, "a");
    builder.add(1, TraceKind::kLaunch, 10);
    name(21, "b");
    builder.add(1, TraceKind::kLaunch, 20);  // its call came in before the name was read
    const auto trace = parse_trace(builder.bytes(), "a.trace");
    REQUIRE(trace);
    CHECK(trace->threads()[0].name_at(10) == "a");
    CHECK(trace->threads()[0].name_at(19) == "a");
    CHECK(trace->threads()[0].name_at(20) == "b");
}

TEST_CASE("Trace sorts a thread's events that are out of order", "[unit][trace]") {
    TraceBuilder builder;
    for (const int time : {30, 10, 20}) builder.add(1, TraceKind::kArrival, time);
    const auto trace = parse_trace(builder.bytes(), "a.trace");
    REQUIRE(trace);
    const auto& events = trace->threads()[0].events;
    CHECK((events[0]->time_ns == 10 && events[1]->time_ns == 20 && events[2]->time_ns == 30));
}

TEST_CASE("Files that are not a trace of this version are refused", "[unit][trace]") {
    TraceBuilder builder;
    CHECK(error_of("short").find("a.trace: found 5 bytes, accepted: a trace") == 0);
    builder.header.magic = 1;
    CHECK(error_of(builder.bytes()).find("found magic 0000000000000001, accepted") !=
          std::string::npos);
    builder.header.magic = abi::kTraceMagic;
    builder.header.version = 9;
    CHECK(error_of(builder.bytes()).find("found trace version 9, accepted: 1") !=
          std::string::npos);
    builder.header.version = abi::kTraceVersion;
    builder.header.record_bytes = 32;
    CHECK(error_of(builder.bytes()).find("found records of 32 bytes, accepted: 64") !=
          std::string::npos);
    builder.header.record_bytes = 64;
    builder.header.chunk_records = 3;
    CHECK(error_of(builder.bytes()).find("found chunks of 3 records") != std::string::npos);
    const auto missing = read_trace("/nonexistent/a.trace");
    REQUIRE_FALSE(missing);
    CHECK(missing.error() == "/nonexistent/a.trace: cannot be read: No such file or directory");
    CHECK_FALSE(read_trace("/tmp"));
}

TEST_CASE("Traces that are not whole are read as far as they go", "[unit][trace]") {
    TraceBuilder builder = two_threads();
    std::string bytes = builder.bytes();
    SECTION("cut short in the middle of a chunk") {
        bytes.resize(bytes.size() - 100);
        const auto trace = parse_trace(bytes, "a.trace");
        REQUIRE(trace);
        REQUIRE(trace->warnings().size() == 1);
        CHECK(trace->warnings()[0].find("a.trace: found 3 chunks of events, accepted: 4") == 0);
        CHECK(trace->threads()[0].events.size() > 1000);
    }
    SECTION("more chunks than fit") {
        reinterpret_cast<abi::TraceHeader*>(bytes.data())->max_chunks = 2;
        const auto trace = parse_trace(bytes, "a.trace");
        REQUIRE(trace);
        REQUIRE(trace->warnings().size() == 1);
        CHECK(trace->warnings()[0].find("2 of 4 chunks of events did not fit") !=
              std::string::npos);
    }
    SECTION("an empty file of a program that launched nothing") {
        const auto trace = parse_trace(TraceBuilder().bytes(), "a.trace");
        REQUIRE(trace);
        CHECK(trace->threads().empty());
        CHECK(trace->warnings().empty());
    }
    SECTION("events of a kind from the future, and half a name") {
        builder.add(11, static_cast<TraceKind>(99), 5);
        abi::TraceText& text = builder.add(11, TraceKind::kText, 5).text;
        text.hash = 5, text.length = 100, text.offset = 28;
        const auto trace = parse_trace(builder.bytes(), "a.trace");
        REQUIRE(trace);
        REQUIRE(trace->warnings().size() == 2);
        CHECK(trace->warnings()[0] == "a.trace: 1 names are incomplete");
        CHECK(trace->warnings()[1] == "a.trace: 1 events of a kind that is not known");
    }
}

TEST_CASE("Trace file with room for more events than it has is read", "[unit][trace]") {
    TraceBuilder builder = two_threads();
    const std::string path = "/tmp/urgengo_trace_" + std::to_string(getpid());
    const std::string bytes = builder.bytes();
    std::ofstream(path, std::ios::binary) << bytes << std::string(1 << 20, '\0');
    const auto trace = read_trace(path);
    std::remove(path.c_str());
    REQUIRE(trace);
    CHECK(trace->warnings().empty());
    CHECK(trace->threads().size() == 2);
}

TEST_CASE("GPU intervals begin where the one before ended, without the mark", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "t");
    thread.launch({"a", 1, 32, 40'000});
    thread.launch({"b", 1, 32, 70'000});
    thread.wait();
    thread.sleep(1'000'000);
    thread.launch({"a", 1, 32, 41'000});
    const auto trace = parse_trace(builder.bytes(), "a.trace");
    REQUIRE(trace);
    const auto intervals = gpu_intervals(*trace);
    REQUIRE(intervals.size() == 1);
    REQUIRE(intervals[0].size() == 3);
    CHECK(intervals[0][0].length_ns() == 40'000);
    CHECK(intervals[0][1].length_ns() == 70'000);
    CHECK(intervals[0][2].length_ns() == 41'000);
    CHECK(intervals[0][1].begin_ns == intervals[0][0].end_ns + 1500);  // a pause before the mark
}

TEST_CASE("GPU intervals have no pause, but no less than the shortest kernel because of it",
          "[unit][trace]") {
    TraceBuilder builder;
    builder.header.mark_ns = 1000;
    builder.header.pause_ns = 1400;
    const std::int64_t steps_ns[] = {12'400, 2'700, 1'200};
    std::uint64_t end_ns = 0;
    builder.add(1, TraceKind::kLaunch, 1).launch.gpu_end_ns = end_ns += 1;
    for (const std::int64_t step_ns : steps_ns)
        builder.add(1, TraceKind::kLaunch, 1).launch.gpu_end_ns = end_ns +=
            static_cast<std::uint64_t>(step_ns);
    const auto trace = parse_trace(builder.bytes(), "a.trace");
    REQUIRE(trace);
    const auto intervals = gpu_intervals(*trace);
    REQUIRE(intervals[0].size() == 4);
    CHECK(intervals[0][1].length_ns() == 10'000);
    CHECK(intervals[0][1].begin_ns == 1000);
    CHECK(intervals[0][2].length_ns() == 500);
    CHECK(intervals[0][3].length_ns() == 200);  // it was less before
}

TEST_CASE("GPU intervals survive the wrap of 48 bits", "[unit][trace]") {
    TraceBuilder builder;
    builder.header.mark_ns = 0;
    const std::uint64_t wrap = std::uint64_t{1} << 48;
    abi::TraceRecord& first = builder.add(1, TraceKind::kLaunch, 1);
    first.launch.gpu_begin_ns = wrap - 300;
    first.launch.gpu_end_ns = wrap - 100;
    builder.add(1, TraceKind::kLaunch, 2).launch.gpu_end_ns = 250;
    const auto trace = parse_trace(builder.bytes(), "a.trace");
    REQUIRE(trace);
    const auto intervals = gpu_intervals(*trace);
    CHECK(intervals[0][0].length_ns() == 200);
    CHECK(intervals[0][1].length_ns() == 350);
}

TEST_CASE("GPU intervals chain a stream across threads, and share what no mark divides",
          "[unit][trace]") {
    TraceBuilder builder;
    builder.header.mark_ns = 0;
    const auto launch = [&](std::uint32_t thread, std::int64_t time, std::uint64_t end,
                            std::uint64_t begin = 0) {
        abi::TraceRecord& record = builder.add(thread, TraceKind::kLaunch, time);
        record.launch.stream = 5;
        record.launch.gpu_end_ns = end;
        record.launch.gpu_begin_ns = begin;
    };
    launch(1, 1, 1100, 1000);
    launch(2, 2, 1300);
    launch(1, 3, 0);  // no mark: shares with the next
    launch(1, 4, 1500);
    launch(1, 5, 0);  // its end is never known: the next one's begin was marked
    launch(1, 6, 3000, 2900);
    const auto trace = parse_trace(builder.bytes(), "a.trace");
    REQUIRE(trace);
    const auto intervals = gpu_intervals(*trace);
    REQUIRE(intervals[0].size() == 5);
    CHECK(intervals[1][0].length_ns() == 200);
    CHECK(intervals[0][1].length_ns() == 100);
    CHECK(intervals[0][2].length_ns() == 100);
    CHECK(intervals[0][2].shared == 2);
    CHECK_FALSE(intervals[0][3].known);
    CHECK(intervals[0][4].length_ns() == 100);
    CHECK(intervals[0][4].shared == 1);
}

}  // namespace
}  // namespace urgengo::trace
