// SPDX-License-Identifier: Apache-2.0
//
// The report of `urgengo check`.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host/config/kernel_pattern.h"
#include "tools/discover/claims.h"
#include "tools/discover/names.h"

namespace urgengo::discover {
namespace {

constexpr std::size_t kMaxListed = 12;
constexpr std::size_t kMaxKernels = 3;
constexpr std::size_t kMaxNameShown = 60;
constexpr double kPeriodTolerance = 0.1;
constexpr double kNsPerMs = 1e6;

std::string shown(std::string_view text) {
    const std::string name = printable(text);
    return name.size() <= kMaxNameShown ? name : name.substr(0, kMaxNameShown - 3) + "...";
}

/// "name (amount), ..." of the greatest.
template <typename T, typename Amount>
std::string listed(const std::map<std::string, T>& entries, std::size_t max, Amount amount) {
    std::vector<std::pair<T, std::string>> order;
    for (const auto& [name, value] : entries) order.emplace_back(value, name);
    std::sort(order.begin(), order.end(), [](const auto& a, const auto& b) {
        return a.first != b.first ? a.first > b.first : a.second < b.second;
    });
    std::string text;
    for (std::size_t i = 0; i < std::min(order.size(), max); ++i) {
        text += (i == 0 ? "" : ", ") + shown(order[i].second) + " (" + amount(order[i].first) + ")";
    }
    if (order.size() > max) text += fmt::format(" and {} more", order.size() - max);
    return text.empty() ? "none" : text;
}

std::string launches_text(std::size_t count) {
    return std::to_string(count);
}

std::string ms_text(std::int64_t ns) {
    return fmt::format("{:.3g} ms", static_cast<double>(ns) / kNsPerMs);
}

class Report {
  public:
    Report(const config::Config& config, const Claims& claims) : claims_(claims) {
        for (const config::Chain& chain : config.chains) {
            for (const config::Task& task : chain.tasks) tasks_.push_back(&task);
        }
    }

    std::string run() {
        table();
        doubles();
        unmatched();
        unexplained();
        return std::move(text_);
    }

  private:
    template <typename... T>
    void line(fmt::format_string<T...> format, T&&... values) {
        std::string text = fmt::format(format, std::forward<T>(values)...);
        text.erase(text.find_last_not_of(' ') + 1);
        text_ += text + "\n";
    }

    std::string share(std::int64_t gpu_ns) const {
        const auto total = static_cast<double>(claims_.total_gpu_ns);
        return fmt::format("{:.1f}", total > 0 ? 100 * static_cast<double>(gpu_ns) / total : 0);
    }

    std::string name(std::size_t task) const {
        return shown(claims_.tasks[task].chain) + "/" + shown(claims_.tasks[task].name);
    }

    void table() {
        std::size_t width = 4;
        for (std::size_t i = 0; i < claims_.tasks.size(); ++i) {
            width = std::max(width, name(i).size());
        }
        line("{:<{}} {:>9} {:>10} {:>6} {:>7} {:>10} {:>10}  {}", "task", width, "launches",
             "GPU ms", "GPU %", "frames", "every ms", "period_ms", "matched by");
        for (std::size_t i = 0; i < claims_.tasks.size(); ++i) {
            const TaskClaims& task = claims_.tasks[i];
            line("{:<{}} {:>9} {:>10.2f} {:>6} {:>7} {:>10} {:>10.4g}  {}", name(i), width,
                 task.launches, static_cast<double>(task.gpu_ns) / kNsPerMs, share(task.gpu_ns),
                 task.instances.instances.size(), every(task),
                 static_cast<double>(task.period.count()) / kNsPerMs, matched(task));
        }
    }

    static bool is_off(const TaskClaims& task) {
        const auto period = static_cast<double>(task.period.count());
        const auto seen = static_cast<double>(task.instances.period_ns);
        return seen > 0 && std::abs(seen - period) > kPeriodTolerance * period;
    }

    /// The measured period, with a mark if it is not the config's.
    static std::string every(const TaskClaims& task) {
        if (task.instances.period_ns == 0) return "-";
        return fmt::format("{}{:.4g}", is_off(task) ? "!" : "",
                           static_cast<double>(task.instances.period_ns) / kNsPerMs);
    }

    static std::string matched(const TaskClaims& task) {
        std::string text;
        for (std::size_t by = 0; by < task.by.size(); ++by) {
            if (task.by[by] == 0) continue;
            text += (text.empty() ? "" : ", ") +
                    std::string(matched_by_name(static_cast<MatchedBy>(by)));
            if (task.by[by] < task.launches) text += fmt::format(" ({})", task.by[by]);
        }
        return text.empty() ? "NOTHING" : text;
    }

    void doubles() {
        if (claims_.doubles.empty()) return;
        line("");
        line("Claimed by two tasks:");
        for (const auto& [tasks, count] : claims_.doubles) {
            line("  {} launches of {} fit the rules of {}, too", count,
                 name(static_cast<std::size_t>(tasks.first)),
                 name(static_cast<std::size_t>(tasks.second)));
        }
    }

    /// What was seen, for rules of the kinds that the task has.
    void unmatched() {
        for (std::size_t i = 0; i < claims_.tasks.size(); ++i) {
            if (claims_.tasks[i].launches > 0) continue;
            const config::Task& task = *tasks_[i];
            line("");
            line("Nothing matched {}:", name(i));
            if (!task.thread_glob.empty()) {
                line("  thread: found {}, accepted: {}",
                     listed(claims_.thread_names, kMaxListed, launches_text),
                     shown(task.thread_glob));
            }
            if (!task.nvtx_glob.empty()) {
                line("  nvtx: found {}, accepted: {}",
                     listed(claims_.range_names, kMaxListed, launches_text), shown(task.nvtx_glob));
            }
            for (const config::KernelPattern& pattern : task.kernels) {
                line("  kernels: found first {}, accepted: {}",
                     listed(claims_.first_kernels, kMaxListed, launches_text),
                     shown(config::to_text(pattern)));
            }
            if (task.thread_glob.empty() && task.nvtx_glob.empty() && task.kernels.empty()) {
                line("  it has no rule, and no hint named it");
            }
        }
    }

    void unexplained() {
        std::int64_t sum = 0;
        for (const auto& [thread, group] : claims_.unexplained) sum += group.gpu_ns;
        line("");
        if (claims_.total_gpu_ns == 0) return line("No GPU time is known: no kernel was timed.");
        if (claims_.unexplained.empty()) return line("All GPU time is explained.");
        line("GPU time that no task explains: {}, {} % of all", ms_text(sum), share(sum));
        for (const auto& [thread, group] : claims_.unexplained) {
            line("  threads named '{}': {} launches, {}, {} %: {}", shown(thread), group.launches,
                 ms_text(group.gpu_ns), share(group.gpu_ns),
                 listed(group.kernels, kMaxKernels, ms_text));
        }
    }

    const Claims& claims_;
    std::vector<const config::Task*> tasks_;
    std::string text_;
};

}  // namespace

std::string format_claims(const config::Config& config, const Claims& claims) {
    return Report(config, claims).run();
}

}  // namespace urgengo::discover
