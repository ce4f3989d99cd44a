// SPDX-License-Identifier: Apache-2.0
//
// Kernels with parameters of every kind, for test_simgpu_image.cpp. Never run.
struct Odd {
    double first;
    char rest[21];
};
struct __align__(16) Aligned {
    float values[4];
};

extern "C" __global__ void mixed(int* out, char c, short s, double d, Odd odd, Aligned aligned,
                                 unsigned long long n) {
    *out = c + s + static_cast<int>(d + odd.first + aligned.values[1]) + odd.rest[3] +
           static_cast<int>(n);
}

extern "C" __global__ void no_params() {}

extern "C" __global__ void __launch_bounds__(128) bounded(float* out) {
    __shared__ float shared[64];
    shared[threadIdx.x % 64] = out[threadIdx.x];
    __syncthreads();
    out[threadIdx.x] = shared[(threadIdx.x + 1) % 64];
}
