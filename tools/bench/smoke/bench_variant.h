// SPDX-License-Identifier: Apache-2.0
//
// What a bench's row changes of its preset, as its name says: urgengo+batched@100+learn. Pure.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "host/base/result.h"
#include "host/config/config.h"

namespace urgengo::cli {

/// Before each change that a row makes.
inline constexpr char kVariantMark = '+';
/// Behind a way of tracking that waits: the estimated GPU time of a batch.
inline constexpr char kIntervalMark = '@';

struct Variant {
    std::optional<config::Tracking> tracking;      ///< +sync
    std::optional<unsigned> eval_interval_us;      ///< +batched@100
    std::optional<config::ProgressSource> source;  ///< +event
    std::optional<unsigned> every_us;              ///< +every=20
    bool learn = false;                            ///< +learn
    /// +pack_limit=0.7, +hold={max_deadlines: 1}: keys under `scheduler:`, as the config takes
    /// them.
    std::vector<std::pair<std::string, std::string>> keys{};
    std::optional<int> nice{};  ///< +nice=-15: `cpu: {nice: -15}`
    unsigned noise_pct = 0;     ///< +noise=30: of the profile, not of the config

    /// Whether this way of tracking has an interval.
    bool waits_for_batches() const;
};

/// @param text  what follows the first '+': one or more changes, each of another thing
/// @errors what is accepted
Result<Variant> parse_variant(std::string_view text);

/// @returns the keys to set under `scheduler:`, as a YAML map; empty: none
std::string scheduler_keys(const Variant& variant);
/// The same of `cpu:`.
std::string cpu_keys(const Variant& variant);

}  // namespace urgengo::cli
