// SPDX-License-Identifier: Apache-2.0
#include "host/config/presets.h"

#include <array>

namespace urgengo::config {
namespace {

Scheduler urgengo() {
    return Scheduler{};
}

// The default with another order: what the order alone does.
Scheduler urgency() {
    Scheduler s;
    s.preset = "urgency";
    s.policy = Policy::kUrgency;
    return s;
}

Scheduler edf() {
    Scheduler s;
    s.preset = "edf";
    s.policy = Policy::kEdf;
    return s;
}

Scheduler vanilla() {
    Scheduler s;
    s.preset = "vanilla";
    s.binding = Binding::kNone;
    s.admission = Admission::kNone;
    return s;
}

struct Preset {
    std::string_view name;
    Scheduler (*make)();
};

constexpr std::array kPresets = {
    Preset{"urgengo", urgengo},
    Preset{"urgency", urgency},
    Preset{"edf", edf},
    Preset{"vanilla", vanilla},
};

}  // namespace

std::optional<Scheduler> preset(std::string_view name) {
    for (const Preset& p : kPresets) {
        if (p.name == name) return p.make();
    }
    return std::nullopt;
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
