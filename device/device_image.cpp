// SPDX-License-Identifier: Apache-2.0
#include "device/device_image.h"

extern "C" const unsigned char urgengo_marks_fatbin[];

namespace urgengo::device {

const void* marks_image() {
    return urgengo_marks_fatbin;
}

}  // namespace urgengo::device
