// SPDX-License-Identifier: Apache-2.0
//
// What `priority_via: auto` stands for here: measured once for a GPU and a driver
// (priority_measurement.h), and remembered in the user's cache folder.
#pragma once

#include <chrono>
#include <string>
#include <string_view>

#include "host/base/result.h"
#include "host/config/config.h"
#include "tools/urgengo/doctor/priority_measurement.h"

namespace urgengo::cli {

/// For a probe at the start of a run: how long it is waited for.
inline constexpr std::chrono::seconds kPriorityLimit{10};

/// What an answer is good for. Another version of UrgenGo measures again.
struct PriorityKey {
    std::string gpu;      ///< its name
    std::string driver;   ///< the CUDA that it is for, and its release: "13.0 580.95.05"
    std::string urgengo;  ///< version and commit
};

/// @param driver   as GpuProbe::driver
/// @param library  the driver's file; its real name ends in the release. Empty: not known
PriorityKey priority_key(const std::string& gpu, const std::string& driver,
                         const std::string& library);

/// Measures in a child.
/// @errors why there is no answer: one line
Result<PriorityMeasurement> probe_priority(const std::string& library,
                                           std::chrono::milliseconds limit);

/// One file for each key, so that several processes at once at most measure twice: files are
/// written whole.
class PriorityCache {
  public:
    /// @param folder  empty: nothing is remembered
    explicit PriorityCache(std::string folder) : folder_(std::move(folder)) {}

    /// @errors there is none, or it cannot be read: one line
    Result<PriorityMeasurement> find(const PriorityKey& key) const;
    /// @errors one line
    Result<bool> store(const PriorityKey& key, const PriorityMeasurement& measured) const;
    /// @returns empty if nothing is remembered
    std::string path(const PriorityKey& key) const;

  private:
    std::string folder_;
};

/// An answer to `auto`, and the reason, to be printed: "honoured, measured: ...".
struct PriorityChoice {
    config::PriorityVia via = config::PriorityVia::kLaunchAttribute;
    std::string reason;
};

/// Launch attribute, else stream attribute, else the pool, whichever is honoured first; without a
/// measurement the launch attribute.
PriorityChoice choose_priority(const Result<PriorityMeasurement>& measured);

/// @returns "honoured (waited 744 us behind 14954 us of other work)", "refused by the driver"
std::string describe(const PriorityWay& way);

/// As the cache and `doctor --json` have it.
std::string priority_json(const PriorityMeasurement& measured);
/// @errors what was found and what is accepted, with the JSON path
Result<PriorityMeasurement> parse_priority_json(std::string_view text, const std::string& file);

}  // namespace urgengo::cli
