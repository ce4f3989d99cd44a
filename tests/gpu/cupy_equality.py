#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""CuPy: element-wise, reduction and raw kernels compiled at run time, cuBLAS, cuFFT, a sort."""
import equality

RAW = r"""
extern "C" __global__ void blur(const float* in, float* out, int width, int height) {
    const int x = blockIdx.x * blockDim.x + threadIdx.x;
    const int y = blockIdx.y * blockDim.y + threadIdx.y;
    if (x >= width || y >= height) return;
    float sum = 0;
    for (int dy = -2; dy <= 2; ++dy)
        for (int dx = -2; dx <= 2; ++dx)
            sum += in[(y + dy + height) % height * width + (x + dx + width) % width];
    out[y * width + x] = sum / 25;
}
"""


def program(outputs):
    import cupy
    import numpy

    random = numpy.random.default_rng(7)

    def on_gpu(*shape):
        return cupy.asarray(random.standard_normal(shape, dtype=numpy.float32))

    def collect(array):
        outputs.append(cupy.asnumpy(array).tobytes())

    with cupy.cuda.Stream(non_blocking=True) as stream:
        product, b = on_gpu(1024, 1024), on_gpu(1024, 1024)
        for _ in range(50):
            product = cupy.tanh(product @ b / 32)
        stream.synchronize()
        collect(product)

        blur = cupy.RawKernel(RAW, "blur")
        image = on_gpu(1080, 1920)
        blurred = cupy.empty_like(image)
        for _ in range(20):
            blur((60, 68), (32, 16), (image, blurred, numpy.int32(1920), numpy.int32(1080)))
            image, blurred = blurred, image
        collect(image)

        signal = on_gpu(64, 4096)
        for _ in range(20):
            spectrum = cupy.fft.rfft(signal, axis=1)
            signal = cupy.fft.irfft(spectrum * 0.99, n=4096, axis=1).astype(cupy.float32)
        collect(signal)

        scale = cupy.ElementwiseKernel("float32 x, float32 y", "float32 z", "z = x * y + 1", "scale")
        values = on_gpu(1 << 20)
        for _ in range(20):
            values = cupy.sort(scale(values, cupy.float32(0.9)))
        collect(values)
        collect(cupy.stack([values.sum(), values.max(), cupy.linalg.norm(values)]))


if __name__ == "__main__":
    # Full precision, and no reduction whose order depends on timing.
    equality.main(__file__, ["cupy"], program,
                  environment=lambda: {"CUPY_TF32": "0", "CUPY_ACCELERATORS": "",
                                       "CUBLAS_WORKSPACE_CONFIG": ":4096:8"})
