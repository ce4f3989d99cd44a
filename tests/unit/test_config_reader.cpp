// SPDX-License-Identifier: Apache-2.0
//
// chains.yaml: what is accepted, and the exact line that each mistake gets.
#include "host/config/config_reader.h"

#include "tests/support/config_texts.h"

namespace urgengo::config {
namespace {

using namespace std::chrono_literals;

TEST_CASE("Config takes every default when only the required keys are there", "[unit][config]") {
    const auto config = parse_config(kMinimal, "c.yaml");
    REQUIRE(config);
    CHECK(config->mode == Mode::kEnforce);
    CHECK(config->connections == kAutoConnections);
    CHECK(connections_of(*config) == 0);  // few tasks
    REQUIRE(config->chains.size() == 1);
    const Chain& chain = config->chains[0];
    CHECK(chain.name == "lidar");
    CHECK(chain.period == 150ms);
    CHECK(chain.deadline == 120'500us);
    CHECK(chain.on_late == OnLate::kContinue);
    REQUIRE(chain.tasks.size() == 2);
    CHECK(chain.tasks[0].thread_glob == "pp_*");
    CHECK(chain.tasks[1].name == "track");
    CHECK(chain.tasks[1].thread_glob.empty());
    CHECK(config->scheduler.preset == "urgengo");
    CHECK(config->scheduler.admission == Admission::kPacked);
    CHECK(config->scheduler.priority.via == PriorityVia::kAuto);
    CHECK(config->scheduler.progress.source == ProgressSource::kAuto);
    CHECK(config->scheduler.progress.tracking == Tracking::kProgress);
    CHECK(config->scheduler.progress.eval_interval == 500us);
    CHECK_FALSE(config->blocking_sync);
}

TEST_CASE("Config reads every key when all are there", "[unit][config]") {
    const auto config =
        parse_config(with_line(5, "    deadline_ms: 120\n    on_late: exit", kAll), "c.yaml");
    REQUIRE(config);
    CHECK(config->mode == Mode::kObserve);
    CHECK(config->chains[0].on_late == OnLate::kExit);
    const Scheduler& s = config->scheduler;
    CHECK(s.preset == "vanilla");
    CHECK(s.policy == Policy::kEdf);
    CHECK(s.binding == Binding::kKernel);
    CHECK(s.admission == Admission::kPacked);
    CHECK(s.packing.limit == 0.9);
    CHECK(s.hold.poll == 10us);
    CHECK(s.hold.max_per_instance == 2'500us);
    CHECK(s.progress.mark_every == 300us);
    CHECK(s.progress.source == ProgressSource::kMemop);
    CHECK(s.progress.learn);
    CHECK(s.run_ahead.limit == 2ms);
    CHECK(s.run_ahead.alone == 5ms);
    CHECK(s.priority.via == PriorityVia::kStreamPool);
    CHECK(s.progress.tracking == Tracking::kOverlapped);
    CHECK(s.progress.eval_interval == 100us);
    CHECK(config->blocking_sync);
    CHECK(config->connections == 8);
}

TEST_CASE("Config reads what tells a chain's launches when it is written", "[unit][config]") {
    const auto config = parse_config(
        with_line(5, "    deadline_ms: 120\n    arrival: {from: hint}\n    mode: observe\n") +
            "      - {name: a, nvtx: \"plan*\", kernels: \"conv*\"}\n"
            "      - {name: b, thread: t, kernels: [gemm, \"conv*@392x256\", \"k@*x64\"]}\n",
        "c.yaml");
    REQUIRE(config);
    const Chain& chain = config->chains[0];
    CHECK(chain.arrival == ArrivalFrom::kHint);
    CHECK(chain.mode == Mode::kObserve);
    REQUIRE(chain.tasks.size() == 4);
    CHECK(chain.tasks[0].nvtx_glob.empty());
    CHECK(chain.tasks[0].kernels.empty());
    CHECK(chain.tasks[2].nvtx_glob == "plan*");
    CHECK(chain.tasks[2].kernels == std::vector<KernelPattern>{{"conv*", 0, 0}});
    CHECK(chain.tasks[3].thread_glob == "t");
    CHECK(chain.tasks[3].kernels ==
          std::vector<KernelPattern>{{"gemm", 0, 0}, {"conv*", 392, 256}, {"k", 0, 64}});
}

TEST_CASE("Kernel pattern is the same when written and read back", "[unit][config]") {
    for (const KernelPattern& pattern :
         {KernelPattern{"conv*", 0, 0}, KernelPattern{"_Z1kPf", 1ULL << 40, 1024},
          KernelPattern{"k", 7, 0}, KernelPattern{"k", 0, 7}, KernelPattern{"a@b", 0, 0}}) {
        INFO(to_text(pattern));
        const auto read = parse_kernel_pattern(to_text(pattern));
        REQUIRE(read);
        CHECK(*read == pattern);
    }
    CHECK(to_text({"conv*", 392, 256}) == "conv*@392x256");
    for (const char* odd : {"", "@3x4", "k@", "k@3", "k@3x", "k@x3", "k@0x3", "k@3x-1", "k@3x4x5",
                            "k@ 3x4", "k@3x99999999999"}) {
        CHECK_FALSE(parse_kernel_pattern(odd));
    }
}

TEST_CASE("Config error names line, path, found and accepted when a task's rule is wrong",
          "[unit][config]") {
    const std::string pattern =
        ", accepted: a pattern for kernel names, such as \"conv*\" or \"conv*@392x256\" (grid "
        "blocks x block threads)";
    const auto error = [](const std::string& keys) {
        return error_of(with_line(8, "      - {name: track, " + keys + "}"));
    };
    CHECK(error("kernels: \"conv@3\"") ==
          "c.yaml:8: chains[0].tasks[1].kernels: found 'conv@3'" + pattern);
    CHECK(error("kernels: [gemm, {}]") ==
          "c.yaml:8: chains[0].tasks[1].kernels[1]: found a map" + pattern);
    CHECK(error("kernels: []") ==
          "c.yaml:8: chains[0].tasks[1].kernels: found no pattern, accepted: at least one");
    CHECK(
        error("nvtx: \"\"") ==
        "c.yaml:8: chains[0].tasks[1].nvtx: found '', accepted: a pattern for NVTX ranges' names, "
        "such as \"detect*\"");
    CHECK(error("kernel: conv") ==
          "c.yaml:8: chains[0].tasks[1].kernel: unknown key, accepted: name, thread, nvtx, kernels "
          "(did you mean 'kernels'?)");
    CHECK(error_of(with_line(5, "    deadline_ms: 9\n    arrival: {from: topic}")) ==
          "c.yaml:6: chains[0].arrival.from: found 'topic', accepted: first_call, hint");
    CHECK(error_of(with_line(5, "    deadline_ms: 9\n    arrival: hint")) ==
          "c.yaml:6: chains[0].arrival: found 'hint', accepted: a map with from");
    CHECK(error_of(with_line(5, "    deadline_ms: 9\n    arrival: {}")) ==
          "c.yaml:6: chains[0].arrival.from: missing, and required");
    CHECK(error_of(with_line(5, "    deadline_ms: 9\n    mode: on")) ==
          "c.yaml:6: chains[0].mode: found 'on', accepted: off, observe, shadow, enforce");
}

TEST_CASE("Config reads the words that stand for numbers when they are written", "[unit][config]") {
    const auto config = parse_config(
        std::string(kMinimal) +
            "scheduler: {hold: {max_per_instance_ms: deadline}}\nenv: {connections: keep}\n",
        "c.yaml");
    REQUIRE(config);
    CHECK(config->scheduler.hold.max_per_instance == 0ns);
    CHECK(config->scheduler.hold.max_deadlines == 1);
    CHECK(config->connections == 0);
}

TEST_CASE("Config says whether another NVTX tool is told when it has the key nvtx",
          "[unit][config]") {
    const auto nvtx = [](const std::string& line) {
        const auto config = parse_config(std::string(kMinimal) + line, "c.yaml");
        REQUIRE(config);
        return config->nvtx;
    };
    CHECK(nvtx("") == NvtxEvents::kAuto);
    CHECK(nvtx("nvtx: on\n") == NvtxEvents::kOn);
    CHECK(nvtx("nvtx: off\n") == NvtxEvents::kOff);
}

TEST_CASE("Config reads on and off however YAML writes them", "[unit][config]") {
    const auto blocking_sync = [](const std::string& word) {
        const auto config =
            parse_config(std::string(kMinimal) + "cpu: {blocking_sync: " + word + "}\n", "c.yaml");
        REQUIRE(config);
        return config->blocking_sync;
    };
    CHECK(blocking_sync("on"));
    CHECK(blocking_sync("true"));
    CHECK_FALSE(blocking_sync("off"));
    CHECK_FALSE(blocking_sync("false"));
    CHECK(error_with("cpu: {blocking_sync: maybe}\n") ==
          "c.yaml:9: cpu.blocking_sync: found 'maybe', accepted: on, off, true, false");
    CHECK(error_with("cpu: {blocking_sync:}\n") ==
          "c.yaml:9: cpu.blocking_sync: found nothing, accepted: on, off, true, false");
    CHECK(error_with("cpu: on\n") ==
          "c.yaml:9: cpu: found 'on', accepted: a map with blocking_sync, nice");
}

TEST_CASE("Config says how nice threads of chains are", "[unit][config]") {
    const auto config = parse_config(std::string(kMinimal) + "cpu: {nice: -15}\n", "c.yaml");
    REQUIRE(config);
    CHECK(config->nice == -15);
    CHECK_FALSE(parse_config(kMinimal, "c.yaml")->nice);
    CHECK(error_with("cpu: {nice: 5}\n").rfind("c.yaml:9: cpu.nice: found '5', accepted:", 0) == 0);
}

TEST_CASE("Config reads each way to a priority", "[unit][config]") {
    const auto priority_via = [](const std::string& word) {
        const auto config = parse_config(
            std::string(kMinimal) + "scheduler: {priority_via: " + word + "}\n", "c.yaml");
        REQUIRE(config);
        return config->scheduler.priority.via;
    };
    CHECK(priority_via("auto") == PriorityVia::kAuto);
    CHECK(priority_via("launch_attribute") == PriorityVia::kLaunchAttribute);
    CHECK(priority_via("stream_attribute") == PriorityVia::kStreamAttribute);
    CHECK(priority_via("stream_pool") == PriorityVia::kStreamPool);
    CHECK(error_with("scheduler: {priority_via: pool}\n") ==
          "c.yaml:9: scheduler.priority_via: found 'pool', accepted: auto, launch_attribute, "
          "stream_attribute, stream_pool");
}

TEST_CASE("Config reads what becomes of copies", "[unit][config]") {
    const auto scheduler = [](const std::string& copies) {
        const auto config = parse_config(
            std::string(kMinimal) + "scheduler: {copies: {" + copies + "}}\n", "c.yaml");
        REQUIRE(config);
        return std::pair(config->scheduler.copies.hold, config->scheduler.copies.slice_bytes);
    };
    const Scheduler by_default;
    CHECK_FALSE(by_default.copies.hold);
    CHECK(by_default.copies.slice_bytes == 0);
    CHECK(scheduler("hold: off") == std::pair(false, std::int64_t{0}));
    CHECK(scheduler("hold: on") == std::pair(true, std::int64_t{10 << 20}));
    CHECK(scheduler("slice_bytes: 65536") == std::pair(false, std::int64_t{65'536}));
    CHECK(scheduler("slice_bytes: 1073741824, hold: on") == std::pair(true, std::int64_t{1 << 30}));
    CHECK(scheduler("slice_bytes: 0, hold: on") == std::pair(true, std::int64_t{0}));
    for (const char* wrong : {"65535", "1073741825", "-1", "8M"})
        CHECK(error_with("scheduler: {copies: {slice_bytes: " + std::string(wrong) + "}}\n") ==
              "c.yaml:9: scheduler.copies.slice_bytes: found '" + std::string(wrong) +
                  "', accepted: a whole number from 65536 to 1073741824 (bytes), or 0");
    CHECK(error_with("scheduler: {copies: {hold: yes}}\n") ==
          "c.yaml:9: scheduler.copies.hold: found 'yes', accepted: on, off, true, false");
    CHECK(error_with("scheduler: {copies: {holds: on}}\n") ==
          "c.yaml:9: scheduler.copies.holds: unknown key, accepted: hold, slice_bytes (did you "
          "mean 'hold'?)");
}

TEST_CASE("Config reads each source of progress", "[unit][config]") {
    const auto source = [](const std::string& word) {
        const auto config = parse_config(
            std::string(kMinimal) + "scheduler: {progress: {source: " + word + "}}\n", "c.yaml");
        REQUIRE(config);
        CHECK_FALSE(config->scheduler.progress.mark_every);
        CHECK(mark_every(config->scheduler, ProgressSource::kEvent) == 50us);
        CHECK(mark_every(config->scheduler, ProgressSource::kKernel) == 100us);
        Scheduler written = config->scheduler;
        written.progress.mark_every = 30us;
        CHECK(mark_every(written, ProgressSource::kEvent) == 30us);
        CHECK_FALSE(config->scheduler.progress.learn);
        return config->scheduler.progress.source;
    };
    CHECK(source("auto") == ProgressSource::kAuto);
    CHECK(source("kernel") == ProgressSource::kKernel);
    CHECK(source("memop") == ProgressSource::kMemop);
    CHECK(source("event") == ProgressSource::kEvent);
    CHECK(error_with("scheduler: {progress: {source: events}}\n") ==
          "c.yaml:9: scheduler.progress.source: found 'events', accepted: auto, kernel, memop, "
          "event");
}

TEST_CASE("Config reads each way of tracking", "[unit][config]") {
    const auto tracking = [](const std::string& word) {
        const auto config =
            parse_config(std::string(kMinimal) + "scheduler: {tracking: " + word + "}\n", "c.yaml");
        REQUIRE(config);
        return config->scheduler.progress.tracking;
    };
    CHECK(tracking("progress") == Tracking::kProgress);
    CHECK(tracking("async") == Tracking::kAsync);
    CHECK(tracking("sync") == Tracking::kSync);
    CHECK(tracking("batched") == Tracking::kBatched);
    CHECK(tracking("overlapped") == Tracking::kOverlapped);
    CHECK(
        error_with("scheduler: {tracking: overlap}\n") ==
        "c.yaml:9: scheduler.tracking: found 'overlap', accepted: progress, async, sync, batched, "
        "overlapped");
    CHECK(error_with("scheduler: {traking: sync}\n").ends_with(" (did you mean 'tracking'?)"));
    CHECK(error_with("scheduler: {eval_interval_us: 5}\n") ==
          "c.yaml:9: scheduler.eval_interval_us: found '5', accepted: a whole number from 10 to "
          "100000 (microseconds)");
}

TEST_CASE("Config's keys override the preset when both are written", "[unit][config]") {
    const auto plain = parse_config(std::string(kMinimal) + "scheduler: {preset: vanilla}\n", "c");
    REQUIRE(plain);
    CHECK(plain->scheduler.binding == Binding::kNone);
    CHECK(plain->scheduler.admission == Admission::kNone);

    const auto keyed = parse_config(
        std::string(kMinimal) + "scheduler: {binding: kernel, preset: vanilla}\n", "c");
    REQUIRE(keyed);
    CHECK(keyed->scheduler.binding == Binding::kKernel);
    CHECK(keyed->scheduler.admission == Admission::kNone);
}

TEST_CASE("Config's preset gives way and its keys stay when a preset is handed in",
          "[unit][config]") {
    const std::string yaml =
        std::string(kMinimal) + "scheduler: {preset: urgengo, pack_limit: 2, binding: kernel}\n";
    const auto config = parse_config(yaml, "c", "vanilla");
    REQUIRE(config);
    CHECK(config->scheduler.preset == "vanilla");
    CHECK(config->scheduler.admission == Admission::kNone);
    CHECK(config->scheduler.binding == Binding::kKernel);
    CHECK(config->scheduler.packing.limit == 2);
    CHECK(error_of(kMinimal, "fast") ==
          "preset: found 'fast', accepted: urgengo, urgency, edf, eqdf, saedf, lcuf, "
          "sjf, hrrn, static, fifo, paper, paper_binding, paper_delay, paam, dcuda, vanilla");
}

}  // namespace
}  // namespace urgengo::config
