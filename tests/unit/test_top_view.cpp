// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/top/top_view.h"

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using abi::MissCause;
using cli::ChainReading;
using cli::PageReading;
using cli::TaskReading;
using cli::top_lines;
using cli::TopLine;
using cli::TopOptions;
using cli::TopOrder;
using std::chrono::nanoseconds;

namespace {

/// lidar works and is urgent, camera is held behind it, map is idle and was late, radar works late.
PageReading stack() {
    PageReading page;
    page.process.process = 42;
    page.program = "stack";
    page.mode = abi::StatusMode::kEnforce;
    const auto add = [&](const char* name, nanoseconds laxity, abi::TaskState state) {
        TaskReading task;
        task.name = "detect";
        task.chain = page.chains.size();
        task.state = state;
        task.laxity = laxity;
        task.planned_gpu = 10ms;
        task.remaining_gpu = 4ms;
        page.tasks.push_back(task);
        ChainReading chain;
        chain.name = name;
        chain.deadline = 80ms;
        chain.mode = page.mode;
        chain.tasks = {page.tasks.size() - 1};
        if (state != abi::TaskState::kIdle) chain.at = static_cast<int>(page.tasks.size()) - 1;
        page.chains.push_back(chain);
    };
    add("camera", 60ms, abi::TaskState::kHeld);
    add("lidar", 20ms, abi::TaskState::kGpu);
    add("map", 0ms, abi::TaskState::kIdle);
    add("radar", -3ms, abi::TaskState::kGpu);
    page.tasks[0].why = abi::Why::kRank;
    page.tasks[0].behind = 1;
    page.tasks[0].held = 4ms;
    page.chains[2].instances = 200;
    page.chains[2].finished = 180;  // others were replaced by their next
    page.chains[2].missed = 5;
    page.chains[2].causes[static_cast<std::size_t>(MissCause::kHeld)] = 5;
    page.chains[2].lately = {.frames = 100, .missed = 2, .p99 = 85ms, .max = 90ms};
    page.chains[2].last_miss = {
        .number = 17, .cause = MissCause::kHeld, .behind = 1, .late = 4ms, .amount = 14ms};
    return page;
}

std::vector<std::string> names(const TopOptions& options) {
    std::vector<std::string> names;
    for (const TopLine& line : top_lines({stack()}, options))
        if (line.look != TopLine::Look::kHead && line.look != TopLine::Look::kProcess)
            names.push_back(line.cells[0]);
    return names;
}

const TopLine& line_of(const std::vector<TopLine>& lines, const std::string& chain) {
    for (const TopLine& line : lines)
        if (line.cells[0] == chain) return line;
    throw std::runtime_error("no line of " + chain);
}

using Names = std::vector<std::string>;

}  // namespace

TEST_CASE("Top orders chains as it is asked to", "[cli][top]") {
    CHECK(names({}) == Names{"radar", "lidar", "camera", "map"});
    CHECK(names({.reverse = true}) == Names{"map", "camera", "lidar", "radar"});
    CHECK(names({.order = TopOrder::kName}) == Names{"camera", "lidar", "map", "radar"});
    CHECK(names({.order = TopOrder::kMissed})[0] == "map");
    CHECK(names({.order = TopOrder::kP99})[0] == "map");
    CHECK(names({.filter = "ar"}) == Names{"radar", "lidar"});
    CHECK(names({.order = TopOrder::kName, .tasks = true, .filter = "map"}) ==
          Names{"map", "  detect"});
}

TEST_CASE("Top's orders have words, and follow each other", "[cli][top]") {
    TopOrder order = TopOrder::kUrgency;
    for (const char* word : {"urgency", "name", "missed", "p99", "held", "urgency"}) {
        CHECK(std::string(cli::to_word(order)) == word);
        CHECK(cli::top_order(word) == order);
        order = cli::next(order);
    }
    CHECK_FALSE(cli::top_order("beauty"));
}

TEST_CASE("Top tells the mode of a chain that has another one than its process", "[cli][top]") {
    PageReading page = stack();
    page.chains[2].mode = abi::StatusMode::kOff;
    CHECK(line_of(top_lines({page}, {}), "map (off)").look == TopLine::Look::kIdle);
    CHECK(cli::top_json({page})["processes"][0]["chains"][2]["mode"] == "off");
    CHECK(cli::top_json({page})["processes"][0]["chains"][1]["mode"] == "enforce");
    page.mode = abi::StatusMode::kObserve;
    CHECK(cli::top_json({page})["processes"][0]["chains"][1]["mode"] == "observe");
    page.mode = abi::StatusMode::kTripped;
    CHECK(cli::top_json({page})["processes"][0]["chains"][1]["mode"] == "tripped");
}

TEST_CASE("Top tells of each chain how it stands", "[cli][top]") {
    const auto lines = top_lines({stack()}, {.tasks = true});
    CHECK(lines[0].cells == cli::top_columns());
    CHECK(lines[1].cells[0] == "42 stack: enforce");
    for (const TopLine& line : lines)
        if (line.look != TopLine::Look::kProcess)
            CHECK(line.cells.size() == cli::top_columns().size());
    const TopLine& lidar = line_of(lines, "lidar");
    CHECK(lidar.look == TopLine::Look::kPlain);
    CHECK(lidar.cells[1] == "gpu");
    CHECK(lidar.cells[3] == "20.0");
    CHECK(lidar.cells[4] == "[##      ]");
    CHECK(lidar.cells[5] == "60 %");
    const TopLine& camera = line_of(lines, "camera");
    CHECK(camera.look == TopLine::Look::kHeld);
    CHECK(camera.cells[6] == "4.0 ms, rank: lidar");
    CHECK(line_of(lines, "radar").look == TopLine::Look::kLate);
    const TopLine& map = line_of(lines, "map");
    CHECK(map.look == TopLine::Look::kIdle);
    CHECK(map.cells[3] == "");
    CHECK(map.cells[9] == "2.5");
    CHECK(map.cells[11] == "85.0");
    CHECK(map.cells[12] == "2.0");
    CHECK(map.cells[13] == "held behind lidar");
    const auto widths = cli::top_widths(lines);
    CHECK(widths[6] == std::string("4.0 ms, rank: lidar").size());
}

TEST_CASE("Top says of a process what it is in, if it is not there", "[cli][top]") {
    PageReading page = stack();
    page.liveness = observe::Liveness::kStopped;
    page.mode = abi::StatusMode::kOff;
    CHECK(top_lines({page}, {})[1].cells[0] == "42 stack: off (stopped)");
    CHECK(top_lines({}, {}).size() == 1);
}

TEST_CASE("Laxity's bar is full at the deadline and empty when it is late", "[cli][top]") {
    CHECK(cli::laxity_bar(80ms, 80ms) == "[########]");
    CHECK(cli::laxity_bar(200ms, 80ms) == "[########]");
    CHECK(cli::laxity_bar(40ms, 80ms) == "[####    ]");
    CHECK(cli::laxity_bar(-40ms, 80ms) == "[        ]");
    CHECK(cli::laxity_bar(40ms, 0ms) == "[        ]");
}

TEST_CASE("Top's JSON answers why a frame was late, and who waits behind whom", "[cli][top]") {
    const auto json = cli::top_json({stack()});
    CHECK(json.at("format_version") == 1);
    const auto& process = json.at("processes").at(0);
    CHECK(process.at("pid") == 42);
    CHECK(process.at("mode") == "enforce");
    const auto& camera = process.at("chains").at(0);
    CHECK(camera.at("deadline_ms") == 80.0);
    CHECK(camera.at("last_miss").is_null());
    const auto& waits = camera.at("tasks").at(0).at("waits");
    CHECK(waits.at("why") == "rank");
    CHECK(waits.at("behind") == "lidar");
    CHECK(waits.at("ms") == 4.0);
    const auto& map = process.at("chains").at(2);
    CHECK(map.at("missed") == 5);
    CHECK(map.at("last_minute").at("p99_ms") == 85.0);
    CHECK(map.at("causes").at(0).at("cause") == "held");
    CHECK(map.at("causes").at(0).at("frames") == 5);
    const auto& miss = map.at("last_miss");
    CHECK(miss.at("frame") == 17);
    CHECK(miss.at("in_words") == "held behind lidar");
    CHECK(miss.at("late_ms") == 4.0);
    CHECK(miss.at("by_cause_ms") == 14.0);
    CHECK_FALSE(map.at("tasks").at(0).contains("laxity_ms"));
}
