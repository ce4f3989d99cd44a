// SPDX-License-Identifier: Apache-2.0
//
// Presets: named settings of every key under `scheduler:`. Keys that the user writes override them.
//
//   urgengo  what measures best; the defaults of struct Scheduler
//   urgency  the same with order by least laxity (policy urgency)
//   edf      the same with order by deadline (policy edf)
//   vanilla  intercepts, counts, and answers early exit; schedules nothing
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "host/config/config.h"

namespace urgengo::config {

/// @returns the preset's settings; nothing if no preset has that name
std::optional<Scheduler> preset(std::string_view name);

/// @returns "urgengo, urgency, edf, vanilla", for error messages and help
std::string preset_names();

}  // namespace urgengo::config
