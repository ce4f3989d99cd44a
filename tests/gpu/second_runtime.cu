// SPDX-License-Identifier: Apache-2.0
//
// A library with a cudart of its own, as plug-ins have: math_libraries_equality.py links it with
// the copy that the program does not use.
#include <cuda_runtime.h>

#include <cstddef>

namespace {

__global__ void iterate(float* values, int size) {
    const int i = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
    if (i >= size) return;
    float x = values[i] + static_cast<float>(i % 1000) * 0.001f;
    for (int k = 0; k < 100; ++k) x = 3.7f * x * (1 - x);
    values[i] = x;
}

}  // namespace

extern "C" void* second_runtime_address() {
    return reinterpret_cast<void*>(&cudaGetDevice);
}

/// @param[out] values  `size` results
/// @returns the first error of cudart, 0 if none
extern "C" int second_runtime_run(float* values, int size) {
    float* d_values = nullptr;
    cudaStream_t stream = nullptr;
    const std::size_t bytes = sizeof(float) * static_cast<std::size_t>(size);
    cudaError_t error = cudaStreamCreate(&stream);
    if (!error) error = cudaMallocAsync(&d_values, bytes, stream);
    if (!error) error = cudaMemsetAsync(d_values, 0, bytes, stream);
    for (int i = 0; i < 50 && !error; ++i) {
        iterate<<<(size + 255) / 256, 256, 0, stream>>>(d_values, size);
        error = cudaGetLastError();
    }
    if (!error) error = cudaMemcpyAsync(values, d_values, bytes, cudaMemcpyDeviceToHost, stream);
    if (!error) error = cudaFreeAsync(d_values, stream);
    if (!error) error = cudaStreamSynchronize(stream);
    if (!error) error = cudaStreamDestroy(stream);
    return error;
}
