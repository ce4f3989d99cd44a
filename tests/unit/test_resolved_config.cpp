// SPDX-License-Identifier: Apache-2.0
//
// The resolved config: what the CLI writes, the interposer reads back; an edited source makes it
// stale; nothing that a file can contain throws.
#include "host/config/resolved_config.h"

#include "host/base/hash.h"

#include <stdlib.h>
#include <unistd.h>

#include <clocale>
#include <filesystem>
#include <fstream>
#include <string>

#include "host/config/file_text.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"

namespace urgengo::config {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

Config some_config() {
    Config config;
    config.mode = Mode::kObserve;
    config.connections = 8;
    config.blocking_sync = true;
    config.nice = -7;
    config.nvtx = NvtxEvents::kOff;
    config.chains = {
        Chain{"C0",
              150ms,
              120ms,
              OnLate::kExit,
              {{"detect", "pp_*"}, {"track", ""}},
              ArrivalFrom::kFirstCall,
              Mode::kEnforce,
              5,
              3},
        Chain{"C1",
              33'333'333ns,
              1ns,
              OnLate::kContinue,
              {{"plan \"q\"\n", "", "range*", {{"conv*", 392, 256}, {"gemm", 0, 0}}}},
              ArrivalFrom::kHint,
              Mode::kObserve},
    };
    config.scheduler =
        Scheduler{.preset = "vanilla",
                  .policy = Policy::kEdf,
                  .binding = Binding::kNone,
                  .admission = Admission::kNone,
                  .packing = {1.0 / 3.0 + 0.25, 1.75, 6ms, 5},
                  .hold = {70us, 4ms, 1.5},
                  .run_ahead = {3ms, 9ms},
                  .progress = {250us, ProgressSource::kEvent, Tracking::kBatched, 700us, true},
                  .priority = {PriorityVia::kStreamAttribute, 3},
                  .parameters = {-0.5, 0.25, 0.2, 90, 2ms},
                  .copies = {},
                  .dispatch = {}};
    config.scheduler.copies.hold = true;
    config.scheduler.dispatch.where = Dispatch::kDevice;
    config.scheduler.dispatch.device = DeviceDispatch::kLeased;
    config.scheduler.dispatch.lease = 900us;
    config.scheduler.dispatch.idle = 70us;
    config.scheduler.dispatch.gate_group = 300us;
    config.scheduler.dispatch.most_gates = 7;
    config.scheduler.copies.slice_bytes = 1 << 20;
    config.scheduler.guard = false;
    return config;
}

Profile some_profile() {
    Profile profile;
    profile.gpu = "NVIDIA H200";
    profile.driver = "580";
    profile.chains = {
        ChainProfile{"C0", {TaskProfile{"detect", 5us, {{"k", 1ULL << 40, 1024, 7us, 0.1}}}}}};
    return profile;
}

std::string error_of(const std::string& json) {
    const auto resolved = parse_resolved_json(json, "r.json");
    return resolved ? "no error" : resolved.error();
}

std::string some_text() {
    return to_resolved_json(some_config(), nullptr, {});
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
    REQUIRE(text.find(from) != std::string::npos);
    return text.replace(text.find(from), from.size(), to);
}

TEST_CASE("Resolved config is the same when written and read back", "[unit][config]") {
    const Config config = some_config();
    const Profile profile = some_profile();
    const std::string text =
        to_resolved_json(config, &profile, {{"c.yaml", 0x00ab}, {"/p", ~0ULL}});
    const auto resolved = parse_resolved_json(text, "r.json");
    REQUIRE(resolved);
    CHECK(resolved->config.mode == Mode::kObserve);
    CHECK(resolved->config.connections == 8);
    REQUIRE(resolved->config.chains.size() == 2);
    const Chain& c0 = resolved->config.chains[0];
    CHECK(c0.period == 150ms);
    CHECK(c0.deadline == 120ms);
    CHECK(c0.on_late == OnLate::kExit);
    REQUIRE(c0.tasks.size() == 2);
    CHECK(c0.tasks[0].thread_glob == "pp_*");
    CHECK(resolved->config.chains[1].period == 33'333'333ns);
    CHECK(c0.arrival == ArrivalFrom::kFirstCall);
    CHECK(c0.mode == Mode::kEnforce);
    CHECK(resolved->config.chains[1].arrival == ArrivalFrom::kHint);
    CHECK(resolved->config.chains[1].mode == Mode::kObserve);
    const Task& plan = resolved->config.chains[1].tasks[0];
    CHECK(plan.name == "plan \"q\"\n");
    CHECK(plan.nvtx_glob == "range*");
    CHECK(plan.kernels == std::vector<KernelPattern>{{"conv*", 392, 256}, {"gemm", 0, 0}});
    const Scheduler& s = resolved->config.scheduler;
    CHECK(s.preset == "vanilla");
    CHECK(s.policy == Policy::kEdf);
    CHECK(s.binding == Binding::kNone);
    CHECK(s.admission == Admission::kNone);
    CHECK(s.packing.limit == config.scheduler.packing.limit);  // to the bit
    CHECK(s.hold.poll == 70us);
    CHECK(s.hold.max_per_instance == 4ms);
    CHECK(s.hold.max_deadlines == 1.5);
    CHECK(s.run_ahead.limit == 3ms);
    CHECK(s.run_ahead.alone == 9ms);
    CHECK(s.progress.mark_every == 250us);
    CHECK(s.priority.via == PriorityVia::kStreamAttribute);
    CHECK(s.progress.source == ProgressSource::kEvent);
    CHECK(s.progress.tracking == Tracking::kBatched);
    CHECK(s.progress.eval_interval == 700us);
    CHECK(s.progress.learn);
    CHECK(s.copies.hold);
    CHECK(s.dispatch.where == Dispatch::kDevice);
    CHECK(s.dispatch.device == DeviceDispatch::kLeased);
    CHECK(s.dispatch.lease == 900us);
    CHECK(s.dispatch.idle == 70us);
    CHECK(s.dispatch.gate_group == 300us);
    CHECK(s.dispatch.most_gates == 7);
    CHECK(s.copies.slice_bytes == 1 << 20);
    CHECK_FALSE(s.guard);
    CHECK(resolved->config.nvtx == NvtxEvents::kOff);
    CHECK(resolved->config.blocking_sync);
    REQUIRE(resolved->profile);
    CHECK(resolved->profile->gpu == "NVIDIA H200");
    const KernelProfile& kernel = resolved->profile->chains[0].tasks[0].kernels[0];
    CHECK(kernel.grid_blocks == 1ULL << 40);
    CHECK(kernel.utilization == 0.1);
    REQUIRE(resolved->source.size() == 2);
    CHECK(resolved->source[0].path == "c.yaml");
    CHECK(resolved->source[0].hash == 0x00ab);
    CHECK(resolved->source[1].hash == ~0ULL);
    CHECK(to_resolved_json(resolved->config, &*resolved->profile, resolved->source) == text);
}

TEST_CASE("Resolved config reads the same numbers when the locale writes them otherwise",
          "[unit][config]") {
    // Where none of these locales is installed this shows only that nothing breaks. ps_AF has a
    // decimal point of two bytes, which nlohmann-json does not expect.
    const std::string before = std::setlocale(LC_ALL, nullptr);
    for (const char* name : {"ps_AF.UTF-8", "de_DE.UTF-8"}) {
        std::setlocale(LC_ALL, name);
        const auto resolved = parse_resolved_json(some_text(), "r.json");
        std::setlocale(LC_ALL, before.c_str());
        REQUIRE(resolved);
        CHECK(resolved->config.scheduler.packing.limit == some_config().scheduler.packing.limit);
    }
}

TEST_CASE("Resolved config error names JSON path, found and accepted when a value is wrong",
          "[unit][config]") {
    CHECK(error_of(replaced(some_text(), "\"edf\"", "\"rm\"")) ==
          "r.json: $.config.scheduler.policy: found '\"rm\"', accepted: one of feasible, urgency, "
          "edf, eqdf, saedf, lcuf, sjf, hrrn, static, fifo, utilization");
    CHECK(error_of(replaced(some_text(), "\"period_ns\": 150000000", "\"period_ns\": 0")) ==
          "r.json: $.config.chains[0].period_ns: found '0', accepted: an integer from 1 to "
          "86400000000000");
    CHECK(error_of(replaced(some_text(), "\"hold_poll_ns\": 70000", "\"hold_poll_ns\": 1")) ==
          "r.json: $.config.scheduler.hold_poll_ns: found '1', accepted: an integer from 10000 to "
          "10000000");
    CHECK(error_of(replaced(some_text(), "\"sources\": []",
                            "\"sources\": [{\"path\":\"a\","
                            "\"fnv1a64\":\"12\"}]")) ==
          "r.json: $.sources[0].fnv1a64: found '\"12\"', accepted: 16 hexadecimal digits");
    CHECK(error_of(replaced(some_text(), "\"blocking_sync\": true", "\"blocking_sync\": \"on\"")) ==
          "r.json: $.config.blocking_sync: found '\"on\"', accepted: true or false");
    CHECK(error_of(replaced(some_text(), "\"stream_attribute\"", "\"pool\"")) ==
          "r.json: $.config.scheduler.priority_via: found '\"pool\"', accepted: one of auto, "
          "launch_attribute, stream_attribute, stream_pool");
    CHECK(error_of(replaced(some_text(), "\"event\"", "\"probe\"")) ==
          "r.json: $.config.scheduler.progress_source: found '\"probe\"', accepted: one of auto, "
          "kernel, memop, event");
    CHECK(error_of(replaced(some_text(), "\"batched\"", "\"batch\"")) ==
          "r.json: $.config.scheduler.tracking: found '\"batch\"', accepted: one of progress, "
          "async, sync, batched, overlapped");
    CHECK(error_of(
              replaced(some_text(), "\"eval_interval_ns\": 700000", "\"eval_interval_ns\": 1")) ==
          "r.json: $.config.scheduler.eval_interval_ns: found '1', accepted: an integer from 10000 "
          "to 100000000");
    CHECK(error_of(replaced(some_text(), "\"gemm\"", "\"gemm@\"")) ==
          "r.json: $.config.chains[1].tasks[0].kernels[1]: found '\"gemm@\"', accepted: a pattern "
          "for kernel names, such as \"conv*\" or \"conv*@392x256\" (grid blocks x block threads)");
    Config none = some_config();
    none.chains.clear();
    CHECK(error_of(to_resolved_json(none, nullptr, {})) == "no error");  // it observes
    none.mode = Mode::kEnforce;
    CHECK(error_of(to_resolved_json(none, nullptr, {})) ==
          "r.json: $.config.chains: found an array, accepted: 1 to 256 chains with up to 256 tasks "
          "in "
          "all");
}

TEST_CASE("Resolved config has the defaults when an older version wrote it", "[unit][config]") {
    std::string old = replaced(some_text(), "\"blocking_sync\": true,", "");
    old = replaced(old, "      \"priority_via\": \"stream_attribute\",\n", "");
    old = replaced(old, "      \"progress_source\": \"event\",\n", "");
    old = replaced(old, "      \"eval_interval_ns\": 700000,\n", "");
    old = replaced(old, ",\n      \"tracking\": \"batched\"", "");
    old = replaced(old, "      \"mark_every_ns\": 250000,\n", "");
    old = replaced(old, "      \"learn\": true,\n", "");
    old = replaced(old, "      \"hold_copies\": true,\n", "");
    old = replaced(old, "      \"copy_slice_bytes\": 1048576,\n", "");
    old = replaced(old, "      \"run_ahead_alone_ns\": 9000000,\n", "");
    const auto resolved = parse_resolved_json(old, "r.json");
    REQUIRE(resolved);
    CHECK(resolved->config.scheduler.priority.via == PriorityVia::kAuto);
    CHECK(resolved->config.scheduler.progress.source == ProgressSource::kAuto);
    CHECK(resolved->config.scheduler.progress.tracking == Tracking::kProgress);
    CHECK(resolved->config.scheduler.progress.eval_interval == 500us);
    CHECK(resolved->config.scheduler.run_ahead.alone == 4ms);
    CHECK_FALSE(resolved->config.scheduler.progress.mark_every);
    CHECK_FALSE(resolved->config.scheduler.progress.learn);
    CHECK_FALSE(resolved->config.scheduler.copies.hold);
    CHECK(resolved->config.scheduler.copies.slice_bytes == 0);
    CHECK_FALSE(resolved->config.blocking_sync);
}

TEST_CASE("Resolved config never throws when the text is cut, garbled or deep", "[unit][config]") {
    const std::string text = some_text();
    for (std::size_t length = 0; length < text.size() - 2; ++length) {
        REQUIRE_FALSE(parse_resolved_json(text.substr(0, length), "r.json"));
    }
    for (std::size_t i = 0; i < text.size(); ++i) {
        for (const char c : {'\0', '\xff', '9', '"', '[', '-'}) {
            std::string garbled = text;
            garbled[i] = c;
            (void)parse_resolved_json(garbled, "r.json");
        }
    }
    CHECK_FALSE(parse_resolved_json(std::string(200'000, '['), "r.json"));
    for (const char* odd : {"null", "[]", "3", "\"x\"", "{\"format_version\":null}"}) {
        CHECK_FALSE(parse_resolved_json(odd, "r.json"));
    }
}

TEST_CASE("Resolved sibling is used only when its sources are as they were", "[unit][config]") {
    const testing::Folder folder;
    const std::string yaml = folder.write("chains.yaml", "version: 1\n");
    const auto why_not = [&] {
        const auto resolved = load_for_interposer(yaml);
        return resolved ? std::string("loaded") : resolved.error();
    };
    const auto why_not_with = [&](const std::string& reason) {
        const std::string message = why_not();
        UNSCOPED_INFO(message);
        return message.find(reason) != std::string::npos &&
               message.ends_with("urgengo run -c " + yaml + " -- program");
    };
    CHECK(why_not_with("No such file"));

    const std::string text =
        to_resolved_json(some_config(), nullptr, {{"chains.yaml", fnv1a64("version: 1\n")}});
    const std::string json = folder.write("chains.resolved.json", text);
    CHECK(why_not() == "loaded");
    CHECK(load_for_interposer(json));

    folder.write("chains.profile.json", "{}");
    CHECK(why_not_with("chains.profile.json has appeared since"));
    fs::remove(profile_sibling(yaml));
    CHECK(why_not() == "loaded");

    folder.write("chains.yaml", "version: 1 \n");
    CHECK(why_not_with("chains.yaml has changed since"));
    CHECK(load_for_interposer(json));  // named itself, it is taken as it is

    folder.write("other.yaml", "version: 1\n");
    folder.write(
        "chains.resolved.json",
        to_resolved_json(some_config(), nullptr, {{"other.yaml", fnv1a64("version: 1\n")}}));
    CHECK(why_not_with("it was made from another file"));
}

TEST_CASE("Interposer's config error says what is accepted when the path is of no use",
          "[unit][config]") {
    CHECK(load_for_interposer("chains.txt").error() ==
          "chains.txt: found the extension '.txt', accepted: .yaml, .yml, or .json (a resolved "
          "config)");
    CHECK(load_for_interposer("/nonexistent/a.json").error() ==
          "/nonexistent/a.json: cannot be read: No such file or directory");
    CHECK(load_for_interposer("/nonexistent/a.yaml").error() ==
          "/nonexistent/a.yaml: cannot be read: no such file");
    CHECK_FALSE(load_for_interposer(""));
}

TEST_CASE("Hash is FNV-1a when the text is known", "[unit][config]") {
    CHECK(fnv1a64("") == 0xcbf29ce484222325);
    CHECK(fnv1a64("a") == 0xaf63dc4c8601ec8c);
    CHECK(fnv1a64("foobar") == 0x85944171f73967e8);
}

}  // namespace
}  // namespace urgengo::config
