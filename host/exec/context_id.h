// SPDX-License-Identifier: Apache-2.0
//
// What tells contexts apart: an id does, handles are used again. The driver answers for a handle
// whose context has gone (an error, or the id of another context; measured, H100, driver
// 580.159.04), and gives a primary context that is retained anew another id.
#pragma once

#include "host/exec/driver_api.h"

namespace urgengo::exec {

struct ContextId {
    CUcontext handle = nullptr;
    unsigned long long id = 0;  ///< 0: not known

    static ContextId of(const DriverApi& driver, CUcontext handle) {
        ContextId context{handle, 0};
        if (!handle || !driver.cuCtxGetId || driver.cuCtxGetId(handle, &context.id) != CUDA_SUCCESS)
            context.id = 0;
        return context;
    }
    static ContextId current(const DriverApi& driver) {
        CUcontext handle = nullptr;
        if (driver.cuCtxGetCurrent(&handle) != CUDA_SUCCESS) handle = nullptr;
        return of(driver, handle);
    }

    /// @returns whether it is known to be no more; an error of the context's own is no sign of that
    bool has_ended(const DriverApi& driver) const {
        if (id == 0) return false;
        unsigned long long now = 0;
        const CUresult result = driver.cuCtxGetId(handle, &now);
        return result == CUDA_ERROR_CONTEXT_IS_DESTROYED || result == CUDA_ERROR_INVALID_CONTEXT ||
               (result == CUDA_SUCCESS && now != id);
    }
};

}  // namespace urgengo::exec
