// SPDX-License-Identifier: Apache-2.0
#include "device/device_image.h"

extern "C" const unsigned char urgengo_marks_fatbin[];
extern "C" const unsigned char urgengo_marks_fatbin_end[];
extern "C" const unsigned char urgengo_dispatcher_fatbin[];

namespace urgengo::device {

const void* marks_image() {
    return urgengo_marks_fatbin;
}

std::size_t marks_image_bytes() {
    return static_cast<std::size_t>(urgengo_marks_fatbin_end - urgengo_marks_fatbin);
}

const void* dispatcher_image() {
    return urgengo_dispatcher_fatbin;
}

}  // namespace urgengo::device
