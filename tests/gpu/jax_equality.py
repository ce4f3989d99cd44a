#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""JAX: jitted functions with matrix products, convolutions, a scan, a sort, and a gradient."""
import os
import subprocess
import sys

import equality

# Kernels chosen by rule and not by timing, and no operation whose result depends on order. XLA ends
# the process at a flag that it does not know, and versions differ in what they know.
WANTED_FLAGS = ("--xla_gpu_autotune_level=0", "--xla_gpu_deterministic_ops=true",
                "--xla_gpu_exclude_nondeterministic_ops=true")


def environment():
    accepted = []
    for flag in WANTED_FLAGS:
        done = subprocess.run(
            [sys.executable, "-c", "import jax.numpy as n; n.zeros(1).block_until_ready()"],
            env={**os.environ, "JAX_PLATFORMS": "cpu", "XLA_FLAGS": flag}, capture_output=True)
        if done.returncode == 0:
            accepted.append(flag)
    return {"XLA_FLAGS": " ".join(accepted), "XLA_PYTHON_CLIENT_PREALLOCATE": "false",
            "JAX_DEFAULT_MATMUL_PRECISION": "highest"}


def program(outputs):
    import jax
    import jax.numpy as jnp
    import numpy

    random = numpy.random.default_rng(7)

    def on_gpu(*shape):
        return jax.device_put(random.standard_normal(shape, dtype=numpy.float32),
                              jax.devices("gpu")[0])

    def collect(array):
        outputs.append(numpy.asarray(array).tobytes())

    @jax.jit
    def step(x, w):
        return jnp.tanh(x @ w / 32)

    x, w = on_gpu(1024, 1024), on_gpu(1024, 1024)
    for _ in range(50):
        x = step(x, w)
    collect(x)

    @jax.jit
    def convolve(image, weight):
        out = jax.lax.conv_general_dilated(image, weight, (1, 1), "SAME",
                                           dimension_numbers=("NCHW", "OIHW", "NCHW"))
        return out / (1 + jnp.abs(out))

    image, weight = on_gpu(8, 64, 56, 56).astype(jnp.bfloat16), on_gpu(64, 64, 3, 3) * 0.05
    for _ in range(20):
        image = convolve(image, weight.astype(jnp.bfloat16))
    collect(image.astype(jnp.float32))

    @jax.jit
    def recurrence(state, inputs):
        def cell(carry, value):
            carry = jnp.tanh(carry * 0.9 + value)
            return carry, carry.sum()

        return jax.lax.scan(cell, state, inputs)

    state, sums = recurrence(on_gpu(256), on_gpu(200, 256))
    collect(state)
    collect(sums)

    @jax.jit
    def loss_gradient(parameters, inputs):
        return jax.grad(lambda p: jnp.square(jnp.tanh(inputs @ p)).mean())(parameters)

    parameters, inputs = on_gpu(512, 128), on_gpu(256, 512)
    for _ in range(20):
        parameters = parameters - loss_gradient(parameters, inputs)
    collect(jnp.sort(parameters, axis=0))


if __name__ == "__main__":
    # XLA launches from threads of its own, whatever their names.
    equality.main(__file__, ["jax", "jaxlib"], program, environment=environment, thread="[!z]*")
