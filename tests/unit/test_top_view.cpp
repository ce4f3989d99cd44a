// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/top/top_view.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "tests/support/catch.h"
#include "tools/urgengo/top/collisions.h"
#include "tools/urgengo/top/kernel_name.h"
#include "tools/urgengo/top/top_rates.h"

using namespace urgengo;
using namespace std::chrono_literals;
using abi::MissCause;
using cli::ChainReading;
using cli::colliding_chains;
using cli::Collisions;
using cli::PageReading;
using cli::TaskReading;
using cli::top_json;
using cli::top_lines;
using cli::TopColumn;
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
    page.tasks[1].num_kernels = 345;
    page.tasks[1].kernel = 12;
    page.tasks[1].kernel_name = "_ZN3lib4gemmIfEEvPT_";
    page.tasks[1].priority = -5;
    page.tasks[1].factor = 1.25;
    page.tasks[0].why = abi::Why::kRank;
    page.tasks[0].behind = 1;
    page.tasks[0].held = 4ms;
    page.chains[2].instances = 200;
    page.chains[2].finished = 180;  // others were replaced by their next
    page.chains[2].missed = 5;
    page.chains[2].causes[static_cast<std::size_t>(MissCause::kHeld)] = 3;
    page.chains[2].causes[static_cast<std::size_t>(MissCause::kCpuLonger)] = 2;
    page.chains[2].guard = 1;
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

const std::string& cell(const TopLine& line, TopColumn column) {
    return line.cells.at(static_cast<std::size_t>(column));
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
    CHECK(lines[0].cells == cli::top_heads());
    CHECK(lines[1].cells[0] == "42 stack: enforce");
    for (const TopLine& line : lines)
        if (line.look != TopLine::Look::kProcess) CHECK(line.cells.size() == cli::kNumTopColumns);
    const TopLine& lidar = line_of(lines, "lidar");
    CHECK(lidar.look == TopLine::Look::kPlain);
    CHECK(cell(lidar, TopColumn::kDoes) == "gpu");
    CHECK(cell(lidar, TopColumn::kLaxity) == "20.0");
    CHECK(cell(lidar, TopColumn::kBar) == "[##      ]");
    CHECK(cell(lidar, TopColumn::kDone) == "60 %");
    CHECK(cell(lidar, TopColumn::kKernel) == "12/345");
    CHECK(cell(lidar, TopColumn::kName) == "gemm");
    CHECK(cell(lidar, TopColumn::kPriority) == "-5");
    CHECK(cell(lidar, TopColumn::kGuard) == "enforce");
    const TopLine& camera = line_of(lines, "camera");
    CHECK(camera.look == TopLine::Look::kHeld);
    CHECK(cell(camera, TopColumn::kWaits) == "4.0 ms, rank: lidar");
    CHECK(cell(camera, TopColumn::kKernel) == "");
    CHECK(line_of(lines, "radar").look == TopLine::Look::kLate);
    const TopLine& map = line_of(lines, "map");
    CHECK(map.look == TopLine::Look::kIdle);
    CHECK(cell(map, TopColumn::kLaxity) == "");
    CHECK(cell(map, TopColumn::kMissedShare) == "2.5");
    CHECK(cell(map, TopColumn::kP99) == "85.0");
    CHECK(cell(map, TopColumn::kLately) == "2.0");
    CHECK(cell(map, TopColumn::kGuard) == "priorities");
    CHECK(cell(map, TopColumn::kLastMiss) == "held behind lidar");
    CHECK(cell(map, TopColumn::kCauses) == "held 3, cpu_longer 2");
    const auto widths = cli::top_widths(lines);
    CHECK(widths[static_cast<std::size_t>(TopColumn::kWaits)] ==
          std::string("4.0 ms, rank: lidar").size());
}

TEST_CASE("Top says of a process what it is in, if it is not there", "[cli][top]") {
    PageReading page = stack();
    page.liveness = observe::Liveness::kStopped;
    page.mode = abi::StatusMode::kOff;
    CHECK(top_lines({page}, {})[1].cells[0] == "42 stack: off (stopped)");
    CHECK(top_lines({}, {}).size() == 1);
}

TEST_CASE("Top's JSON tells the kernel, its priority, the dispatcher and what all of it takes",
          "[cli][top]") {
    PageReading page = stack();
    page.dispatcher = {
        .gates = 9, .closed = 2, .opened_by_gpu = 4, .gpu_rounds = 100, .gpu_round = 12us};
    auto process = cli::top_json({page}).at("processes").at(0);
    CHECK_FALSE(process.contains("cores"));
    CHECK_FALSE(process.contains("overhead"));
    CHECK(process.at("dispatcher").at("gates") == 9);
    CHECK(process.at("dispatcher").at("closed") == 2);
    CHECK(process.at("dispatcher").at("opened_by_gpu") == 4);
    CHECK(process.at("dispatcher").at("gpu_rounds") == 100);
    CHECK(process.at("dispatcher").at("gpu_round_us") == 12.0);
    const auto& task = process.at("chains").at(1).at("tasks").at(0);
    CHECK(task.at("kernel") == 12);
    CHECK(task.at("kernels") == 345);
    CHECK(task.at("kernel_name") == "_ZN3lib4gemmIfEEvPT_");
    CHECK(task.at("priority") == -5);
    CHECK(task.at("estimate_factor") == 1.25);
    const auto& camera = process.at("chains").at(0).at("tasks").at(0);
    CHECK_FALSE(camera.contains("kernel"));
    CHECK_FALSE(camera.contains("priority"));
    page.cores = 1.25;
    page.overhead = 0.004;
    process = cli::top_json({page}).at("processes").at(0);
    CHECK(process.at("cores") == 1.25);
    CHECK(process.at("overhead") == 0.004);
    CHECK(top_lines({page}, {})[1].cells[0] ==
          "42 stack: enforce, 1.2 cores, holds take 0.4 %, 2 of 9 gates closed, 100 rounds of the "
          "GPU");
}

TEST_CASE("Top shows on 80 columns what tells of the moment, and more where there is room",
          "[cli][top]") {
    const auto lines = top_lines({stack()}, {});
    const auto widths = cli::top_widths(lines);
    const auto shown = cli::columns_that_fit(widths, 80);
    for (const TopColumn column : {TopColumn::kChain, TopColumn::kDoes, TopColumn::kLaxity,
                                   TopColumn::kKernel, TopColumn::kWaits, TopColumn::kMissed})
        CHECK(std::count(shown.begin(), shown.end(), column) == 1);
    CHECK(std::is_sorted(shown.begin(), shown.end()));
    for (const TopLine& line : lines) CHECK(cli::top_text(line, widths, shown).size() <= 80);
    CHECK(cli::columns_that_fit(widths, 1000).size() == cli::kNumTopColumns);
    CHECK(cli::columns_that_fit(widths, 3) == std::vector<TopColumn>{TopColumn::kChain});
    CHECK(cli::top_text(line_of(lines, "lidar"), widths,
                        {TopColumn::kChain, TopColumn::kLaxity, TopColumn::kName}) ==
          "lidar    20.0 gemm");
}

TEST_CASE("Kernel's name is shown without what is around it", "[cli][top]") {
    for (const auto& [name, is_shown] :
         {std::pair{"_Z6vecaddPKfS0_Pf", "vecadd"}, std::pair{"_ZN3lib4gemmIfEEvPT_", "gemm"},
          std::pair{"_ZN7cutlass6KernelINS_4gemm6kernel4Gem", "Kernel"},
          std::pair{"_ZN3lib30elementwise_kernel_wi", "elementwise_kernel_wi"},
          std::pair{"_ZSt4fillv", "fill"}, std::pair{"ampere_sgemm_32x32", "ampere_sgemm_32x32"},
          std::pair{"_Z", "_Z"}, std::pair{"_ZN", "_ZN"}, std::pair{"_Z9999", "_Z9999"},
          std::pair{"(graph of 3 kernels)", "(graph of 3 kernels)"}, std::pair{"", ""}})
        CHECK(cli::short_kernel_name(name) == is_shown);
}

TEST_CASE("Top's rates are between two looks, and of processes that are here", "[cli][top]") {
    std::vector<PageReading> pages{stack()};
    pages[0].began = 10s;
    pages[0].looks = 1s;
    std::optional<double> cpu_s = 100;
    cli::TopRates rates([&](std::uint32_t process) {
        CHECK(process == 42);
        return cpu_s;
    });
    rates.set(pages, 20s);
    CHECK_FALSE(pages[0].cores);
    CHECK(pages[0].overhead == Approx(0.1));  // since it began
    cpu_s = 101;
    pages[0].looks = 1s + 100ms;
    rates.set(pages, 20s + 500ms);
    CHECK(pages[0].cores == Approx(2));
    CHECK(pages[0].overhead == Approx(0.2));
    // From now on since a second ago.
    for (int i = 0; i < 10; ++i) rates.set(pages, 21s + i * 500ms);
    CHECK(pages[0].cores == 0);
    CHECK(pages[0].overhead == 0);
    pages[0].cores.reset();
    cpu_s.reset();
    rates.set(pages, 26s);
    CHECK_FALSE(pages[0].cores);
    pages[0].liveness = observe::Liveness::kElsewhere;  // another process has this number here
    cpu_s = 200;
    rates.set(pages, 27s);
    CHECK_FALSE(pages[0].cores);
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
    CHECK(map.at("causes").at(1).at("cause") == "held");
    CHECK(map.at("causes").at(1).at("frames") == 3);
    CHECK(map.at("guard") == "priorities");
    const auto& miss = map.at("last_miss");
    CHECK(miss.at("frame") == 17);
    CHECK(miss.at("in_words") == "held behind lidar");
    CHECK(miss.at("late_ms") == 4.0);
    CHECK(miss.at("by_cause_ms") == 14.0);
    CHECK_FALSE(map.at("tasks").at(0).contains("laxity_ms"));
}

TEST_CASE("Top tells how often chains collide, by looks of the last minute", "[cli][top]") {
    PageReading page;
    page.tasks.resize(3);
    page.chains.resize(3);
    for (std::size_t i = 0; i < 3; ++i) {
        TaskReading& task = page.tasks[i];
        task.chain = i;
        task.state = abi::TaskState::kGpu;
        task.deadline = (10 + i) * 1ms;
        task.priority = -5 + static_cast<int>(i);
        page.chains[i].tasks = {i};
    }
    using Which = std::vector<bool>;
    CHECK(colliding_chains(page) == Which{false, false, false});
    page.tasks[2].priority = -4;  // as the second, which has the earlier deadline
    CHECK(colliding_chains(page) == Which{false, true, true});
    page.tasks[1].state = abi::TaskState::kHeld;
    CHECK(colliding_chains(page) == Which{false, false, false});
    page.tasks[1].state = abi::TaskState::kGpu;
    page.tasks[2].priority.reset();  // it has launched nothing yet
    CHECK(colliding_chains(page) == Which{false, false, false});

    Collisions collisions;
    for (int i = 0; i < 10; ++i) {
        page.tasks[2].priority = i < 3 ? -4 : -3;
        collisions.looked(page, 100s + i * 1s);
    }
    std::vector<PageReading> pages{page};
    collisions.set(pages, 110s);
    CHECK(pages[0].chains[1].collisions.looks == 10);
    CHECK(pages[0].chains[1].collisions.collided == 3);
    CHECK(pages[0].chains[0].collisions.collided == 0);
    const auto lines = top_lines(pages, {});
    CHECK(lines[2].cells[static_cast<std::size_t>(TopColumn::kCollides)] != "");
    const auto json = top_json(pages).at("processes").at(0).at("chains").at(1);
    CHECK(json.at("collisions").at("looks") == 10);
    CHECK(json.at("collisions").at("collided") == 3);
    pages = {page};
    collisions.set(pages, 162s);  // those of the first two seconds are a minute old
    CHECK(pages[0].chains[1].collisions.looks == 7);
    CHECK(pages[0].chains[1].collisions.collided == 0);
    pages.clear();
    collisions.set(pages, 163s);
    pages = {page};
    collisions.set(pages, 163s);
    CHECK(pages[0].chains[1].collisions.looks == 0);  // it was gone meanwhile
}
