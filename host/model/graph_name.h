// SPDX-License-Identifier: Apache-2.0
//
// The names by which profiles know executable graphs: "(graph of 53 kernels, 8f3a12bc)".
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace urgengo::model {

/// @param hash  of what is in it
std::string graph_name(std::size_t kernels, std::uint32_t hash);

/// @returns how many kernels a launch of that name is: those of a graph, else 1
std::size_t kernels_of(std::string_view name);

}  // namespace urgengo::model
