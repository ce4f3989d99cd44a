// SPDX-License-Identifier: Apache-2.0
//
// A run as RunRecorder writes it (host/observe/run_recorder.h), record by record: two chains,
// `lidar` (tasks detect, track) and `camera` (detect).
#pragma once

#include <chrono>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <string>

#include "host/observe/run_recorder.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tests/support/lidar_and_camera.h"

namespace urgengo::testing {

inline config::Config lidar_and_camera() {
    using namespace std::chrono_literals;
    config::Config config = lidar_and_camera(80ms, 80ms, {{"detect", ""}});
    config.chains[0].tasks.push_back({"track", ""});
    return config;
}

inline std::string bytes_of(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

class RunBuilder {
  public:
    static constexpr std::int64_t kMs = 1'000'000;

    explicit RunBuilder(abi::RunKeeps keeps = abi::RunKeeps::kOldest, std::uint32_t records = 64,
                        std::uint32_t rings = 4) {
        REQUIRE(recorder.start(path(), keeps, records, rings, "", lidar_and_camera()) == "");
    }

    std::string path() const { return folder_.path("run.ugtrace"); }
    std::string bytes() const { return bytes_of(path()); }

    /// @param arrival  of the frame, ms
    static abi::RunRecord record(abi::RunKind kind, int chain, int task, std::int64_t arrival,
                                 std::int64_t time, std::int64_t begin = 0) {
        abi::RunRecord r{};
        r.kind = kind;
        r.chain = static_cast<std::int16_t>(chain);
        r.task = static_cast<std::int16_t>(task);
        r.behind_chain = r.behind_task = -1;
        r.arrival_ns = arrival * kMs;
        r.time_ns = time * kMs;
        r.begin_ns = begin * kMs;
        return r;
    }
    void add(abi::RunKind kind, int chain, int task, std::int64_t arrival, std::int64_t time,
             std::int64_t begin = 0) {
        recorder.add(record(kind, chain, task, arrival, time, begin));
    }
    void frame_begins(int chain, std::uint32_t number, std::int64_t arrival) {
        auto r = record(abi::RunKind::kFrameBegin, chain, -1, arrival, arrival);
        r.number = number;
        recorder.add(r);
    }
    void frame_ends(int chain, std::int64_t arrival, std::int64_t end, abi::MissCause cause = {},
                    int behind = -1, std::int64_t amount = 0) {
        auto r = record(abi::RunKind::kFrameEnd, chain, -1, arrival, end, arrival);
        r.cause = cause;
        r.behind_chain = static_cast<std::int16_t>(behind);
        r.frame = {(end - arrival) * kMs, amount * kMs};
        recorder.add(r);
    }
    void hold(bool ends, int chain, int task, std::int64_t arrival, std::int64_t time,
              std::int64_t begin, int behind_chain, int behind_task, std::uint8_t flags = 0) {
        auto r = record(ends ? abi::RunKind::kHoldEnd : abi::RunKind::kHoldBegin, chain, task,
                        arrival, time, begin);
        r.why = abi::Why::kRank;
        r.flags = flags;
        r.behind_chain = static_cast<std::int16_t>(behind_chain);
        r.behind_task = static_cast<std::int16_t>(behind_task);
        recorder.add(r);
    }

    /// @param launches  of the instance so far
    void segment(bool ends, int chain, int task, std::int64_t arrival, std::int64_t time,
                 std::int64_t begin, std::uint32_t launches, std::uint16_t stream) {
        auto r = record(ends ? abi::RunKind::kSegmentEnd : abi::RunKind::kSegmentBegin, chain, task,
                        arrival, time, begin);
        if (ends) r.flags = abi::kRunIdle;
        r.segment.position = launches;
        r.stream = stream;
        recorder.add(r);
    }
    /// @param executed  on the GPU's clock, turned into the host's; 0: not known
    void mark(int chain, int task, std::int64_t seen, std::int64_t executed, std::uint32_t launches,
              std::uint16_t stream, std::uint32_t instance = 0) {
        auto r = record(abi::RunKind::kMark, chain, task, 0, seen, executed);
        r.number = instance;
        r.stream = stream;
        r.mark = {launches, 9, -5 * kMs};
        recorder.add(r);
    }
    void clock(std::int64_t time, std::int64_t host, std::uint64_t gpu_ns) {
        auto r = record(abi::RunKind::kClock, -1, -1, 0, time);
        r.clock = {gpu_ns, host * kMs};
        recorder.add(r);
    }

    void park(std::int64_t begin, std::int64_t end, std::int64_t opening, std::uint32_t gated,
              std::uint32_t refused) {
        auto r = record(abi::RunKind::kPark, -1, -1, 0, end, begin);
        r.park = {opening * kMs, gated, refused};
        recorder.add(r);
    }
    /// Of the host; several: of the GPU.
    void rounds(std::int64_t begin, std::int64_t end, std::uint32_t opened,
                std::uint32_t rounds = 1, std::int64_t took = 0) {
        auto r = record(abi::RunKind::kRound, -1, -1, 0, end, begin);
        if (rounds != 1) r.flags = abi::kRunByGpu;
        r.round = {opened, rounds, rounds == 1 ? (end - begin) * kMs : took * kMs};
        recorder.add(r);
    }

    /// Frame 17 of lidar is late, as its launches were held behind camera.
    void add_a_late_frame() {
        using abi::RunKind;
        frame_begins(1, 5, 990);
        add(RunKind::kTaskBegin, 1, 2, 990, 991);
        segment(false, 1, 2, 990, 992, 992, 0, 3);
        frame_begins(0, 17, 1000);
        add(RunKind::kTaskBegin, 0, 0, 1000, 1001);
        segment(false, 0, 0, 1000, 1005, 1005, 0, 2);
        hold(false, 0, 0, 1000, 1006, 1006, 1, 2);
        hold(true, 0, 0, 1000, 1056, 1006, 1, 2);
        segment(true, 1, 2, 990, 1055, 992, 4, 3);
        add(RunKind::kTaskEnd, 1, 2, 990, 1056, 991);
        frame_ends(1, 990, 1056);
        mark(0, 0, 1070, 1069, 3, 2);
        clock(1070, 1068, 5'000'000);
        add(RunKind::kWaitBegin, 0, 0, 1000, 1060, 1060);
        add(RunKind::kWaitEnd, 0, 0, 1000, 1090, 1060);
        segment(true, 0, 0, 1000, 1091, 1005, 5, 2);
        add(RunKind::kTaskEnd, 0, 0, 1000, 1092, 1001);
        frame_ends(0, 1000, 1095, abi::MissCause::kHeld, 1, 50);
    }

    observe::RunRecorder recorder;

  private:
    const Folder folder_;
};

}  // namespace urgengo::testing
