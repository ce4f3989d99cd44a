// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/top/top_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "host/observe/miss_cause.h"
#include "tools/urgengo/top/kernel_name.h"
#include "tools/urgengo/top/page_words.h"

namespace urgengo::cli {
namespace {

constexpr const char* kOrders[] = {"urgency", "name", "missed", "p99", "held"};
constexpr std::size_t kBar = 8, kMostName = 24;

std::string ms(nanoseconds time) {
    return fmt::format("{:.1f}", in_ms(time));
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
    const double left = in_ms(task.remaining_gpu) / in_ms(task.planned_gpu);
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

/// "12/345": the launch that the GPU is at, of those that are planned.
std::string position(const TaskReading& task) {
    return task.kernel == 0 ? "" : fmt::format("{}/{}", task.kernel, task.num_kernels);
}

std::string priority(const TaskReading& task) {
    return task.priority ? std::to_string(*task.priority) : "";
}

/// "held 4, gpu_longer 1", the most frequent first.
std::string causes(const ChainReading& chain) {
    std::vector<std::pair<std::uint64_t, abi::MissCause>> counted;
    for (std::size_t i = 0; i < observe::kNumCauses; ++i)
        if (chain.causes[i] > 0)
            counted.emplace_back(chain.causes[i], static_cast<abi::MissCause>(i));
    std::stable_sort(counted.begin(), counted.end(),
                     [](const auto& a, const auto& b) { return a.first > b.first; });
    std::string text;
    for (const auto& [frames, cause] : counted)
        text += fmt::format("{}{} {}", text.empty() ? "" : ", ", observe::to_word(cause), frames);
    return text;
}

std::string& cell(TopLine& line, TopColumn column) {
    return line.cells[static_cast<std::size_t>(column)];
}

/// What a task does, of its chain's line or of its own.
void add_work(TopLine& line, const TaskReading& task) {
    cell(line, TopColumn::kDoes) = doing(task);
    cell(line, TopColumn::kLaxity) = ms(task.laxity);
    cell(line, TopColumn::kDone) = executed(task);
    cell(line, TopColumn::kKernel) = position(task);
    cell(line, TopColumn::kName) = short_kernel_name(task.kernel_name).substr(0, kMostName);
    cell(line, TopColumn::kPriority) = priority(task);
}

TopLine chain_line(const PageReading& page, const ChainReading& chain) {
    const TaskReading* const task = at(page, chain);
    const TaskReading* const held = held_task(page, chain);
    TopLine line;
    line.look = !task                      ? TopLine::Look::kIdle
                : task->laxity.count() < 0 ? TopLine::Look::kLate
                : held                     ? TopLine::Look::kHeld
                                           : TopLine::Look::kPlain;
    line.cells.resize(kNumTopColumns);
    const abi::StatusMode mode = mode_of(page, chain);
    cell(line, TopColumn::kChain) =
        mode == page.mode ? chain.name : fmt::format("{} ({})", chain.name, to_word(mode));
    cell(line, TopColumn::kDeadline) = ms(chain.deadline);
    if (task) {
        add_work(line, *task);
        cell(line, TopColumn::kBar) = laxity_bar(task->laxity, chain.deadline);
    }
    if (held) cell(line, TopColumn::kWaits) = waiting(page, *held);
    cell(line, TopColumn::kFrames) = std::to_string(chain.instances);
    cell(line, TopColumn::kMissed) = std::to_string(chain.missed);
    cell(line, TopColumn::kMissedShare) =
        fmt::format("{:.1f}", 100 * ratio(chain.missed, chain.instances));
    cell(line, TopColumn::kInRow) = std::to_string(chain.misses_in_a_row);
    if (chain.lately.frames > 0) {
        cell(line, TopColumn::kP99) = ms(chain.lately.p99);
        cell(line, TopColumn::kLately) =
            fmt::format("{:.1f}", 100 * ratio(chain.lately.missed, chain.lately.frames));
    }
    if (const auto& seen = chain.collisions; seen.looks > 0)
        cell(line, TopColumn::kCollides) =
            fmt::format("{:.1f}", 100 * ratio(seen.collided, seen.looks));
    cell(line, TopColumn::kGuard) = guard_word(chain.guard);
    if (chain.last_miss.number > 0)
        cell(line, TopColumn::kLastMiss) =
            observe::in_words(chain.last_miss.cause, name_of_chain(page, chain.last_miss.behind),
                              chain.last_miss.detail);
    cell(line, TopColumn::kCauses) = causes(chain);
    return line;
}

TopLine task_line(const PageReading& page, const TaskReading& task) {
    TopLine line;
    line.look = TopLine::Look::kTask;
    line.cells.resize(kNumTopColumns);
    cell(line, TopColumn::kChain) = "  " + task.name;
    if (task.state == abi::TaskState::kIdle) return line;
    add_work(line, task);
    cell(line, TopColumn::kWaits) = waiting(page, task);
    return line;
}

/// "42 stack: enforce, 1.3 cores, 0.4 % of a core for holds, 2 gates closed".
std::string process_words(const PageReading& page) {
    std::string text =
        fmt::format("{} {}: {}", page.process.process, page.program, to_word(page.mode));
    if (page.liveness != observe::Liveness::kThere)
        text += fmt::format(" ({})", to_word(page.liveness));
    if (page.cores) text += fmt::format(", {:.1f} cores", *page.cores);
    if (page.overhead) text += fmt::format(", holds take {:.1f} %", 100 * *page.overhead);
    const PageReading::Dispatcher& dispatcher = page.dispatcher;
    if (dispatcher.gates > 0)
        text += fmt::format(", {} of {} gates closed", dispatcher.closed, dispatcher.gates);
    if (dispatcher.gpu_rounds > 0)
        text += fmt::format(", {} rounds of the GPU", dispatcher.gpu_rounds);
    return text;
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

std::vector<TopLine> top_lines(const std::vector<PageReading>& pages, const TopOptions& options) {
    std::vector<TopLine> lines{{TopLine::Look::kHead, top_heads()}};
    for (const PageReading& page : pages) {
        lines.push_back({TopLine::Look::kProcess, {process_words(page)}});
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
    std::vector<std::size_t> widths(kNumTopColumns);
    for (const TopLine& line : lines)
        for (std::size_t i = 0; line.cells.size() > 1 && i < line.cells.size(); ++i)
            widths[i] = std::max(widths[i], line.cells[i].size());
    return widths;
}

std::string top_text(const TopLine& line, const std::vector<std::size_t>& widths,
                     const std::vector<TopColumn>& shown) {
    if (line.cells.size() <= 1) return line.cells.empty() ? "" : line.cells[0];
    std::string text;
    for (const TopColumn column : shown) {
        const auto i = static_cast<std::size_t>(column);
        text += top_columns()[i].is_left ? fmt::format("{:<{}} ", line.cells[i], widths[i])
                                         : fmt::format("{:>{}} ", line.cells[i], widths[i]);
    }
    text.erase(text.find_last_not_of(' ') + 1);
    return text;
}

std::string laxity_bar(nanoseconds laxity, nanoseconds deadline) {
    const double left = deadline.count() <= 0 ? 0
                                              : static_cast<double>(laxity.count()) /
                                                    static_cast<double>(deadline.count());
    const auto full = static_cast<std::size_t>(std::clamp(left, 0.0, 1.0) * kBar + 0.5);
    return "[" + std::string(full, '#') + std::string(kBar - full, ' ') + "]";
}

}  // namespace urgengo::cli
