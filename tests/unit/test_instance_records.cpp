// SPDX-License-Identifier: Apache-2.0
//
// Where instances come from: the workload program's report, and a trace.
#include <cstring>
#include <string>

#include "tests/support/catch.h"
#include "tools/bench/measure/instance_records.h"

using namespace urgengo;
using namespace urgengo::cli;
using namespace std::chrono_literals;

namespace {

abi::TraceRecord event(abi::TraceKind kind, int task, std::uint32_t instance, std::int64_t time_ns,
                       std::uint32_t thread = 10) {
    abi::TraceRecord record{};
    record.kind = kind;
    record.task = static_cast<std::int16_t>(task);
    record.instance = instance;
    record.time_ns = time_ns;
    record.thread = thread;
    return record;
}

constexpr auto kBegin = abi::TraceKind::kInstanceBegin;
constexpr auto kEnd = abi::TraceKind::kInstanceEnd;

/// A trace file's bytes: a chunk for each thread.
std::string trace_bytes(const std::vector<std::vector<abi::TraceRecord>>& threads) {
    abi::TraceHeader header{};
    header.magic = abi::kTraceMagic;
    header.version = abi::kTraceVersion;
    header.record_bytes = sizeof(abi::TraceRecord);
    header.chunk_records = abi::kTraceChunkRecords;
    header.chunks = header.max_chunks = threads.size();
    std::string bytes(reinterpret_cast<const char*>(&header), sizeof header);
    for (const auto& records : threads) {
        std::vector<abi::TraceRecord> chunk(abi::kTraceChunkRecords);
        std::copy(records.begin(), records.end(), chunk.begin());
        bytes.append(reinterpret_cast<const char*>(chunk.data()),
                     chunk.size() * sizeof(abi::TraceRecord));
    }
    return bytes;
}

trace::Trace make_trace(const std::vector<std::vector<abi::TraceRecord>>& threads) {
    auto trace = trace::parse_trace(trace_bytes(threads), "t");
    REQUIRE(trace);
    return std::move(*trace);
}

config::Config two_chains() {
    config::Config config;
    config.chains.resize(2);
    config.chains[0].name = "C0";
    config.chains[1].name = "C1";
    for (config::Chain& chain : config.chains) chain.tasks.resize(1);
    return config;
}

}  // namespace

TEST_CASE("Detected instances are of their chain, with their end and flags", "[unit][cli]") {
    auto begin = event(kBegin, 1, 5, 1000);
    begin.arrival_ns = 900;
    auto observed = event(kBegin, 1, 6, 3000);
    observed.flags = abi::kTraceObserved;
    auto resync = event(kEnd, 1, 6, 4000, 11);  // by another thread
    resync.flags = abi::kTraceResync;
    const auto trace = make_trace({{begin, event(abi::TraceKind::kLaunch, 1, 5, 1000),
                                    event(kEnd, 1, 5, 2000), observed, event(kBegin, 0, 5, 5000)},
                                   {resync}});
    const auto all = detected_instances(trace, two_chains());
    REQUIRE(all);
    const auto& chain = all->at("C1");
    REQUIRE(chain.size() == 2);
    CHECK(chain[0].arrival == 900ns);
    CHECK(chain[0].begin == 1000ns);
    CHECK(chain[0].end == 2000ns);
    CHECK_FALSE(chain[0].observed);
    CHECK_FALSE(chain[0].resync);
    CHECK(chain[1].begin == 3000ns);
    CHECK(chain[1].end == 4000ns);
    CHECK(chain[1].observed);
    CHECK(chain[1].resync);
    REQUIRE(all->at("C0").size() == 1);
    CHECK_FALSE(all->at("C0")[0].end);
}

TEST_CASE("Detected instances are refused when they could not be frames", "[unit][cli]") {
    config::Config config = two_chains();
    CHECK(detected_instances(make_trace({{event(kBegin, 2, 1, 1)}}), config).error() ==
          "trace: found an instance of task 2, accepted: 0 to 1");
    CHECK(detected_instances(make_trace({{event(kBegin, -1, 1, 1)}}), config).error() ==
          "trace: found an instance of task -1, accepted: 0 to 1");
    config.chains[1].tasks.resize(2);
    CHECK(detected_instances(make_trace({}), config).error() ==
          "chain C1: found 2 tasks, accepted: one, so that its instances are frames");
}

TEST_CASE("True frames are those that began", "[unit][cli]") {
    const std::string report = R"({"chains":[{"name":"C0","records":[
{"outcome":"late","arrival_ns":10,"thread":7,"begin_ns":20,"first_launched_ns":21,"end_ns":40},
{"outcome":"dropped","arrival_ns":30}]}]})";
    const auto frames = parse_true_frames(report, "r.json");
    REQUIRE(frames);
    REQUIRE(frames->at("C0").size() == 1);
    const TrueFrame& frame = frames->at("C0")[0];
    CHECK(frame.arrival == 10ns);
    CHECK(frame.begin == 20ns);
    CHECK(frame.first_launched == 21ns);
    CHECK(frame.end == 40ns);
    CHECK(parse_true_frames(R"({"chains":[{"name":"C0"}]})", "r.json").error() ==
          "r.json: $.chains[0].records: missing, and required");
}
