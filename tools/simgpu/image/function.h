// SPDX-License-Identifier: Apache-2.0
//
// Making the objects behind CUfunction and CUkernel, and reading images.
#pragma once

#include <memory>
#include <string>

#include "tools/simgpu/api/driver_state.h"

namespace urgengo::simgpu {

/// A function of that name, with its cost: from SIMGPU_COSTS, else from the image's table, else
/// that table's default, else the default of SIMGPU_COSTS, else the built-in one.
/// @returns null if the image is known to have no such function
std::shared_ptr<Function> make_function(const char* name, const CostTable* image_costs,
                                        const std::shared_ptr<const Image>& image);

/// Accepts any image. One whose first character that is not blank is '{' is a cost table.
/// @param[in]  where   what errors call the image
/// @param[out] costs   the table; null if the image is none
/// @param[out] kernels what the image says of its kernels; null if it is a table
/// @returns CUDA_ERROR_INVALID_IMAGE, and one line on stderr, if the table is wrong
CUresult read_image(const char* image, const std::string& where,
                    std::shared_ptr<const CostTable>& costs, std::shared_ptr<const Image>& kernels);

/// @returns the object behind a CUfunction, or a CUkernel passed as one; null if there is none
std::shared_ptr<Function> find_function(CUfunction handle);

}  // namespace urgengo::simgpu
