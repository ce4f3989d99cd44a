// SPDX-License-Identifier: Apache-2.0
//
// What kernels cost: a table by name, from JSON (README.md gives the schema). Immutable once
// parsed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "host/base/result.h"

namespace urgengo::simgpu {

struct KernelCost {
    double block_ns = 10000;                ///< what each block takes
    double block_ns_per_unit = 0;           ///< and this much more for each unit of the launch ...
    std::size_t unit_arg = 0;               ///< ... which is this kernel parameter,
    std::size_t unit_bytes = 4;             ///< an integer of this size
    int blocks_per_sm = 0;                  ///< 0: as many as the SM's threads allow
    std::optional<std::size_t> stamps_arg;  ///< the parameter that says where launches leave stamps
    std::vector<std::size_t>
        param_bytes;  ///< the parameters' sizes; needed only for `extra` launches

    bool needs_units() const { return block_ns_per_unit != 0; }
};

class CostTable {
  public:
    /// @param[in] where  what errors call the text: a file's name
    static Result<CostTable> parse(std::string_view json, const std::string& where);

    /// @returns null if the table does not name the kernel
    const KernelCost* find(const std::string& name) const;

    const std::optional<KernelCost>& fallback() const { return fallback_; }

  private:
    std::unordered_map<std::string, KernelCost> kernels_;
    std::optional<KernelCost> fallback_;
};

/// @returns where a parameter of that size goes when those before it end at `end`
std::size_t align_param(std::size_t end, std::size_t bytes);

/// @returns the offset of each parameter in the buffer that a launch passes: natural alignment
std::vector<std::size_t> layout_params(std::span<const std::size_t> param_bytes);

}  // namespace urgengo::simgpu
