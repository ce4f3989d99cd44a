// SPDX-License-Identifier: Apache-2.0
#include "tools/discover/rules.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <tuple>

#include "tools/discover/names.h"

namespace urgengo::discover {
namespace {

using trace::Instance;
using trace::Segment;

/// A kernel or range must be in this share of an activity's frames.
constexpr double kAlmostAll = 0.9;
/// Launches of no activity may be this share of those that a rule claims.
constexpr double kFew = 0.1;
constexpr std::size_t kMinPrefix = 3;
/// Numbers with so many digits at the end of a thread's name are taken for ids.
constexpr std::size_t kIdDigits = 4;
/// A kernel's name that is longer is cut where it is still the only one that begins so.
constexpr std::size_t kLongKernelName = 100;
constexpr std::size_t kMinKernelPrefix = 60;

/// Who launched something, and how often.
using Uses = std::map<int, std::size_t>;
/// A kernel, with its size or (0, 0) for any.
using KernelKey = std::tuple<std::uint64_t, std::uint32_t, std::uint32_t>;

KernelKey key_of(const abi::TraceLaunch& launch) {
    return {launch.name_hash, launch.grid_blocks, launch.block_threads};
}

KernelKey any_size(const KernelKey& key) {
    return {std::get<0>(key), 0, 0};
}

/// @returns whether the activity's own launches are (nearly) all
bool is_own(const Uses& uses, int activity) {
    std::size_t own = 0, unowned = 0;
    for (const auto& [owner, count] : uses) {
        if (owner == activity) {
            own += count;
        } else if (owner == kNoActivity) {
            unowned += count;
        } else if (owner != kAnyActivity) {
            return false;
        }
    }
    return own > 0 && static_cast<double>(unowned) <= kFew * static_cast<double>(own + unowned);
}

/// Calls f(thread, launch index) for each launch of the frame, in order.
template <typename F>
void for_each_launch(const Instance& frame, F f) {
    for (const Segment& segment : frame.segments) {
        for (std::size_t i = 0; i < segment.num_launches; ++i) {
            f(segment.thread, segment.first_launch + i);
        }
    }
}

/// @returns the text with every number replaced by one '*', and all else escaped
std::string without_numbers(std::string_view text) {
    std::string glob;
    const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
    for (std::size_t i = 0; i < text.size(); ++i) {
        if (!is_digit(text[i])) {
            glob += escape_glob(text.substr(i, 1));
        } else if (i == 0 || !is_digit(text[i - 1])) {
            glob += '*';
        }
    }
    return glob;
}

/// @returns a pattern for all of these names; empty if there is none that says anything
std::string thread_pattern(const std::set<std::string>& names) {
    if (names.empty() || names.count("")) return {};
    if (names.size() == 1) {
        const std::string& name = *names.begin();
        const std::size_t digits = name.size() - 1 - name.find_last_not_of("0123456789");
        if (digits < kIdDigits || digits == name.size()) return escape_glob(name);
        return escape_glob(name.substr(0, name.size() - digits)) + "*";
    }
    const auto [differs, ignored] = std::mismatch(names.begin()->begin(), names.begin()->end(),
                                                  names.rbegin()->begin(), names.rbegin()->end());
    const std::string prefix(names.begin()->begin(), differs);
    return prefix.size() < kMinPrefix ? "" : escape_glob(prefix) + "*";
}

/// Knows who uses what, and picks a rule for one activity after the other.
class RuleFinder {
  public:
    RuleFinder(const Observation& observation, const Activities& activities)
        : seen_(observation), activities_(activities) {
        for (std::size_t thread = 0; thread < seen_.gpu.size(); ++thread) {
            for (std::size_t i = 0; i < seen_.gpu[thread].size(); ++i) count(thread, i);
        }
    }

    Rule find(int index) const {
        const Activity& activity = activities_.list[static_cast<std::size_t>(index)];
        Rule rule = by_thread(activity, index);
        if (!rule.found()) rule = by_kernel(activity, index);
        if (!rule.found()) rule = by_range(activity, index);
        return rule;
    }

  private:
    void count(std::size_t thread, std::size_t i) {
        const int owner = activities_.owners[thread][i];
        const trace::TraceRecord& launch = seen_.launch(thread, i);
        // A launch of no activity on a thread of that name counts all the same.
        ++threads_[std::string(seen_.thread_name(thread, i))][owner];
        const auto& stack = seen_.ranges[thread].at(i);
        for (const std::uint64_t range : std::set<std::uint64_t>(stack.begin(), stack.end())) {
            ++ranges_[range][owner];
        }
        if (launch.flags & abi::kTraceGraph) return;
        ++kernels_[key_of(launch.launch)][owner];
        ++kernels_[any_size(key_of(launch.launch))][owner];
    }

    Rule by_thread(const Activity& activity, int index) const {
        if (!activity.is_alone) return {};
        std::set<std::string> names;
        for (const Instance& frame : activity.frames) {
            for_each_launch(frame, [&](std::size_t thread, std::size_t i) {
                names.emplace(seen_.thread_name(thread, i));
            });
        }
        const std::string glob = thread_pattern(names);
        if (glob.empty()) return {};
        Uses uses;
        for (const auto& [name, of_name] : threads_) {
            if (!matches_glob(glob, name)) continue;
            for (const auto& [owner, count] : of_name) uses[owner] += count;
        }
        if (!is_own(uses, index) || uses.count(kAnyActivity)) return {};
        return {glob, "", {}, names.size() == 1 ? *names.begin() : glob, 0};
    }

    Rule by_kernel(const Activity& activity, int index) const {
        std::map<KernelKey, std::size_t> in_frames;
        for (const Instance& frame : activity.frames) {
            std::set<KernelKey> keys;
            for_each_launch(frame, [&](std::size_t thread, std::size_t i) {
                const KernelKey key = key_of(seen_.launch(thread, i).launch);
                keys.insert({key, any_size(key)});
            });
            for (const KernelKey& key : keys) ++in_frames[key];
        }
        const double enough = kAlmostAll * static_cast<double>(activity.frames.size());
        const auto tells = [&](const KernelKey& key) {
            const auto uses = kernels_.find(key);
            return uses != kernels_.end() && static_cast<double>(in_frames[key]) >= enough &&
                   is_own(uses->second, index);
        };
        Rule rule;
        std::size_t position = 0;
        for_each_launch(activity.frames[activity.frames.size() / 2],
                        [&](std::size_t thread, std::size_t i) {
                            if (!rule.found()) {
                                const trace::TraceRecord& launch = seen_.launch(thread, i);
                                const KernelKey key = key_of(launch.launch);
                                const bool is_graph = (launch.flags & abi::kTraceGraph) != 0;
                                if (!is_graph && tells(any_size(key))) {
                                    rule = kernel_rule(any_size(key), position);
                                } else if (!is_graph && tells(key)) {
                                    rule = kernel_rule(key, position);
                                }
                            }
                            ++position;
                        });
        return rule;
    }

    Rule kernel_rule(const KernelKey& key, std::size_t position) const {
        const std::string name(seen_.trace.text(std::get<0>(key)));
        if (name.empty()) return {};
        Rule rule;
        rule.kernels.push_back({kernel_glob(name), std::get<1>(key), std::get<2>(key)});
        rule.seen_name = name;
        rule.kernel_index = position;
        return rule;
    }

    std::string kernel_glob(const std::string& name) const {
        if (name.size() <= kLongKernelName) return escape_glob(name);
        for (std::size_t length = kMinKernelPrefix; length < name.size(); ++length) {
            const std::string_view prefix = std::string_view(name).substr(0, length);
            const bool only = std::all_of(kernels_.begin(), kernels_.end(), [&](const auto& entry) {
                const std::string_view other = seen_.trace.text(std::get<0>(entry.first));
                return other == name || !other.starts_with(prefix);
            });
            if (only) return escape_glob(prefix) + "*";
        }
        return escape_glob(name);
    }

    Rule by_range(const Activity& activity, int index) const {
        std::map<std::string, std::size_t> launches_in;  // by pattern
        std::map<std::string, std::set<std::string>> names_of;
        std::size_t num_launches = 0;
        for (const Instance& frame : activity.frames) {
            for_each_launch(frame, [&](std::size_t thread, std::size_t i) {
                ++num_launches;
                std::set<std::string> patterns;
                for (const std::uint64_t range : seen_.ranges[thread].at(i)) {
                    const std::string name(seen_.trace.text(range));
                    if (name.empty()) continue;
                    patterns.insert(without_numbers(name));
                    names_of[without_numbers(name)].insert(name);
                }
                for (const std::string& pattern : patterns) ++launches_in[pattern];
            });
        }
        for (const auto& [pattern, count] : launches_in) {
            if (count < num_launches) continue;
            const auto& names = names_of[pattern];
            const std::string glob = names.size() == 1 ? escape_glob(*names.begin()) : pattern;
            if (glob == "*") continue;
            Uses uses;
            for (const auto& [range, of_range] : ranges_) {
                if (!matches_glob(glob, seen_.trace.text(range))) continue;
                for (const auto& [owner, number] : of_range) uses[owner] += number;
            }
            if (is_own(uses, index)) return {"", glob, {}, *names.begin(), 0};
        }
        return {};
    }

    const Observation& seen_;
    const Activities& activities_;
    std::map<std::string, Uses> threads_;
    std::map<std::uint64_t, Uses> ranges_;
    std::map<KernelKey, Uses> kernels_;
};

std::vector<Rule> find_all(const Observation& observation, const Activities& activities) {
    const RuleFinder finder(observation, activities);
    std::vector<Rule> rules;
    for (std::size_t i = 0; i < activities.list.size(); ++i) {
        rules.push_back(finder.find(static_cast<int>(i)));
    }
    return rules;
}

/// @returns two activities that begin alike, of which neither has a rule
std::optional<std::pair<std::size_t, std::size_t>> find_alike(const Activities& activities,
                                                              const std::vector<Rule>& rules) {
    for (std::size_t first = 0; first < rules.size(); ++first) {
        for (std::size_t second = first + 1; second < rules.size(); ++second) {
            if (!rules[first].found() && !rules[second].found() &&
                activities.list[first].type == activities.list[second].type) {
                return std::pair(first, second);
            }
        }
    }
    return {};
}

}  // namespace

std::vector<Rule> choose_rules(const Observation& observation, Activities& activities) {
    std::vector<Rule> rules = find_all(observation, activities);
    while (const auto alike = find_alike(activities, rules)) {
        merge(activities, alike->first, alike->second);
        rules = find_all(observation, activities);
    }
    return rules;
}

}  // namespace urgengo::discover
