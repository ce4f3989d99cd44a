// SPDX-License-Identifier: Apache-2.0
//
// The device code as it is embedded in the library: a fat binary for cuModuleLoadData.
#pragma once

namespace urgengo::device {

const void* marks_image();

}  // namespace urgengo::device
