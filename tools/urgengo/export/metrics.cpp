// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/export/metrics.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <utility>

#include "host/observe/miss_cause.h"

namespace urgengo::cli {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;
using Labels = std::vector<ClientMetric::Label>;

double to_s(nanoseconds time) {
    return std::chrono::duration<double>(time).count();
}

/// Families by name, in the order in which they are first named.
class Families {
  public:
    void counter(const char* name, const char* help, Labels labels, double value) {
        add(name, help, MetricType::Counter, std::move(labels)).counter.value = value;
    }
    void gauge(const char* name, const char* help, Labels labels, double value) {
        add(name, help, MetricType::Gauge, std::move(labels)).gauge.value = value;
    }
    void histogram(const char* name, const char* help, Labels labels, const TimeHistogram& times) {
        auto& histogram = add(name, help, MetricType::Histogram, std::move(labels)).histogram;
        std::uint64_t below = 0;
        for (std::size_t i = 0; i < times.bounds().size(); ++i) {
            below += times.count(i);
            histogram.bucket.push_back({below, to_s(times.bounds()[i])});
        }
        histogram.sample_count = times.total();
        histogram.sample_sum = to_s(times.sum());
    }
    std::vector<MetricFamily> take() { return std::move(families_); }

  private:
    ClientMetric& add(const char* name, const char* help, MetricType type, Labels labels) {
        const auto [at, is_new] = index_.try_emplace(name, families_.size());
        if (is_new) families_.push_back({name, help, type, {}});
        ClientMetric& metric = families_[at->second].metric.emplace_back();
        metric.label = std::move(labels);
        return metric;
    }

    std::vector<MetricFamily> families_;
    std::map<std::string, std::size_t> index_;
};

Labels with(const Labels& labels, const char* name, std::string value) {
    Labels more = labels;
    more.push_back({name, std::move(value)});
    return more;
}

Labels labels_of(const PageReading& page) {
    Labels labels{{"program", page.program}, {"pid", std::to_string(page.process.process)}};
    // Of another pid namespace: its number may be that of a process here.
    if (page.liveness == observe::Liveness::kElsewhere)
        labels.push_back({"pid_namespace", std::to_string(page.process.pid_namespace)});
    return labels;
}

/// One metric for each of the words, 1 for the one that holds.
template <std::size_t N>
void add_state(Families& families, const char* name, const char* help, const Labels& labels,
               const char* label, const char* const (&words)[N], std::size_t which) {
    for (std::size_t i = 0; i < N; ++i)
        families.gauge(name, help, with(labels, label, words[i]), i == which ? 1 : 0);
}

void add_process(Families& families, const PageReading& page, const Labels& labels) {
    // In the order of abi::StatusMode.
    constexpr const char* kModes[] = {"off", "observe", "enforce", "tripped", "shadow"};
    add_state(families, "urgengo_mode", "What UrgenGo does in the process: 1 for its mode.", labels,
              "mode", kModes, static_cast<std::size_t>(page.mode));
    families.counter("urgengo_trips_total", "How often UrgenGo has switched itself off for good.",
                     labels, page.mode == abi::StatusMode::kTripped ? 1 : 0);
    families.gauge("urgengo_stopped", "1 while the process is stopped by a signal or a debugger.",
                   labels, page.liveness == observe::Liveness::kStopped ? 1 : 0);
    families.gauge("urgengo_held_launches", "Launches that are held now.", labels, page.held_now);
}

void add_causes(Families& families, const ChainReading& chain, const Labels& labels) {
    for (std::size_t i = 1; i < abi::kCauseCounters; ++i) {
        const bool is_known = i < observe::kNumCauses;
        if (!is_known && chain.causes[i] == 0) continue;
        const auto cause = static_cast<abi::MissCause>(i);
        families.counter(
            "urgengo_frames_missed_by_cause_total", "Frames that missed, by cause.",
            with(labels, "cause", is_known ? observe::to_word(cause) : fmt::format("cause_{}", i)),
            static_cast<double>(chain.causes[i]));
    }
}

void add_chain(Families& families, const ChainReading& chain, const Labels& labels) {
    const auto counter = [&](const char* name, const char* help, std::uint64_t value) {
        families.counter(name, help, labels, static_cast<double>(value));
    };
    counter("urgengo_frames_total", "Frames that arrived.", chain.instances);
    counter("urgengo_frames_finished_total", "Frames that came to their end.", chain.finished);
    counter("urgengo_frames_missed_total", "Frames that missed their deadline.", chain.missed);
    counter("urgengo_frames_exited_total", "Frames that the program was told to end early.",
            chain.exited);
    add_causes(families, chain, labels);
    families.gauge("urgengo_consecutive_misses", "Misses in a row up to now.", labels,
                   chain.misses_in_a_row);
    families.gauge("urgengo_consecutive_misses_max", "The most misses in a row.", labels,
                   chain.most_misses_in_a_row);
    counter("urgengo_late_starts_total", "Frames that began later than arrivals vary.",
            chain.late_starts);
    counter("urgengo_launches_total", "Launches of the chain's tasks.", chain.launches);
    counter("urgengo_holds_total", "Holds of launches.", chain.holds);
    families.counter("urgengo_held_seconds_total", "Time that launches were held, in seconds.",
                     labels, to_s(chain.held));
    families.counter("urgengo_paced_seconds_total",
                     "Time that launches waited for their own task's work, in seconds.", labels,
                     to_s(chain.paced));
    constexpr const char* kWays[] = {"enforce", "priorities", "observe"};
    add_state(families, "urgengo_guard", "What the guard lets UrgenGo do for the chain: 1 for it.",
              labels, "way", kWays, chain.guard);
    families.gauge("urgengo_deadline_seconds", "The chain's deadline.", labels,
                   to_s(chain.deadline));
    families.gauge("urgengo_period_seconds", "The chain's period.", labels, to_s(chain.period));
}

void add_frames(Families& families, const FollowedFrames& frames, const Labels& labels) {
    families.histogram("urgengo_frame_latency_seconds", "From a frame's arrival to its end.",
                       labels, frames.latency);
    families.histogram("urgengo_frame_lateness_seconds",
                       "By how much a frame ended after its deadline; 0: in time.", labels,
                       frames.lateness);
    families.counter("urgengo_frames_unread_total",
                     "Frames that are in no histogram: they ended long before the exporter looked.",
                     labels, static_cast<double>(frames.unread));
}

/// No two labels are the same, whatever a page says.
class Distinct {
  public:
    std::string operator()(const std::string& name) {
        const int number = ++seen_[name];
        return number == 1 ? name : fmt::format("{} ({})", name, number);
    }

  private:
    std::map<std::string, int> seen_;
};

void add_tasks(Families& families, const PageReading& page, const ChainReading& chain,
               const Labels& labels) {
    Distinct distinct;
    for (const std::size_t index : chain.tasks) {
        const TaskReading& task = page.tasks[index];
        families.gauge("urgengo_estimate_factor",
                       "GPU time measured to GPU time by the profile; 1: as profiled.",
                       with(labels, "task", distinct(task.name)), task.factor);
    }
}

}  // namespace

std::vector<MetricFamily> metric_families(const std::vector<ExportedProcess>& processes) {
    Families families;
    families.gauge("urgengo_processes", "Processes under UrgenGo that are looked at.", {},
                   static_cast<double>(processes.size()));
    for (const ExportedProcess& process : processes) {
        const Labels labels = labels_of(process.page);
        add_process(families, process.page, labels);
        Distinct distinct;
        for (std::size_t i = 0; i < process.page.chains.size(); ++i) {
            const ChainReading& chain = process.page.chains[i];
            const Labels own = with(labels, "chain", distinct(chain.name));
            add_chain(families, chain, own);
            add_tasks(families, process.page, chain, own);
            if (i < process.frames.size()) add_frames(families, process.frames[i], own);
        }
    }
    return families.take();
}

}  // namespace urgengo::cli
