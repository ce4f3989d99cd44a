// SPDX-License-Identifier: Apache-2.0
#include "host/exec/copy_slices.h"

#include "host/exec/relaxed_capture_mode.h"
#include "host/sched/copies.h"

namespace urgengo::exec {
namespace {

/// @returns the end's kind, without its range; on no device if the driver does not know it
sched::CopyEnd kind_of_end(const DriverApi& driver, CUdeviceptr address) {
    sched::CopyEnd end;
    end.begin = address;
    unsigned type = 0, managed = 0;
    if (driver.cuPointerGetAttribute(&type, CU_POINTER_ATTRIBUTE_MEMORY_TYPE, address) !=
            CUDA_SUCCESS ||
        driver.cuPointerGetAttribute(&managed, CU_POINTER_ATTRIBUTE_IS_MANAGED, address) !=
            CUDA_SUCCESS ||
        driver.cuPointerGetAttribute(&end.device, CU_POINTER_ATTRIBUTE_DEVICE_ORDINAL, address) !=
            CUDA_SUCCESS)
        return {.begin = address, .on_host = true};
    end.on_host = type != CU_MEMORYTYPE_DEVICE;
    end.is_managed = managed != 0;
    return end;
}

/// Of memory on the device the mapped range, which may be a part of a reserved one.
void find_range(const DriverApi& driver, sched::CopyEnd& end) {
    CUdeviceptr begin = 0;
    std::size_t bytes = 0;
    const auto ask = [&](void* answer, CUpointer_attribute what) {
        return driver.cuPointerGetAttribute(answer, what, end.begin) == CUDA_SUCCESS;
    };
    const bool known =
        end.on_host ? ask(&begin, CU_POINTER_ATTRIBUTE_RANGE_START_ADDR) &&
                          ask(&bytes, CU_POINTER_ATTRIBUTE_RANGE_SIZE)
                    : driver.cuMemGetAddressRange_v2(&begin, &bytes, end.begin) == CUDA_SUCCESS;
    if (!known || end.device < 0) return;
    end.allocation = begin;
    end.bytes = bytes;
}

}  // namespace

std::size_t slice_of(const DriverApi& driver, const Copy& copy, std::size_t slice_bytes,
                     bool& on_device) {
    if (!driver.cuPointerGetAttribute || !driver.cuMemGetAddressRange_v2) return 0;
    const RelaxedCaptureMode relaxed(driver);
    sched::CopyEnd to = kind_of_end(driver, copy.to), from = kind_of_end(driver, copy.from);
    on_device = !to.on_host && !from.on_host;
    if (slice_bytes == 0 || copy.bytes <= slice_bytes) return 0;
    find_range(driver, to);
    find_range(driver, from);
    return sched::cut_copy(copy.bytes, slice_bytes, to, from);
}

}  // namespace urgengo::exec
