// SPDX-License-Identifier: Apache-2.0
//
// Owners of what the CUDA driver API hands out. A call that fails throws CudaError; destructors
// ignore failures, which an earlier call has reported.
#pragma once

#include <cuda.h>

#include <stdexcept>
#include <string>
#include <utility>

#include "tools/chains/workload.h"

namespace urgengo::chains {

class CudaError : public std::runtime_error {
  public:
    using std::runtime_error::runtime_error;
};

/// @throws CudaError with the call, the error's name and its description
void check_cuda(CUresult result, const char* call);
#define CHAINS_CUDA(call) ::urgengo::chains::check_cuda((call), #call)

/// How a synchronisation waits: as the driver does when nothing is asked for (it spins), or
/// blocked.
enum class SyncMode { kDriverDefault, kBlock };

class DeviceBuffer {
  public:
    DeviceBuffer() = default;
    explicit DeviceBuffer(std::size_t size_bytes);
    ~DeviceBuffer();
    DeviceBuffer(DeviceBuffer&& other) noexcept : pointer_(std::exchange(other.pointer_, 0)) {}
    DeviceBuffer& operator=(DeviceBuffer&& other) noexcept;

    CUdeviceptr get() const { return pointer_; }

  private:
    CUdeviceptr pointer_ = 0;
};

/// The first device, its primary context, and the workload's kernels. Outlives its streams.
class Gpu {
  public:
    explicit Gpu(SyncMode sync = SyncMode::kDriverDefault);
    ~Gpu();
    Gpu(const Gpu&) = delete;
    Gpu& operator=(const Gpu&) = delete;

    /// Makes the context current in the calling thread.
    void bind_thread() const;

    /// Allocates what chains_mem reads; needed before its first launch.
    void prepare_memory_input();

    /// @returns what the workload's module is loaded from
    const void* image() const;
    /// @returns a kernel of the workload's module that is none of its tasks'
    CUfunction function(const char* name) const;

    /// One launch of the kernel, as a program makes it: cuLaunchKernel.
    /// @param grid           blocks, instead of the kernel's own
    /// @param results        address of StreamResults, with or without kWithStamps
    /// @param blocks_before  see kernels.cu
    void launch(const Kernel& kernel, int grid, CUstream stream, CUdeviceptr results,
                unsigned blocks_before) const;

    const std::string& name() const { return name_; }
    int num_sms() const { return num_sms_; }
    /// Whether kernels only take time: the simulated GPU computes nothing.
    bool simulated() const { return simulated_; }
    /// @returns e.g. 13.0
    const std::string& cuda_driver_version() const { return cuda_driver_version_; }
    /// @returns e.g. 580.159.04; empty if it cannot be read
    const std::string& kernel_driver_version() const { return kernel_driver_version_; }

  private:
    CUdevice device_ = 0;
    CUcontext context_ = nullptr;
    CUmodule module_ = nullptr;
    CUfunction compute_ = nullptr, memory_ = nullptr;
    DeviceBuffer memory_input_;
    std::string name_, cuda_driver_version_, kernel_driver_version_;
    int num_sms_ = 0;
    bool simulated_ = false;
};

class Stream {
  public:
    Stream();  ///< non-blocking, at the default priority
    ~Stream();
    Stream(const Stream&) = delete;
    Stream& operator=(const Stream&) = delete;

    CUstream get() const { return stream_; }
    void synchronize() const { CHAINS_CUDA(cuStreamSynchronize(stream_)); }

  private:
    CUstream stream_ = nullptr;
};

class Event {
  public:
    Event();
    ~Event();
    Event(const Event&) = delete;
    Event& operator=(const Event&) = delete;

    void record(const Stream& stream) { CHAINS_CUDA(cuEventRecord(event_, stream.get())); }
    void synchronize() const { CHAINS_CUDA(cuEventSynchronize(event_)); }
    /// @returns GPU time from `start` to this event; both have completed
    double ms_since(const Event& start) const;

  private:
    CUevent event_ = nullptr;
};

}  // namespace urgengo::chains
