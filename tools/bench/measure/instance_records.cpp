// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/measure/instance_records.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "host/config/json_cursor.h"

namespace urgengo::cli {
namespace {

using config::JsonCursor;
using std::chrono::nanoseconds;
using trace::TraceKind;
using trace::TraceRecord;

nanoseconds time_of(const JsonCursor& frame, const char* key) {
    return nanoseconds(frame.at(key).integer(0, INT64_MAX));
}

/// Begins and ends of all threads, in time order.
std::vector<const TraceRecord*> instance_events(const trace::Trace& trace) {
    std::vector<const TraceRecord*> events;
    for (const trace::ThreadTrace& thread : trace.threads()) {
        for (const TraceRecord* event : thread.events) {
            if (event->kind == TraceKind::kInstanceBegin ||
                event->kind == TraceKind::kInstanceEnd) {
                events.push_back(event);
            }
        }
    }
    std::stable_sort(events.begin(), events.end(), [](const TraceRecord* a, const TraceRecord* b) {
        return a->time_ns < b->time_ns;
    });
    return events;
}

/// One task's instances, as its events come in.
class TaskInstances {
  public:
    void add(const TraceRecord& event) {
        const nanoseconds when{event.time_ns};
        if (event.kind == TraceKind::kInstanceBegin) {
            const bool observed = (event.flags & abi::kTraceObserved) != 0;
            instances_.push_back({nanoseconds{event.arrival_ns}, when, {}, observed, false});
            numbers_.push_back(event.instance);
            return;
        }
        for (std::size_t i = numbers_.size(); i-- > 0;) {
            if (numbers_[i] != event.instance) continue;
            instances_[i].end = when;
            instances_[i].resync = (event.flags & abi::kTraceResync) != 0;
            return;
        }
    }

    std::vector<DetectedInstance> take() { return std::move(instances_); }

  private:
    std::vector<DetectedInstance> instances_;
    std::vector<std::uint32_t> numbers_;  // of each
};

}  // namespace

Result<TrueFrames> parse_true_frames(const std::string& report, const std::string& file) {
    const auto document = config::parse_json(report, file);
    if (!document) return Error{document.error()};
    config::JsonFault fault{file, {}};
    TrueFrames all;
    for (const JsonCursor& chain : JsonCursor(*document, fault).at("chains").items()) {
        std::vector<TrueFrame>& frames = all[chain.at("name").name()];
        for (const JsonCursor& record : chain.at("records").items()) {
            if (!record.find("begin_ns")) continue;
            frames.push_back({time_of(record, "arrival_ns"), time_of(record, "begin_ns"),
                              time_of(record, "first_launched_ns"), time_of(record, "end_ns")});
        }
    }
    if (!fault.message.empty()) return Error{fault.message};
    return all;
}

Result<DetectedInstances> detected_instances(const trace::Trace& trace,
                                             const config::Config& config) {
    std::vector<std::string> chain_of_task;
    for (const config::Chain& chain : config.chains) {
        if (chain.tasks.size() != 1) {
            return Error{
                fmt::format("chain {}: found {} tasks, accepted: one, so that its "
                            "instances are frames",
                            chain.name, chain.tasks.size())};
        }
        chain_of_task.push_back(chain.name);
    }
    std::vector<TaskInstances> tasks(chain_of_task.size());
    for (const TraceRecord* event : instance_events(trace)) {
        if (event->task < 0 || static_cast<std::size_t>(event->task) >= tasks.size()) {
            return Error{fmt::format("trace: found an instance of task {}, accepted: 0 to {}",
                                     event->task, tasks.size() - 1)};
        }
        tasks[static_cast<std::size_t>(event->task)].add(*event);
    }
    DetectedInstances all;
    for (std::size_t i = 0; i < tasks.size(); ++i) all[chain_of_task[i]] = tasks[i].take();
    return all;
}

}  // namespace urgengo::cli
