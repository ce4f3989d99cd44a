// SPDX-License-Identifier: Apache-2.0
#include "host/config/presets.h"

#include <array>

#include "host/config/limits.h"

namespace urgengo::config {
namespace {

Scheduler urgengo() {
    return {};
}

// The default with another order: what the order alone does.
template <Policy policy>
Scheduler ordered() {
    Scheduler s;
    s.policy = policy;
    return s;
}

Scheduler vanilla() {
    Scheduler s;
    s.binding = Binding::kNone;
    s.admission = Admission::kNone;
    return s;
}

// Sections 4.4.3 to 4.4.5 of the paper, with its numbers.
Scheduler paper() {
    Scheduler s;
    s.policy = Policy::kUrgency;
    s.binding = Binding::kTask;
    s.admission = Admission::kThreshold;
    s.hold.poll = std::chrono::milliseconds(1);
    s.progress.tracking = Tracking::kOverlapped;
    s.progress.eval_interval = std::chrono::microseconds(500);
    s.parameters.urgent_percentile = 95;
    s.parameters.exempt_utilization = 0.1;
    return s;
}

Scheduler paper_binding() {
    Scheduler s = paper();
    s.admission = Admission::kNone;
    return s;
}

Scheduler paper_delay() {
    Scheduler s = paper();
    s.binding = Binding::kNone;
    return s;
}

// Requests go to the GPU whole: nothing paces what was let go.
Scheduler paam() {
    Scheduler s;
    s.policy = Policy::kStatic;
    s.binding = Binding::kStatic;
    s.admission = Admission::kBuckets;
    s.run_ahead.limit = std::chrono::microseconds(kRunAheadUs.max);
    return s;
}

Scheduler dcuda() {
    Scheduler s;
    s.policy = Policy::kUtilization;
    s.admission = Admission::kGroups;
    return s;
}

struct Preset {
    std::string_view name;
    Scheduler (*make)();
};

constexpr std::array kPresets = {
    Preset{"urgengo", urgengo},
    Preset{"urgency", ordered<Policy::kUrgency>},
    Preset{"edf", ordered<Policy::kEdf>},
    Preset{"eqdf", ordered<Policy::kEqdf>},
    Preset{"saedf", ordered<Policy::kSaedf>},
    Preset{"lcuf", ordered<Policy::kLcuf>},
    Preset{"sjf", ordered<Policy::kSjf>},
    Preset{"hrrn", ordered<Policy::kHrrn>},
    Preset{"static", ordered<Policy::kStatic>},
    Preset{"fifo", ordered<Policy::kFifo>},
    Preset{"paper", paper},
    Preset{"paper_binding", paper_binding},
    Preset{"paper_delay", paper_delay},
    Preset{"paam", paam},
    Preset{"dcuda", dcuda},
    Preset{"vanilla", vanilla},
};

}  // namespace

std::optional<Scheduler> preset(std::string_view name) {
    for (const Preset& p : kPresets) {
        if (p.name != name) continue;
        Scheduler s = p.make();
        s.preset = name;
        s.guard = name == "urgengo";  // the others are what they are, for comparison
        return s;
    }
    return std::nullopt;
}

std::vector<std::string> list_presets() {
    std::vector<std::string> list;
    for (const Preset& p : kPresets) list.emplace_back(p.name);
    return list;
}

std::string preset_names() {
    std::string names;
    for (const Preset& p : kPresets) {
        if (!names.empty()) names += ", ";
        names += p.name;
    }
    return names;
}

}  // namespace urgengo::config
