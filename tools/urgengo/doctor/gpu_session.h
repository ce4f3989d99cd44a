// SPDX-License-Identifier: Apache-2.0
//
// The first GPU, through a driver opened by its path: for questions that need the GPU itself. Lives
// in a child (driver_question.h) and ends with it; nothing is given back.
#pragma once

#include <cuda.h>

#include <stdexcept>
#include <string>

#include "tools/urgengo/doctor/driver_question.h"

namespace urgengo::cli {

/// What the driver answered to which call: "cuInit answers 100".
struct DriverFailure : std::runtime_error {
    using std::runtime_error::runtime_error;
};

class GpuSession {
  public:
    /// @errors DriverFailure: no driver, or no GPU
    explicit GpuSession(const std::string& library);

    /// Makes the GPU's primary context this thread's.
    /// @errors DriverFailure
    void enter_context() const;

    /// @returns what the driver answers to its function `name`. Types are written out where the
    ///          toolkit's header means a newer function by the same name.
    /// @errors CUDA_ERROR_NOT_FOUND if it has none
    template <typename... Parameters, typename... Arguments>
    CUresult try_call(CUresult (*)(Parameters...), const char* name, Arguments... arguments) const {
        const auto function = driver_.find<CUresult (*)(Parameters...)>(name);
        return function ? function(arguments...) : CUDA_ERROR_NOT_FOUND;
    }

    /// The same for calls that must succeed.
    /// @errors DriverFailure
    template <typename Function, typename... Arguments>
    void call(Function type, const char* name, Arguments... arguments) const {
        if (const CUresult error = try_call(type, name, arguments...)) fail(name, error);
    }

    int attribute(CUdevice_attribute which) const;
    CUdevice device() const { return device_; }

    [[noreturn]] static void fail(const std::string& name, CUresult error);

  private:
    DriverLibrary driver_;
    CUdevice device_ = 0;
};

/// URGENGO_CALL(session, cuEventQuery, event): a function whose type is the header's.
#define URGENGO_CALL(session, function, ...) \
    (session).call(static_cast<decltype(&function)>(nullptr), #function, __VA_ARGS__)

}  // namespace urgengo::cli
