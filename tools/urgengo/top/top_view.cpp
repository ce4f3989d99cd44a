// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/top/top_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "host/observe/miss_cause.h"

namespace urgengo::cli {
namespace {

constexpr const char* kOrders[] = {"urgency", "name", "missed", "p99", "held"};
constexpr std::size_t kBar = 8;

double to_ms(nanoseconds time) {
    return 1e-6 * static_cast<double>(time.count());
}

std::string ms(nanoseconds time) {
    return fmt::format("{:.1f}", to_ms(time));
}

double ratio(std::uint64_t part, std::uint64_t of) {
    return of == 0 ? 0 : static_cast<double>(part) / static_cast<double>(of);
}

/// The task that works on the chain's frame; null: none does.
const TaskReading* at(const PageReading& page, const ChainReading& chain) {
    return chain.at < 0 ? nullptr : &page.tasks[static_cast<std::size_t>(chain.at)];
}

const TaskReading* held_task(const PageReading& page, const ChainReading& chain) {
    for (const std::size_t index : chain.tasks)
        if (page.tasks[index].why != abi::Why::kNone) return &page.tasks[index];
    return nullptr;
}

std::string chain_of_task(const PageReading& page, int task) {
    return task < 0 ? "" : page.chains[page.tasks[static_cast<std::size_t>(task)].chain].name;
}

std::string name_of_chain(const PageReading& page, int chain) {
    return chain < 0 ? "" : page.chains[static_cast<std::size_t>(chain)].name;
}

std::string waiting(const PageReading& page, const TaskReading& task) {
    if (task.why == abi::Why::kNone) return "";
    const std::string behind = chain_of_task(page, task.behind);
    return fmt::format("{} ms, {}{}", ms(task.held), to_word(task.why),
                       behind.empty() ? "" : ": " + behind);
}

std::string doing(const TaskReading& task) {
    return task.state == abi::TaskState::kGpu && task.waits_for_gpu ? "gpu, waits"
                                                                    : to_word(task.state);
}

/// How much of what is planned of the task has executed.
std::string executed(const TaskReading& task) {
    if (task.planned_gpu.count() <= 0 || task.state == abi::TaskState::kIdle) return "";
    const double left = to_ms(task.remaining_gpu) / to_ms(task.planned_gpu);
    return fmt::format("{:.0f} %", 100 * std::clamp(1 - left, 0.0, 1.0));
}

bool goes_before(const PageReading& page, const ChainReading& a, const ChainReading& b,
                 TopOrder order) {
    switch (order) {
        case TopOrder::kName:
            return a.name < b.name;
        case TopOrder::kMissed:
            return a.missed > b.missed;
        case TopOrder::kP99:
            return a.lately.p99 > b.lately.p99;
        case TopOrder::kHeld:
            return a.held > b.held;
        case TopOrder::kUrgency:
            break;
    }
    const TaskReading* const task_a = at(page, a);
    const TaskReading* const task_b = at(page, b);
    if (!task_a || !task_b) return task_a && !task_b;
    return task_a->laxity < task_b->laxity;
}

std::vector<const ChainReading*> ordered(const PageReading& page, const TopOptions& options) {
    std::vector<const ChainReading*> chains;
    for (const ChainReading& chain : page.chains)
        if (chain.name.find(options.filter) != std::string::npos) chains.push_back(&chain);
    std::stable_sort(chains.begin(), chains.end(),
                     [&](const ChainReading* a, const ChainReading* b) {
                         return goes_before(page, *a, *b, options.order);
                     });
    if (options.reverse) std::reverse(chains.begin(), chains.end());
    return chains;
}

TopLine chain_line(const PageReading& page, const ChainReading& chain) {
    const TaskReading* const task = at(page, chain);
    const TaskReading* const held = held_task(page, chain);
    TopLine line;
    line.look = !task                      ? TopLine::Look::kIdle
                : task->laxity.count() < 0 ? TopLine::Look::kLate
                : held                     ? TopLine::Look::kHeld
                                           : TopLine::Look::kPlain;
    const abi::StatusMode mode = mode_of(page, chain);
    line.cells = {
        mode == page.mode ? chain.name : fmt::format("{} ({})", chain.name, to_word(mode)),
        task ? doing(*task) : "",
        ms(chain.deadline),
        task ? ms(task->laxity) : "",
        task ? laxity_bar(task->laxity, chain.deadline) : "",
        task ? executed(*task) : "",
        held ? waiting(page, *held) : "",
        std::to_string(chain.instances),
        std::to_string(chain.missed),
        fmt::format("{:.1f}", 100 * ratio(chain.missed, chain.instances)),
        std::to_string(chain.misses_in_a_row),
        chain.lately.frames == 0 ? "" : ms(chain.lately.p99),
        chain.lately.frames == 0
            ? ""
            : fmt::format("{:.1f}", 100 * ratio(chain.lately.missed, chain.lately.frames)),
        chain.last_miss.number == 0
            ? ""
            : observe::in_words(chain.last_miss.cause,
                                name_of_chain(page, chain.last_miss.behind))};
    return line;
}

TopLine task_line(const PageReading& page, const TaskReading& task) {
    TopLine line;
    line.look = TopLine::Look::kTask;
    line.cells.resize(top_columns().size());
    line.cells[0] = "  " + task.name;
    if (task.state == abi::TaskState::kIdle) return line;
    line.cells[1] = doing(task);
    line.cells[3] = ms(task.laxity);
    line.cells[5] = executed(task);
    line.cells[6] = waiting(page, task);
    return line;
}

const char* guard_word(std::uint32_t guard) {
    constexpr const char* kWords[] = {"enforce", "priorities", "observe"};
    return guard < std::size(kWords) ? kWords[guard] : "unknown";
}

nlohmann::ordered_json causes_json(const ChainReading& chain) {
    auto causes = nlohmann::ordered_json::array();
    for (std::size_t i = 0; i < observe::kNumCauses; ++i)
        if (chain.causes[i] > 0)
            causes.push_back({{"cause", observe::to_word(static_cast<abi::MissCause>(i))},
                              {"frames", chain.causes[i]}});
    return causes;
}

nlohmann::ordered_json last_miss_json(const PageReading& page, const ChainReading& chain) {
    const ChainReading::Miss& miss = chain.last_miss;
    if (miss.number == 0) return nullptr;
    const std::string behind = name_of_chain(page, miss.behind);
    return {{"frame", miss.number},
            {"cause", observe::to_word(miss.cause)},
            {"behind", behind},
            {"in_words", observe::in_words(miss.cause, behind)},
            {"late_ms", to_ms(miss.late)},
            {"by_cause_ms", to_ms(miss.amount)}};
}

nlohmann::ordered_json task_json(const PageReading& page, const TaskReading& task) {
    nlohmann::ordered_json json = {{"name", task.name},
                                   {"state", to_word(task.state)},
                                   {"waits_for_gpu", task.waits_for_gpu},
                                   {"planned_gpu_ms", to_ms(task.planned_gpu)}};
    if (task.state != abi::TaskState::kIdle) {
        json["laxity_ms"] = to_ms(task.laxity);
        json["remaining_gpu_ms"] = to_ms(task.remaining_gpu);
        json["launched_ms"] = to_ms(task.launched);
    }
    if (task.why != abi::Why::kNone)
        json["waits"] = {{"why", to_word(task.why)},
                         {"behind", chain_of_task(page, task.behind)},
                         {"ms", to_ms(task.held)}};
    return json;
}

nlohmann::ordered_json chain_json(const PageReading& page, const ChainReading& chain) {
    nlohmann::ordered_json json = {{"name", chain.name},
                                   {"period_ms", to_ms(chain.period)},
                                   {"deadline_ms", to_ms(chain.deadline)},
                                   {"mode", to_word(mode_of(page, chain))},
                                   {"guard", guard_word(chain.guard)},
                                   {"frames", chain.instances},
                                   {"finished", chain.finished},
                                   {"missed", chain.missed},
                                   {"exited", chain.exited},
                                   {"misses_in_a_row", chain.misses_in_a_row},
                                   {"most_misses_in_a_row", chain.most_misses_in_a_row},
                                   {"late_starts", chain.late_starts},
                                   {"latency_max_ms", to_ms(chain.latency_max)},
                                   {"last_minute",
                                    {{"frames", chain.lately.frames},
                                     {"missed", chain.lately.missed},
                                     {"median_ms", to_ms(chain.lately.median)},
                                     {"p99_ms", to_ms(chain.lately.p99)},
                                     {"max_ms", to_ms(chain.lately.max)}}},
                                   {"launches", chain.launches},
                                   {"holds", chain.holds},
                                   {"held_ms", to_ms(chain.held)},
                                   {"paced_ms", to_ms(chain.paced)},
                                   {"would_hold", chain.would_hold},
                                   {"would_held_ms", to_ms(chain.would_held)},
                                   {"would_wait_for", name_of_chain(page, chain.would_behind)},
                                   {"causes", causes_json(chain)},
                                   {"last_miss", last_miss_json(page, chain)}};
    json["tasks"] = nlohmann::ordered_json::array();
    for (const std::size_t index : chain.tasks)
        json["tasks"].push_back(task_json(page, page.tasks[index]));
    return json;
}

}  // namespace

const char* to_word(TopOrder order) {
    return kOrders[static_cast<std::size_t>(order)];
}

std::optional<TopOrder> top_order(std::string_view word) {
    for (std::size_t i = 0; i < std::size(kOrders); ++i)
        if (word == kOrders[i]) return static_cast<TopOrder>(i);
    return std::nullopt;
}

TopOrder next(TopOrder order) {
    return static_cast<TopOrder>((static_cast<std::size_t>(order) + 1) % std::size(kOrders));
}

const std::vector<std::string>& top_columns() {
    static const std::vector<std::string> columns = {
        "chain",  "does",   "deadline", "laxity", "",         "done",   "waits",
        "frames", "missed", "%",        "in row", "p99 1min", "% 1min", "last miss"};
    return columns;
}

std::vector<TopLine> top_lines(const std::vector<PageReading>& pages, const TopOptions& options) {
    std::vector<TopLine> lines{{TopLine::Look::kHead, top_columns()}};
    for (const PageReading& page : pages) {
        const std::string state = page.liveness == observe::Liveness::kThere
                                      ? ""
                                      : fmt::format(" ({})", to_word(page.liveness));
        lines.push_back({TopLine::Look::kProcess,
                         {fmt::format("{} {}: {}{}", page.process.process, page.program,
                                      to_word(page.mode), state)}});
        for (const ChainReading* chain : ordered(page, options)) {
            lines.push_back(chain_line(page, *chain));
            if (!options.tasks) continue;
            for (const std::size_t task : chain->tasks)
                lines.push_back(task_line(page, page.tasks[task]));
        }
    }
    return lines;
}

std::vector<std::size_t> top_widths(const std::vector<TopLine>& lines) {
    std::vector<std::size_t> widths(top_columns().size());
    for (const TopLine& line : lines)
        for (std::size_t i = 0; line.cells.size() > 1 && i < line.cells.size(); ++i)
            widths[i] = std::max(widths[i], line.cells[i].size());
    return widths;
}

std::string laxity_bar(nanoseconds laxity, nanoseconds deadline) {
    const double left = deadline.count() <= 0 ? 0
                                              : static_cast<double>(laxity.count()) /
                                                    static_cast<double>(deadline.count());
    const auto full = static_cast<std::size_t>(std::clamp(left, 0.0, 1.0) * kBar + 0.5);
    return "[" + std::string(full, '#') + std::string(kBar - full, ' ') + "]";
}

nlohmann::ordered_json top_json(const std::vector<PageReading>& pages) {
    nlohmann::ordered_json root = {{"format_version", 1}};
    root["processes"] = nlohmann::ordered_json::array();
    for (const PageReading& page : pages) {
        nlohmann::ordered_json json = {{"pid", page.process.process},
                                       {"program", page.program},
                                       {"process", to_word(page.liveness)},
                                       {"mode", to_word(page.mode)},
                                       {"held_now", page.held_now}};
        json["chains"] = nlohmann::ordered_json::array();
        for (const ChainReading& chain : page.chains)
            json["chains"].push_back(chain_json(page, chain));
        root["processes"].push_back(std::move(json));
    }
    return root;
}

}  // namespace urgengo::cli
