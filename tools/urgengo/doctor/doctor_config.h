// SPDX-License-Identifier: Apache-2.0
//
// doctor: the config, and what each `auto` in it, and each key that is not written, comes to here.
#pragma once

#include <optional>
#include <string>

#include "host/base/result.h"
#include "host/config/config.h"
#include "host/config/profile_match.h"
#include "tools/urgengo/doctor/doctor_report.h"
#include "tools/urgengo/doctor/gpu_facts.h"
#include "tools/urgengo/doctor/priority_probe.h"

namespace urgengo::cli {

/// @param file    empty: none, and `config` is the defaults
/// @param config  or why it cannot be used
Findings check_config(const std::string& file, const Result<config::Config>& config);

/// @param priority  what `auto` stands for; nothing if that was not found out
/// @param gpu       that the program would find; null if there is none
Findings explain_choices(const config::Config& config,
                         const std::optional<PriorityChoice>& priority, const GpuFacts* gpu);

/// @param yaml    the config; its profile lies beside it
/// @param target  the GPU and program; an empty program counts as any
Findings check_profile(const std::string& yaml, const config::Config& config,
                       const config::RunTarget& target);

/// @returns a warning where tasks of a Python program launch for longer than the GPU works: they
///          share its lock
/// @source docs/measurements.md, "Turns at Python's lock"
Findings check_launching(const config::Profile& profile);

}  // namespace urgengo::cli
