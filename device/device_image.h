// SPDX-License-Identifier: Apache-2.0
//
// The device code as it is embedded in the library: a fat binary for cuModuleLoadData.
#pragma once

#include <cstddef>

namespace urgengo::device {

const void* marks_image();
std::size_t marks_image_bytes();
const void* dispatcher_image();

}  // namespace urgengo::device
