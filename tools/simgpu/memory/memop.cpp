// SPDX-License-Identifier: Apache-2.0
//
// Stream memory operations: writes of a value, and waits for one. A wait looks at memory whenever
// the engine has something to do, and every 20 us besides.
#include "tools/simgpu/api/driver_state.h"

using namespace urgengo::simgpu;

namespace {

template <typename T>
CUresult check_target(CUdeviceptr address) {
    if (address % sizeof(T) != 0) return CUDA_ERROR_INVALID_VALUE;
    return driver().memory.find(address) ? CUDA_SUCCESS : CUDA_ERROR_INVALID_VALUE;
}

template <typename T>
CUresult write_value(CUstream handle, CUdeviceptr address, T value, unsigned flags) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(handle, stream)) return error;
    if (CUresult error = check_target<T>(address)) return error;
    // CU_STREAM_WRITE_VALUE_NO_MEMORY_BARRIER is refused too, as on an H200.
    if (flags != CU_STREAM_WRITE_VALUE_DEFAULT) return CUDA_ERROR_INVALID_VALUE;
    auto* const target = reinterpret_cast<T*>(address);
    const Part& part = driver().part;
    submit(*stream,
           TimedWork{
               .duration = part.scaled(static_cast<double>(part.memop.count())),
               .run = [target, value](Time) { __atomic_store_n(target, value, __ATOMIC_RELEASE); },
               .writes = {address, sizeof(T)},
           });
    return CUDA_SUCCESS;
}

template <typename T>
bool compare(T found, T value, unsigned comparison) {
    switch (comparison) {
        case CU_STREAM_WAIT_VALUE_GEQ:
            return static_cast<std::make_signed_t<T>>(static_cast<T>(found - value)) >= 0;
        case CU_STREAM_WAIT_VALUE_EQ:
            return found == value;
        case CU_STREAM_WAIT_VALUE_AND:
            return (found & value) != 0;
        default:
            return static_cast<T>(~(found | value)) != 0;  // CU_STREAM_WAIT_VALUE_NOR
    }
}

template <typename T>
CUresult wait_value(CUstream handle, CUdeviceptr address, T value, unsigned flags) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(handle, stream)) return error;
    if (CUresult error = check_target<T>(address)) return error;
    const unsigned comparison = flags & ~unsigned{CU_STREAM_WAIT_VALUE_FLUSH};
    if (comparison > CU_STREAM_WAIT_VALUE_NOR) return CUDA_ERROR_INVALID_VALUE;
    const auto* const source = reinterpret_cast<const T*>(address);
    const auto is_open = [source, value, comparison] {
        return compare(__atomic_load_n(source, __ATOMIC_ACQUIRE), value, comparison);
    };
    submit(*stream, ValueWait{.address = address, .is_open = is_open, .seen_open = is_open()});
    return CUDA_SUCCESS;
}

CUresult batch(CUstream handle, unsigned count, CUstreamBatchMemOpParams* ops, unsigned flags) {
    if (flags != 0 || ops == nullptr) return CUDA_ERROR_INVALID_VALUE;
    for (unsigned i = 0; i < count; ++i) {
        const CUstreamBatchMemOpParams& op = ops[i];
        CUresult result = CUDA_SUCCESS;
        switch (op.operation) {
            case CU_STREAM_MEM_OP_WRITE_VALUE_32:
                result = write_value<cuuint32_t>(handle, op.writeValue.address, op.writeValue.value,
                                                 op.writeValue.flags);
                break;
            case CU_STREAM_MEM_OP_WRITE_VALUE_64:
                result = write_value<cuuint64_t>(handle, op.writeValue.address,
                                                 op.writeValue.value64, op.writeValue.flags);
                break;
            case CU_STREAM_MEM_OP_WAIT_VALUE_32:
                result = wait_value<cuuint32_t>(handle, op.waitValue.address, op.waitValue.value,
                                                op.waitValue.flags);
                break;
            case CU_STREAM_MEM_OP_WAIT_VALUE_64:
                result = wait_value<cuuint64_t>(handle, op.waitValue.address, op.waitValue.value64,
                                                op.waitValue.flags);
                break;
            case CU_STREAM_MEM_OP_BARRIER:  // what comes before is done: a stream is in order here
                break;
            default:
                return CUDA_ERROR_NOT_SUPPORTED;
        }
        if (result != CUDA_SUCCESS) return result;
    }
    return CUDA_SUCCESS;
}

CUresult refuse_old_api(CUstream handle) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    return CUDA_ERROR_NOT_SUPPORTED;
}

}  // namespace

// The plain names are the API before CUDA 12, which the driver refuses unless its kernel module is
// told otherwise; cuda.h gives programs the others.

SIMGPU_API CUresult cuStreamWriteValue32(CUstream stream, CUdeviceptr address, cuuint32_t value,
                                         unsigned flags) {
    return refuse_old_api(stream);
}

SIMGPU_API CUresult cuStreamWriteValue64(CUstream stream, CUdeviceptr address, cuuint64_t value,
                                         unsigned flags) {
    return refuse_old_api(stream);
}

SIMGPU_API CUresult cuStreamWaitValue32(CUstream stream, CUdeviceptr address, cuuint32_t value,
                                        unsigned flags) {
    return refuse_old_api(stream);
}

SIMGPU_API CUresult cuStreamWaitValue64(CUstream stream, CUdeviceptr address, cuuint64_t value,
                                        unsigned flags) {
    return refuse_old_api(stream);
}

SIMGPU_API CUresult cuStreamBatchMemOp(CUstream stream, unsigned count,
                                       CUstreamBatchMemOpParams* ops, unsigned flags) {
    return refuse_old_api(stream);
}

SIMGPU_API CUresult cuStreamWriteValue32_v2(CUstream stream, CUdeviceptr address, cuuint32_t value,
                                            unsigned flags) {
    return write_value(stream, address, value, flags);
}

SIMGPU_API CUresult cuStreamWriteValue64_v2(CUstream stream, CUdeviceptr address, cuuint64_t value,
                                            unsigned flags) {
    return write_value(stream, address, value, flags);
}

SIMGPU_API CUresult cuStreamWaitValue32_v2(CUstream stream, CUdeviceptr address, cuuint32_t value,
                                           unsigned flags) {
    return wait_value(stream, address, value, flags);
}

SIMGPU_API CUresult cuStreamWaitValue64_v2(CUstream stream, CUdeviceptr address, cuuint64_t value,
                                           unsigned flags) {
    return wait_value(stream, address, value, flags);
}

SIMGPU_API CUresult cuStreamBatchMemOp_v2(CUstream stream, unsigned count,
                                          CUstreamBatchMemOpParams* ops, unsigned flags) {
    return batch(stream, count, ops, flags);
}
