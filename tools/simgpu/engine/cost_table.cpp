// SPDX-License-Identifier: Apache-2.0
//
// Reading a cost table. Every refusal names the place, what was found and what is accepted.
#include "tools/simgpu/engine/cost_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tools/simgpu/engine/sm_array.h"

namespace urgengo::simgpu {
namespace {

using Json = nlohmann::json;

/// Thrown and caught in this file only, to leave a nested reader; never reaches a caller.
struct Refused {
    std::string message;
};

[[noreturn]] void refuse(const std::string& path, const Json& found, std::string_view accepted) {
    throw Refused{fmt::format("{}: found {}, accepted: {}", path, found.dump(), accepted)};
}

double read_duration(const std::string& path, const Json& value) {
    if (!value.is_number() || value.get<double>() < 0 || value.get<double>() > 1e15) {
        refuse(path, value, "nanoseconds, 0 to 1e15");
    }
    return value.get<double>();
}

std::size_t read_whole(const std::string& path, const Json& value, std::size_t least,
                       std::size_t most) {
    if (!value.is_number_unsigned() || value.get<std::size_t>() < least ||
        value.get<std::size_t>() > most) {
        refuse(path, value, fmt::format("a whole number from {} to {}", least, most));
    }
    return value.get<std::size_t>();
}

KernelCost read_cost(const std::string& path, const Json& entry, bool has_name) {
    if (!entry.is_object()) refuse(path, entry, "an object");
    KernelCost cost;
    // A duration that depends on the launch stands alone unless a fixed part is given too.
    if (entry.contains("block_ns_per_unit")) cost.block_ns = 0;
    for (const auto& [key, value] : entry.items()) {
        const std::string at = path + "." + key;
        if (key == "name" && has_name) {
            if (!value.is_string() || value.get<std::string>().empty()) {
                refuse(at, value, "a kernel's name");
            }
        } else if (key == "block_ns") {
            cost.block_ns = read_duration(at, value);
        } else if (key == "block_ns_per_unit") {
            cost.block_ns_per_unit = read_duration(at, value);
        } else if (key == "unit_arg") {
            cost.unit_arg = read_whole(at, value, 0, 4095);
        } else if (key == "unit_bytes") {
            cost.unit_bytes = read_whole(at, value, 1, 8);
            if ((cost.unit_bytes & (cost.unit_bytes - 1)) != 0) refuse(at, value, "1, 2, 4, 8");
        } else if (key == "blocks_per_sm") {
            cost.blocks_per_sm =
                static_cast<int>(read_whole(at, value, 1, SmArray::kMaxBlocksPerSm));
        } else if (key == "stamps_arg") {
            cost.stamps_arg = read_whole(at, value, 0, 4095);
        } else if (key == "param_bytes") {
            if (!value.is_array()) refuse(at, value, "a list of sizes");
            for (const Json& size : value)
                cost.param_bytes.push_back(read_whole(at, size, 1, 4096));
        } else {
            refuse(path, key,
                   fmt::format("the keys {}block_ns, block_ns_per_unit, unit_arg, unit_bytes, "
                               "blocks_per_sm, stamps_arg, param_bytes",
                               has_name ? "name, " : ""));
        }
    }
    return cost;
}

}  // namespace

Result<CostTable> CostTable::parse(std::string_view json, const std::string& where) {
    CostTable table;
    try {
        const Json root = Json::parse(json);
        if (!root.is_object()) refuse("the table", root, "an object");
        for (const auto& [key, value] : root.items()) {
            if (key == "default") {
                table.fallback_ = read_cost("default", value, false);
            } else if (key == "kernels") {
                if (!value.is_array()) refuse(key, value, "a list of kernels");
                for (std::size_t i = 0; i < value.size(); ++i) {
                    const std::string path = fmt::format("kernels[{}]", i);
                    const KernelCost cost = read_cost(path, value[i], true);
                    if (!value[i].contains("name")) refuse(path, value[i], "an object with a name");
                    table.kernels_[value[i]["name"].get<std::string>()] = cost;
                }
            } else {
                refuse("the table", key, "the keys kernels, default");
            }
        }
    } catch (const Refused& refused) {
        return Error{where + ": " + refused.message};
    } catch (const Json::exception& error) {
        return Error{where + ": " + error.what()};
    }
    return table;
}

const KernelCost* CostTable::find(const std::string& name) const {
    const auto it = kernels_.find(name);
    return it == kernels_.end() ? nullptr : &it->second;
}

std::size_t align_param(std::size_t end, std::size_t bytes) {
    constexpr std::size_t kLargestAlignment = 16;
    // The largest power of two that divides the size, as for any scalar or vector type.
    const std::size_t alignment = std::min(bytes & (~bytes + 1), kLargestAlignment);
    return (end + alignment - 1) / alignment * alignment;
}

std::vector<std::size_t> layout_params(std::span<const std::size_t> param_bytes) {
    std::vector<std::size_t> offsets;
    std::size_t end = 0;
    for (std::size_t bytes : param_bytes) {
        offsets.push_back(align_param(end, bytes));
        end = offsets.back() + bytes;
    }
    return offsets;
}

}  // namespace urgengo::simgpu
