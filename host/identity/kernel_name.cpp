// SPDX-License-Identifier: Apache-2.0
#include "host/identity/kernel_name.h"

namespace urgengo::identity {

// What is launched may be a CUkernel, passed off as a CUfunction: all that the CUDA runtime loads
// is.
const char* kernel_name(const exec::DriverApi& driver, CUfunction function) {
    const char* name = nullptr;
    if (driver.cuFuncGetName && driver.cuFuncGetName(&name, function) == CUDA_SUCCESS && name)
        return name;
    name = nullptr;
    const bool known =
        driver.cuKernelGetName &&
        driver.cuKernelGetName(&name, reinterpret_cast<CUkernel>(function)) == CUDA_SUCCESS;
    return known ? name : nullptr;
}

}  // namespace urgengo::identity
