// SPDX-License-Identifier: Apache-2.0
//
// In a global-mode capture a query, an allocation or a module load in any other thread fails and
// ends the capture; in relaxed mode all of them work and it stays valid (measured, H200).
#pragma once

#include "host/exec/driver_api.h"

namespace urgengo::exec {

/// The calling thread is in relaxed capture mode for as long as the object lives.
class RelaxedCaptureMode {
  public:
    explicit RelaxedCaptureMode(const DriverApi& driver) : driver_(driver) {
        if (driver_.cuThreadExchangeStreamCaptureMode)
            exchanged_ = driver_.cuThreadExchangeStreamCaptureMode(&mode_) == CUDA_SUCCESS;
    }
    ~RelaxedCaptureMode() {
        if (exchanged_) driver_.cuThreadExchangeStreamCaptureMode(&mode_);
    }
    RelaxedCaptureMode(const RelaxedCaptureMode&) = delete;
    RelaxedCaptureMode& operator=(const RelaxedCaptureMode&) = delete;

  private:
    const DriverApi& driver_;
    CUstreamCaptureMode mode_ = CU_STREAM_CAPTURE_MODE_RELAXED;
    bool exchanged_ = false;
};

}  // namespace urgengo::exec
