# SPDX-License-Identifier: Apache-2.0
"""A network of kernels that take as long as they are told, on the simulated GPU (tools/simgpu).

It stands in for networks.TorchNetwork, so that whatever runs networks can be tried without PyTorch
and without a GPU. No framework: a few driver calls through ctypes.
"""
import ctypes
import json
import zlib

NUM_KERNELS = 20
EAGER_KERNEL_US = 8
EAGER_LOOPS = 1000  # tens of microseconds between launches
BLOCKS = 46  # of 1024 threads: one on each SM of the simulated part
THREADS = 1024
IMAGE = json.dumps({"kernels": [{"name": f"layer{i}", "block_ns_per_unit": 1000, "unit_arg": 0,
                                 "unit_bytes": 4, "param_bytes": [4]} for i in range(8)]}).encode()
NON_BLOCKING = 1


class SimulatedGpu:
    def __init__(self):
        self.library = ctypes.CDLL("libcuda.so.1")
        self.context, self.module = ctypes.c_void_p(), ctypes.c_void_p()
        self.must("cuInit", 0)
        self.must("cuDevicePrimaryCtxRetain", ctypes.byref(self.context), 0)
        self.enter()
        self.must("cuModuleLoadData", ctypes.byref(self.module), IMAGE)

    def enter(self):
        self.must("cuCtxSetCurrent", self.context)

    def must(self, name, *arguments):
        result = getattr(self.library, name)(*arguments)
        if result != 0:
            raise OSError(f"{name} answers {result}")

    def name(self):
        text = ctypes.create_string_buffer(256)
        self.must("cuDeviceGetName", text, 255, 0)
        return text.value.decode()

    def kernel(self, which):
        kernel = ctypes.c_void_p()
        self.must("cuModuleGetFunction", ctypes.byref(kernel), self.module,
                  f"layer{which % 8}".encode())
        return kernel

    def stream(self):
        stream = ctypes.c_void_p()
        self.must("cuStreamCreate", ctypes.byref(stream), NON_BLOCKING)
        return stream


def simulated_ms(name):
    """@returns how long the network of that name takes: 1 to 5 ms, always the same"""
    return 1 + zlib.crc32(name.encode()) % 4001 / 1000


def kernel_us(name):
    return round(simulated_ms(name) * 1000 / NUM_KERNELS)


def kernels_of(spec):
    """@returns how many kernels the network of this spec has, and what each takes, us"""
    us = kernel_us(spec["network"])
    if spec.get("form") == "eager":
        return NUM_KERNELS * us // EAGER_KERNEL_US // 2, EAGER_KERNEL_US
    return NUM_KERNELS, us


class SimulatedNetwork:
    """Of the form eager it launches as Python programs do: many short kernels, each behind work that
    holds Python's lock, so that it waits for its own launches, and for those of other threads."""

    def __init__(self, spec, tiny=False, gpu=None):
        self.gpu = gpu
        self.is_eager = spec.get("form") == "eager"
        self.count, us = kernels_of(spec)
        self.units = ctypes.c_uint32(1 if tiny else us)
        self.parameters = (ctypes.c_void_p * 1)(ctypes.cast(ctypes.byref(self.units),
                                                            ctypes.c_void_p))
        self.kernel, self.stream = gpu.kernel(zlib.crc32(spec["network"].encode())), gpu.stream()

    def enter(self, _):
        self.gpu.enter()

    def launch(self):
        for _ in range(EAGER_LOOPS * self.is_eager):
            pass
        self.gpu.must("cuLaunchKernel", self.kernel, BLOCKS, 1, 1, THREADS, 1, 1, 0, self.stream,
                      self.parameters, None)

    def frame(self):
        for _ in range(self.count):
            self.launch()
        self.gpu.must("cuStreamSynchronize", self.stream)

    @staticmethod
    def answer_sha256():
        return ""  # its kernels only take time
