// SPDX-License-Identifier: Apache-2.0
#include "host/config/presets.h"

#include <array>

namespace urgengo::config {
namespace {

Scheduler urgengo() {
    return Scheduler{};
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
