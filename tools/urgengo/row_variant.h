// SPDX-License-Identifier: Apache-2.0
//
// What a bench's row changes in its preset, by what its name says behind the '+': a way of
// tracking, or a source of progress, its spacing, or both. Pure.
//
//   urgengo+batched   urgengo+event   urgengo+every=20   urgengo+event+every=20
#pragma once

#include <optional>
#include <string>

#include "host/base/result.h"

namespace urgengo::cli {

/// Before what is changed, and between two such things.
inline constexpr char kVariantMark = '+';

/// @param variant  "batched", "event+every=20"
/// @param eval_interval_us  of ways of tracking
/// @returns the keys under `scheduler:` as a YAML map
/// @errors what is accepted
Result<std::string> variant_keys(const std::string& variant,
                                 std::optional<unsigned> eval_interval_us = {});

/// @returns whether the variant is a way of tracking, which an interval may go with
bool is_tracking(const std::string& variant);

}  // namespace urgengo::cli
