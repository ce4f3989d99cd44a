// SPDX-License-Identifier: Apache-2.0
//
// What UrgenGo tells another NVTX tool, as that tool gets it.
#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "host/observe/nvtx_table.h"
#include "tests/interposer/nvtx_recording.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
namespace nvtx = urgengo::observe::nvtx;

namespace {

/// Two chains, one of which has to wait for the other.
Recording record_scheduling(const Environment& environment,
                            config::NvtxEvents events = config::NvtxEvents::kAuto,
                            const std::function<void(config::Config&)>& change_more = {}) {
    const Folder folder;
    config::Profile profile;
    profile.chains = {{"tight", {scheduling_profile("tight")}},
                      {"loose", {scheduling_profile("loose")}}};
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                     {chain("tight", 60s, {{"work", ""}}), chain("loose", 3600s, {{"work", ""}})},
                     &profile, [&](config::Config& change) {
                         change.scheduler.admission = config::Admission::kExclusive;
                         change.scheduler.hold.max_per_instance = 10s;
                         change.scheduler.progress.mark_every = 0ns;  // a mark behind every launch
                         change.nvtx = events;
                         if (change_more) change_more(change);
                     });
    return record({"scheduling"}, configured(environment, config));
}

std::vector<std::string> with(const std::vector<std::string>& lines, const std::string& part) {
    std::vector<std::string> found;
    for (const std::string& line : lines)
        if (line.find(part) != std::string::npos) found.push_back(line);
    return found;
}

/// @returns the number of the range that the line starts
int range_of(const std::string& line) {
    return std::stoi(line.substr(line.rfind("= ") + 2));
}

/// @returns lines that tell of the program's calls alone
std::vector<std::string> of_program(const std::vector<std::string>& lines) {
    std::vector<std::string> found;
    for (const std::string& line : lines)
        if (!line.starts_with("[urgengo]") && !line.starts_with("init") &&
            line != "[] domain urgengo" && line != "[] thread urgengo")
            found.push_back(line);
    return found;
}

}  // namespace

TEST_CASE("NVTX tool is told of instances, holds, the GPU and counters when two chains meet",
          "[interposer][nvtx]") {
    const Recording bare_run = record({"scheduling"}, bare());
    const Recording found = record_scheduling(with_recorder(preloaded()));
    CHECK(found.outcome.exit_status == 0);
    CHECK(found.outcome.err == "");
    CHECK(lines_of(found.outcome.out).size() == lines_of(bare_run.outcome.out).size());
    CHECK(errors_of(found.lines).empty());

    for (const std::string chain : {"tight", "loose"}) {
        INFO(chain);
        const std::string begins = " {chain: " + chain + ", task: ";
        CHECK(with(found.lines, "start " + chain + " (category 3)" + begins + "-").size() == 1);
        CHECK(with(found.lines, "start work (category 1)" + begins + "work").size() == 1);
        // Its end, and its task's.
        CHECK(with(with(found.lines, "[urgengo] end"), "outcome: in time, reason: none").size() ==
              2);
        CHECK(with(found.lines, "[urgengo] sample " + chain + " laxity ").size() >= 2);
        CHECK(!with(found.lines, "[urgengo] sample " + chain + " executing ").empty());
        CHECK(!with(found.lines, "[urgengo] sample " + chain + " priority ").empty());
        const auto executed = with(found.lines, "[urgengo] event {task: work, ");
        CHECK(
            !with(with(executed, "chain: " + chain + ", instance: 1, "), "end_launch: 5}").empty());
    }
    CHECK(!with(found.lines,
                "start hold (category 2) {chain: loose, task: work, behind: tight, "
                "why: exclusive, held_ns: 0")
               .empty());
    CHECK(with(found.lines, "start hold (category 2) {chain: tight").empty());
    // It ends when the launch goes.
    const auto first = [&](const std::string& part) {
        return std::find_if(
                   found.lines.begin(), found.lines.end(),
                   [&](const std::string& line) { return line.find(part) != std::string::npos; }) -
               found.lines.begin();
    };
    const auto began =
        first("{chain: loose, task: work, behind: tight, why: exclusive, held_ns: 0");
    CHECK(first("sample loose held ") < first("sample loose priority "));
    CHECK(first("[urgengo] end " +
                std::to_string(range_of(found.lines.at(static_cast<std::size_t>(began)))) + " ") <
          first("sample loose priority "));
    CHECK(with(found.lines, "sync points: too few").empty());
    CHECK(!with(found.lines, "sync points: enough").empty());
}

TEST_CASE("NVTX tool is told no more than the tables of UrgenGo's events say",
          "[interposer][nvtx]") {
    const Recording found = record_scheduling(with_recorder(preloaded()));
    const auto all_of = [&](const std::string& kind) {
        std::vector<std::string> names;
        for (const std::string& line : with(found.lines, "[urgengo] " + kind + " "))
            names.push_back(line.substr(("[urgengo] " + kind + " ").size()));
        return names;
    };
    std::vector<std::string> categories;
    for (std::size_t i = 0; i < nvtx::kCategories.size(); ++i)
        categories.push_back(std::to_string(i + 1) + " " + nvtx::kCategories[i]);
    CHECK(all_of("category") == categories);
    const std::vector<std::string> strings = all_of("string");
    REQUIRE(strings.size() > nvtx::kNumWords);
    for (std::size_t i = 0; i < nvtx::kNumWords; ++i) CHECK(strings[i] == nvtx::kWords[i]);
    std::vector<std::string> schemas;
    for (const nvtx::SchemaInfo& schema : nvtx::kSchemas) {
        std::string line = std::string(schema.name) + ":";
        for (const nvtx::Entry& entry : schema.entries) {
            line += std::string(" ") + entry.name;
            if (entry.kind == nvtx::Kind::kBegin || entry.kind == nvtx::Kind::kEnd)
                line += " (time of type 0)";
        }
        schemas.push_back(line);
    }
    CHECK(all_of("schema") == schemas);
    std::vector<std::string> counters;
    for (const std::string chain : {"tight", "loose"})
        for (const nvtx::CounterInfo& counter : nvtx::kCounters)
            counters.push_back(chain + " " + counter.name);
    CHECK(all_of("counter") == counters);
    CHECK(all_of("scope") == std::vector<std::string>{nvtx::kTimeScope});
}

TEST_CASE("Programs do the same, and ranges are balanced, when another NVTX tool is told",
          "[interposer][nvtx]") {
    const Folder folder;
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                     {chain("main", 100ms, {{"main", "twin"}})});
    for (const std::string scenario :
         {"cancel_held", "cancel_waiting", "destroyed_held", "exit_pending", "failures", "fork",
          "graph_held", "hints", "implicit_waits", "order_events", "threads"}) {
        INFO(scenario);
        const Outcome expected = run_twin({scenario}, bare());
        const Recording found = record({scenario}, configured(with_recorder(preloaded()), config));
        CHECK(found.outcome.exit_status == expected.exit_status);
        CHECK(found.outcome.out == expected.out);
        CHECK(errors_of(found.lines).empty());
        CHECK(!with(found.lines, "[] domain urgengo").empty());
    }
}

TEST_CASE("Page on NVTX lists all that UrgenGo tells, and nothing else", "[interposer][nvtx]") {
    const std::string page = read_text(SOURCE_FOLDER "/docs/nvtx.md");
    const auto section = [&](const std::string& title) {
        const auto at = page.find("### " + title + "\n");
        REQUIRE(at != std::string::npos);
        return page.substr(at, page.find("\n### ", at + 1) - at);
    };
    // The words in `` of each line that begins like this.
    const auto words = [](const std::string& text, const std::string& beginning) {
        std::vector<std::vector<std::string>> all;
        for (const std::string& line : lines_of(text)) {
            if (!line.starts_with(beginning)) continue;
            all.emplace_back();
            for (std::size_t at = 0; (at = line.find('`', at)) != std::string::npos;) {
                const std::size_t end = line.find('`', at + 1);
                all.back().push_back(line.substr(at + 1, end - at - 1));
                at = end + 1;
            }
        }
        return all;
    };
    std::vector<std::vector<std::string>> categories, schemas, counters;
    for (const char* category : nvtx::kCategories) categories.push_back({category});
    for (const nvtx::SchemaInfo& schema : nvtx::kSchemas) {
        schemas.push_back({schema.name});
        for (const nvtx::Entry& entry : schema.entries) schemas.back().emplace_back(entry.name);
    }
    for (const nvtx::CounterInfo& counter : nvtx::kCounters) counters.push_back({counter.name});
    CHECK(words(section("Categories"), "| `") == categories);
    CHECK(words(section("Schemas"), "| `") == schemas);
    CHECK(words(section("Counters"), "| `") == counters);
    // Each range and mark has a schema that there is, each schema has a row, and each name that
    // stays the same is a registered one.
    std::set<std::string> used, its_names;
    for (const char* const kind : {"| range |", "| mark |", "| deferred range |"})
        for (const auto& row : words(section("Ranges and marks"), kind)) {
            used.insert(row.back());
            its_names.insert(row.begin(), row.end() - 1);
        }
    std::set<std::string> all_schemas, event_names;
    for (const nvtx::SchemaInfo& schema : nvtx::kSchemas) all_schemas.insert(schema.name);
    CHECK(used == all_schemas);
    for (std::size_t i = 0; i < static_cast<std::size_t>(nvtx::Word::kInTime); ++i)
        event_names.insert(nvtx::kWords[i]);
    CHECK(its_names == event_names);
    const std::vector<std::string> strings(nvtx::kWords.begin(), nvtx::kWords.end());
    const std::vector<std::vector<std::string>> registered{strings};
    CHECK(words(section("Strings"), "Registered") == registered);
    CHECK(page.find("The domain is `" + std::string(nvtx::kDomain) + "`.") != std::string::npos);
    CHECK(page.find('`' + std::string(nvtx::kTimeScope) + '`') != std::string::npos);
}

TEST_CASE("NVTX tool is told of gates, and of each frame, when launches wait behind gates",
          "[interposer][nvtx]") {
    const auto task = [](std::size_t num_kernels) {
        config::TaskProfile its;
        its.name = "work";
        its.kernels.assign(num_kernels, {"half_ms", 46, 1024, 500us, 1.0});
        const auto n = static_cast<std::uint32_t>(num_kernels);
        its.segments = {{1us, n, n, n, "stream"}};
        return its;
    };
    const Folder folder;
    config::Profile profile;
    profile.chains = {{"tight", {task(16)}}, {"loose", {task(60)}}};
    const auto config = write_config(
        folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
        {chain("tight", 24ms, {{"work", "tight"}}), chain("loose", 50ms, {{"work", "loose"}})},
        &profile, dispatched_by(config::Dispatch::kHost));
    const auto stats = folder.path() / "stats.json";
    const Recording found =
        record({"periods", "1"}, configured(with_recorder(preloaded()), config, stats));
    CHECK(found.outcome.exit_status == 0);
    CHECK(errors_of(found.lines).empty());
    std::map<std::string, std::size_t> counted;
    const nlohmann::json root = nlohmann::json::parse(read_text(stats));
    for (const auto& chain : root.at("chains")) counted[chain.at("name")] = chain.at("instances");
    const std::string mark = "[urgengo] mark ", dispatch = " (category 4) {task: ";
    for (const std::string what : {"gate closed", "gates open"})
        CHECK(!with(found.lines, mark + what + dispatch + "work, closed: ").empty());
    CHECK(!with(found.lines, mark + "round" + dispatch + "-, closed: ").empty());
    for (const std::string& line : lines_of(found.outcome.out)) {
        const std::string chain = line.substr(0, line.find(' '));
        INFO(line);
        const auto frames = std::stoul(line.substr(chain.size() + 1));
        CHECK(counted.at(chain) == frames);
        // One that begins while another thread's first launch attaches the tool is not told.
        const auto begun = with(found.lines, "start " + chain + " (category 3) {").size();
        CHECK(begun <= frames);
        CHECK(begun + 1 >= frames);
        CHECK(with(with(found.lines, "[urgengo] end"), "{chain: " + chain + ", task: -, ").size() ==
              begun);
        CHECK(with(found.lines, "event {task: work, ").size() >= begun);
    }
}

TEST_CASE("NVTX tool is told the names of streams when UrgenGo has some", "[interposer][nvtx]") {
    const Recording found =
        record_scheduling(with_recorder(preloaded()), config::NvtxEvents::kAuto, by_stream_pool);
    CHECK(errors_of(found.lines).empty());
    CHECK(!with(found.lines, "[] stream urgengo priority -5").empty());
    CHECK(!with(found.lines, "[] thread urgengo").empty());
}

TEST_CASE("NVTX tool is told in a plainer way when it lacks extensions or strings",
          "[interposer][nvtx]") {
    for (const std::string lacks : {"payload", "strings", "extensions", "counters"}) {
        INFO(lacks);
        const Recording found = record_scheduling(with_recorder(preloaded(), lacks));
        CHECK(found.outcome.exit_status == 0);
        CHECK(errors_of(found.lines).empty());
        const bool plain = lacks != "counters";
        CHECK(with(found.lines, "start work: chain loose, task work, instance 1, ").size() ==
              (plain ? 1 : 0));
        CHECK(with(found.lines, "[urgengo] event").empty() == plain);
        const bool counts = lacks == "payload" || lacks == "strings";
        CHECK(with(found.lines, "[urgengo] sample loose laxity").empty() != counts);
        CHECK(with(found.lines, "[urgengo] mark loose laxity (category 3) {").empty() == counts);
    }
}

TEST_CASE("NVTX tool is told nothing by UrgenGo when the config or the environment says so",
          "[interposer][nvtx]") {
    CHECK(record_scheduling(with_recorder(preloaded()), config::NvtxEvents::kOff).lines.empty());
    Environment environment = with_recorder(preloaded());
    environment["URGENGO_NVTX"] = "off";
    CHECK(record_scheduling(environment, config::NvtxEvents::kOn).lines.empty());
    const Recording without = record_scheduling(preloaded(), config::NvtxEvents::kOn);
    CHECK(
        without.outcome.err ==
        "urgengo: nvtx: on, but there is no NVTX tool (NVTX_INJECTION64_PATH): nothing is told\n");
    CHECK(record_scheduling(preloaded()).outcome.err == "");
}

TEST_CASE("Program's own NVTX calls reach the tool as bare when UrgenGo's events do, too",
          "[interposer][nvtx]") {
    const Folder folder;
    config::Task task{"main", ""};
    task.nvtx_glob = "*";  // if our ranges delimited tasks, they would do so here
    const auto config = write_config(folder.path() / "config.json", "urgengo",
                                     config::Mode::kEnforce, {chain("main", 100ms, {task})});
    const Recording expected = record({"nvtx_calls"}, with_recorder(bare()));
    Environment chained = with_recorder(preloaded());
    chained = behind_us(chained, NVTX_RECORDER_PATH);
    for (const Environment& environment : {with_recorder(preloaded()), chained}) {
        const Recording found = record({"nvtx_calls"}, configured(environment, config));
        const bool has_ranges = environment.at("NVTX_INJECTION64_PATH") != NVTX_RECORDER_PATH;
        CHECK(found.outcome.out == expected.outcome.out);
        CHECK((found.outcome.err.find("nothing matched task 'main'") == std::string::npos) ==
              has_ranges);
        CHECK(of_program(found.lines) == of_program(expected.lines));
        CHECK(!with(found.lines, "[] domain urgengo").empty());
        CHECK(errors_of(found.lines) == errors_of(expected.lines));
    }
}
