// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/doctor/gpu_session.h"

namespace urgengo::cli {

GpuSession::GpuSession(const std::string& library) : driver_(library) {
    if (!driver_.problem().empty()) throw DriverFailure(driver_.problem());
    URGENGO_CALL(*this, cuInit, 0u);
    URGENGO_CALL(*this, cuDeviceGet, &device_, 0);
}

void GpuSession::enter_context() const {
    CUcontext context = nullptr;
    URGENGO_CALL(*this, cuDevicePrimaryCtxRetain, &context, device_);
    URGENGO_CALL(*this, cuCtxSetCurrent, context);
}

int GpuSession::attribute(CUdevice_attribute which) const {
    int value = 0;
    URGENGO_CALL(*this, cuDeviceGetAttribute, &value, which, device_);
    return value;
}

void GpuSession::fail(const std::string& name, CUresult error) {
    throw DriverFailure(error == CUDA_ERROR_NOT_FOUND
                            ? "the driver has no " + name
                            : name + " answers " + std::to_string(static_cast<int>(error)));
}

}  // namespace urgengo::cli
