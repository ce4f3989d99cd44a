// SPDX-License-Identifier: Apache-2.0
//
// A kernel that takes as long as it is told: a chain of dependent multiplications.

extern "C" __global__ void bench_kernel(unsigned iterations, float* never_written) {
    float x = static_cast<float>(threadIdx.x);
    for (unsigned i = 0; i < iterations; ++i) x = x * 0.999f + 1.0f;
    // So that the compiler cannot leave the loop out. The sum tends to 1000.
    if (x < 0) *never_written = x;
}
