// SPDX-License-Identifier: Apache-2.0
#include "tools/discover/draft.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <string_view>

#include "host/config/kernel_pattern.h"
#include "host/config/limits.h"
#include "tools/discover/follows.h"
#include "tools/discover/names.h"

namespace urgengo::discover {
namespace {

using trace::Instance;
using trace::Segment;

constexpr double kNsPerMs = 1e6;
constexpr std::size_t kMaxListed = 3;  // kernels, ranges, names in one comment
constexpr std::size_t kMaxNameShown = 60;
constexpr double kNoPause =
    0.02;  // idle for less of its period, an activity only waits for the GPU

std::string shown(std::string_view text) {
    const std::string name = printable(text);
    return name.size() <= kMaxNameShown ? name : name.substr(0, kMaxNameShown - 3) + "...";
}

std::string ms(double ns) {
    return fmt::format("{:.4g}", ns / kNsPerMs);
}

std::string spread_text(const Spread& spread) {
    return fmt::format("{} to {}", ms(spread.low), ms(spread.high));
}

/// The `kMaxListed` greatest, "name (1.2), ...", with how many more there are.
std::string listed(const std::map<std::string, double>& amounts, const char* format) {
    std::vector<std::pair<double, std::string>> order;
    for (const auto& [name, amount] : amounts) order.emplace_back(-amount, name);
    std::sort(order.begin(), order.end());
    std::string text;
    for (std::size_t i = 0; i < std::min(order.size(), kMaxListed); ++i) {
        text += (i == 0 ? "" : ", ") + shown(order[i].second) +
                fmt::format(fmt::runtime(format), -order[i].first);
    }
    if (order.size() > kMaxListed) text += fmt::format(" and {} more", order.size() - kMaxListed);
    return text;
}

/// What the comments say about one activity.
struct Facts {
    std::map<std::string, double> thread_names;  // launches
    std::set<std::uint64_t> streams;
    std::map<std::string, double> kernels;  // GPU time, ms per frame
    std::map<std::string, double> closed_by, ranges;
    Spread launches, segments, gpu_ns;
    double total_gpu_ns = 0;
    std::size_t num_timed = 0, num_launches = 0;
};

Facts collect(const Observation& seen, const Activity& activity) {
    Facts facts;
    std::vector<double> launches, segments, gpu;
    const auto num_frames = static_cast<double>(activity.frames.size());
    for (const Instance& frame : activity.frames) {
        double frame_gpu_ns = 0;
        for (const Segment& segment : frame.segments) {
            ++facts.closed_by[std::string(segment.closed_by_name())];
            for (std::size_t i = 0; i < segment.num_launches; ++i) {
                const std::size_t index = segment.first_launch + i;
                const trace::TraceRecord& launch = seen.launch(segment.thread, index);
                const auto gpu_ns = static_cast<double>(seen.gpu_ns(segment.thread, index));
                frame_gpu_ns += gpu_ns;
                facts.num_timed += seen.gpu[segment.thread][index].known ? 1 : 0;
                ++facts.num_launches;
                ++facts.thread_names[std::string(seen.thread_name(segment.thread, index))];
                facts.streams.insert(launch.launch.stream);
                const std::string name = trace::launch_name(seen.trace, launch);
                facts.kernels[short_kernel_name(name)] += gpu_ns / kNsPerMs / num_frames;
                for (const std::uint64_t range : seen.ranges[segment.thread].at(index)) {
                    ++facts.ranges[std::string(seen.trace.text(range))];
                }
            }
        }
        launches.push_back(static_cast<double>(frame.num_launches));
        segments.push_back(static_cast<double>(frame.segments.size()));
        gpu.push_back(frame_gpu_ns);
        facts.total_gpu_ns += frame_gpu_ns;
    }
    facts.launches = spread_of(launches);
    facts.segments = spread_of(segments);
    facts.gpu_ns = spread_of(gpu);
    return facts;
}

std::string keys_of(const std::map<std::string, double>& counts, const char* before_each = "") {
    std::string text;
    for (const auto& [name, count] : counts) {
        text += (text.empty() ? "" : ", ") + std::string(before_each) + shown(name) + before_each;
    }
    return text;
}

class Writer {
  public:
    Writer(const Observation& seen, const Activities& activities, const std::vector<Rule>& rules)
        : seen_(seen), activities_(activities), rules_(rules) {
        total_gpu_ns_ = static_cast<double>(seen.total_gpu_ns());
        std::int64_t first_ns = INT64_MAX, last_ns = INT64_MIN;
        for (const auto& launches : seen.gpu) {
            for (const trace::GpuInterval& interval : launches) {
                first_ns = std::min(first_ns, interval.launch->time_ns);
                last_ns = std::max(last_ns, interval.launch->time_ns);
            }
            num_launches_ += launches.size();
        }
        begin_ns_ = num_launches_ ? first_ns : 0;
        seconds_ = num_launches_ ? static_cast<double>(last_ns - first_ns) / 1e9 : 0;
    }

    Draft run(const std::string& program) {
        name_chains();
        header(program);
        for (const DraftChain& chain : draft_.chains) write_chain(chain);
        write_follows();
        write_left_out();
        return std::move(draft_);
    }

  private:
    template <typename... T>
    void line(fmt::format_string<T...> format, T&&... values) {
        draft_.yaml += fmt::format(format, std::forward<T>(values)...) + "\n";
    }

    std::string share(double gpu_ns) const {
        return fmt::format("{:.1f} %", total_gpu_ns_ > 0 ? 100 * gpu_ns / total_gpu_ns_ : 0);
    }

    /// Tasks have kernel names where threads have none of their own; a name says more than a rule.
    void name_chains() {
        std::vector<std::string> taken;
        for (std::size_t i = 0; i < activities_.list.size(); ++i) {
            const Rule& rule = rules_[i];
            if (!rule.found() || draft_.chains.size() == config::kMaxTasks) continue;
            const std::string source =
                rule.kernels.empty() ? rule.seen_name : short_kernel_name(rule.seen_name);
            draft_.chains.push_back({unique_name(readable(source), taken), i});
        }
    }

    void header(const std::string& program) {
        const trace::Trace& trace = seen_.trace;
        line("# A draft by `urgengo discover`, of: {}", printable(program));
        line("# GPU {}, driver for CUDA {}; {} launches by {} threads in {:.1f} s.",
             printable(trace.gpu()), trace.driver().empty() ? "?" : trace.driver(), num_launches_,
             seen_.gpu.size(), seconds_);
        line(
            "# One chain for each thing that the program does periodically on the GPU. Periods "
            "are");
        line(
            "# measured; DEADLINES ARE A FIRST GUESS (the period): say what you need. Rename as "
            "you");
        line(
            "# like, and make one chain of several tasks where one frame passes through them all.");
        line("# Next: urgengo check, then urgengo profile, then urgengo run.");
        line("version: 1");
        line("mode: enforce");
        line("chains:");
    }

    void write_chain(const DraftChain& chain) {
        const Activity& activity = activities_.list[chain.activity];
        const Rule& rule = rules_[chain.activity];
        const Facts facts = collect(seen_, activity);
        draft_.yaml += "\n";
        write_facts(activity, facts);
        write_rule_notes(rule);
        line("  - name: {}", yaml_quoted(chain.name));
        line("    period_ms: {}  # median of {}; {} for 10 to 90 %", ms(activity.period_ns.median),
             activity.period_ns.count, spread_text(activity.period_ns));
        line("    deadline_ms: {}  # a first guess: the period", ms(activity.period_ns.median));
        line("    tasks:");
        line("      - {{name: {}, {}}}", yaml_quoted(chain.name), rule_text(rule));
    }

    void write_facts(const Activity& activity, const Facts& facts) {
        const std::size_t num_threads = activity.threads.size();
        const char* how = num_threads == 1 ? ""
                          : activity.takes_turns
                              ? ", which take turns"
                              : ", each with frames of its own; nothing tells them apart";
        line("  # {} frames by {} thread{} named {}{}; {} stream{}", activity.frames.size(),
             num_threads, num_threads == 1 ? "" : "s", keys_of(facts.thread_names, "'"), how,
             facts.streams.size(), facts.streams.size() == 1 ? "" : "s");
        line(
            "  # per frame: {:.0f} launches ({:.0f} to {:.0f}) in {:.0f} segment{}, waited for by: "
            "{}",
            facts.launches.median, facts.launches.low, facts.launches.high, facts.segments.median,
            facts.segments.median == 1 ? "" : "s", keys_of(facts.closed_by));
        if (facts.num_timed > 0) {
            line(
                "  # GPU {} ms per frame ({}, with all else that ran meanwhile): {} of all GPU "
                "time",
                ms(facts.gpu_ns.median), spread_text(facts.gpu_ns), share(facts.total_gpu_ns));
            line("  # most of it: {}", listed(facts.kernels, " ({:.3g} ms)"));
        }
        if (facts.num_timed < facts.num_launches) {
            line("  # ({} of {} launches without GPU times)", facts.num_launches - facts.num_timed,
                 facts.num_launches);
        }
        if (!facts.ranges.empty()) line("  # NVTX ranges: {}", listed(facts.ranges, ""));
        const auto start_ns = static_cast<double>(activity.frames.front().begin_ns - begin_ns_);
        line(
            "  # first frame {:.2f} s after the first launch of all; start-up left out: {} "
            "launches",
            start_ns / 1e9, activity.start_up_launches);
        if (activity.idle_share < kNoPause) {
            line(
                "  # It never pauses: if it is background work without a deadline, remove this "
                "chain.");
        }
    }

    void write_rule_notes(const Rule& rule) {
        if (rule.kernels.empty()) return;
        const std::string name = short_kernel_name(rule.seen_name);
        if (rule.kernel_index == 0) {
            line("  # known by the first kernel of its frames, {}", shown(name));
        } else {
            line("  # known by kernel {} of its frames, {}: others launch the ones before it, too",
                 rule.kernel_index + 1, shown(name));
        }
    }

    static std::string rule_text(const Rule& rule) {
        std::string text;
        const auto add = [&](const char* key, const std::string& value) {
            if (value.empty()) return;
            text += (text.empty() ? "" : ", ") + std::string(key) + ": " + yaml_quoted(value);
        };
        add("thread", rule.thread_glob);
        add("nvtx", rule.nvtx_glob);
        for (const config::KernelPattern& kernel : rule.kernels) {
            add("kernels", config::to_text(kernel));
        }
        return text;
    }

    std::string name_of(std::size_t activity) const {
        for (const DraftChain& chain : draft_.chains) {
            if (chain.activity == activity) return chain.name;
        }
        return {};
    }

    void write_follows() {
        for (const Follows& follows : find_follows(activities_)) {
            const std::string first = name_of(follows.first), second = name_of(follows.second);
            if (first.empty() || second.empty()) continue;
            line("\n# {} always begins {} ms after {} has ended: likely two tasks of one chain.",
                 second, ms(follows.gap_ns), first);
        }
    }

    void write_left_out() {
        std::vector<std::string> notes;
        for (std::size_t i = 0; i < activities_.list.size(); ++i) {
            const Activity& activity = activities_.list[i];
            if (!name_of(i).empty()) continue;
            const Facts facts = collect(seen_, activity);
            notes.push_back(fmt::format(
                "every {} ms, threads named {}: {} of all GPU time. {}",
                ms(activity.period_ns.median), keys_of(facts.thread_names, "'"),
                share(facts.total_gpu_ns),
                rules_[i].found() ? "There are more chains than a config may have."
                                  : "No thread name, kernel or NVTX range tells it from others: "
                                    "name its thread, or put a range around it."));
        }
        add_unexplained(notes);
        if (notes.empty()) return;
        line("\n# Left out:");
        for (const std::string& note : notes) line("# - {}", note);
    }

    /// What is not periodic, by thread name.
    void add_unexplained(std::vector<std::string>& notes) const {
        struct Group {
            std::size_t launches = 0;
            double gpu_ns = 0;
            std::map<std::string, double> kernels;
        };
        std::map<std::string, Group> groups;
        for (std::size_t thread = 0; thread < seen_.gpu.size(); ++thread) {
            for (std::size_t i = 0; i < seen_.gpu[thread].size(); ++i) {
                if (activities_.owners[thread][i] >= 0) continue;
                Group& group = groups[std::string(seen_.thread_name(thread, i))];
                const auto gpu_ns = static_cast<double>(seen_.gpu_ns(thread, i));
                ++group.launches;
                group.gpu_ns += gpu_ns;
                group.kernels[short_kernel_name(
                    trace::launch_name(seen_.trace, seen_.launch(thread, i)))] += gpu_ns / kNsPerMs;
            }
        }
        for (const auto& [name, group] : groups) {
            notes.push_back(fmt::format(
                "not periodic, or only once, by threads named '{}': {} launches, {} ms, {} of all "
                "GPU time: {}",
                shown(name), group.launches, ms(group.gpu_ns), share(group.gpu_ns),
                listed(group.kernels, " ({:.3g} ms)")));
        }
    }

    const Observation& seen_;
    const Activities& activities_;
    const std::vector<Rule>& rules_;
    double total_gpu_ns_ = 0;
    double seconds_ = 0;
    std::int64_t begin_ns_ = 0;
    std::size_t num_launches_ = 0;
    Draft draft_;
};

}  // namespace

Draft write_draft(const Observation& observation, const Activities& activities,
                  const std::vector<Rule>& rules, const std::string& program) {
    return Writer(observation, activities, rules).run(program);
}

}  // namespace urgengo::discover
