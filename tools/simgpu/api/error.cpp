// SPDX-License-Identifier: Apache-2.0
//
// cuGetErrorName and cuGetErrorString, for the codes that this library returns and the commonest
// others.
#include <array>

#include "tools/simgpu/api/driver_state.h"

namespace {

struct ErrorText {
    CUresult code;
    const char* name;
    const char* text;
};

#define SIMGPU_ERROR(code, text) \
    ErrorText {                  \
        code, #code, text        \
    }
constexpr std::array kErrors = {
    SIMGPU_ERROR(CUDA_SUCCESS, "no error"),
    SIMGPU_ERROR(CUDA_ERROR_INVALID_VALUE, "invalid argument"),
    SIMGPU_ERROR(CUDA_ERROR_OUT_OF_MEMORY, "out of memory"),
    SIMGPU_ERROR(CUDA_ERROR_NOT_INITIALIZED, "initialization error"),
    SIMGPU_ERROR(CUDA_ERROR_DEINITIALIZED, "driver shutting down"),
    SIMGPU_ERROR(CUDA_ERROR_NO_DEVICE, "no CUDA-capable device is detected"),
    SIMGPU_ERROR(CUDA_ERROR_INVALID_DEVICE, "invalid device ordinal"),
    SIMGPU_ERROR(CUDA_ERROR_INVALID_IMAGE, "device kernel image is invalid"),
    SIMGPU_ERROR(CUDA_ERROR_INVALID_CONTEXT, "invalid device context"),
    SIMGPU_ERROR(CUDA_ERROR_FILE_NOT_FOUND, "file not found"),
    SIMGPU_ERROR(CUDA_ERROR_INVALID_HANDLE, "invalid resource handle"),
    SIMGPU_ERROR(CUDA_ERROR_ILLEGAL_STATE,
                 "the operation cannot be performed in the present state"),
    SIMGPU_ERROR(CUDA_ERROR_NOT_FOUND, "named symbol not found"),
    SIMGPU_ERROR(CUDA_ERROR_NOT_READY, "device not ready"),
    SIMGPU_ERROR(CUDA_ERROR_ILLEGAL_ADDRESS, "an illegal memory access was encountered"),
    SIMGPU_ERROR(CUDA_ERROR_LAUNCH_OUT_OF_RESOURCES, "too many resources requested for launch"),
    SIMGPU_ERROR(CUDA_ERROR_PRIMARY_CONTEXT_ACTIVE,
                 "cannot set while device is active in this process"),
    SIMGPU_ERROR(CUDA_ERROR_CONTEXT_IS_DESTROYED, "context is destroyed"),
    SIMGPU_ERROR(CUDA_ERROR_HOST_MEMORY_ALREADY_REGISTERED,
                 "part or all of the requested memory range is already mapped"),
    SIMGPU_ERROR(CUDA_ERROR_HOST_MEMORY_NOT_REGISTERED,
                 "pointer does not correspond to a registered memory region"),
    SIMGPU_ERROR(CUDA_ERROR_COOPERATIVE_LAUNCH_TOO_LARGE, "too many blocks in cooperative launch"),
    SIMGPU_ERROR(CUDA_ERROR_NOT_PERMITTED, "operation not permitted"),
    SIMGPU_ERROR(CUDA_ERROR_NOT_SUPPORTED, "operation not supported"),
    SIMGPU_ERROR(CUDA_ERROR_STREAM_CAPTURE_UNSUPPORTED,
                 "operation not permitted when stream is capturing"),
    SIMGPU_ERROR(CUDA_ERROR_STREAM_CAPTURE_INVALIDATED,
                 "operation failed due to a previous error during capture"),
    SIMGPU_ERROR(CUDA_ERROR_STREAM_CAPTURE_MERGE,
                 "operation would result in a merge of separate capture sequences"),
    SIMGPU_ERROR(CUDA_ERROR_STREAM_CAPTURE_UNMATCHED,
                 "capture was not ended in the same stream as it began"),
    SIMGPU_ERROR(CUDA_ERROR_STREAM_CAPTURE_UNJOINED, "capturing stream has unjoined work"),
    SIMGPU_ERROR(CUDA_ERROR_STREAM_CAPTURE_ISOLATION,
                 "dependency created on uncaptured work in another stream"),
    SIMGPU_ERROR(CUDA_ERROR_STREAM_CAPTURE_IMPLICIT,
                 "operation would make the legacy stream depend on a capturing blocking stream"),
    SIMGPU_ERROR(CUDA_ERROR_CAPTURED_EVENT,
                 "operation not permitted on an event last recorded in a capturing stream"),
    SIMGPU_ERROR(CUDA_ERROR_STREAM_CAPTURE_WRONG_THREAD,
                 "attempt to terminate a thread-local capture sequence from another thread"),
    SIMGPU_ERROR(CUDA_ERROR_UNKNOWN, "unknown error"),
};
#undef SIMGPU_ERROR

const ErrorText* find_error(CUresult code) {
    for (const ErrorText& error : kErrors) {
        if (error.code == code) return &error;
    }
    return nullptr;
}

}  // namespace

SIMGPU_API CUresult cuGetErrorName(CUresult error, const char** name) {
    if (name == nullptr) return CUDA_ERROR_INVALID_VALUE;
    const ErrorText* found = find_error(error);
    *name = found ? found->name : nullptr;
    return found ? CUDA_SUCCESS : CUDA_ERROR_INVALID_VALUE;
}

SIMGPU_API CUresult cuGetErrorString(CUresult error, const char** text) {
    if (text == nullptr) return CUDA_ERROR_INVALID_VALUE;
    const ErrorText* found = find_error(error);
    *text = found ? found->text : nullptr;
    return found ? CUDA_SUCCESS : CUDA_ERROR_INVALID_VALUE;
}
