#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Triton: a fused softmax, a matrix product and a reduction, each with one fixed configuration."""
import equality

try:
    import triton
    import triton.language as tl
except ImportError:  # then main() skips
    triton = None

if triton:

    @triton.jit
    def softmax_kernel(out, x, columns, BLOCK: tl.constexpr):
        row = tl.program_id(0)
        offsets = tl.arange(0, BLOCK)
        inside = offsets < columns
        values = tl.load(x + row * columns + offsets, mask=inside, other=-float("inf"))
        values = tl.exp(values - tl.max(values, axis=0))
        tl.store(out + row * columns + offsets, values / tl.sum(values, axis=0), mask=inside)

    @triton.jit
    def matmul_kernel(c, a, b, size, TILE: tl.constexpr, DEPTH: tl.constexpr):
        rows = tl.program_id(0) * TILE + tl.arange(0, TILE)
        columns = tl.program_id(1) * TILE + tl.arange(0, TILE)
        depth = tl.arange(0, DEPTH)
        total = tl.zeros((TILE, TILE), dtype=tl.float32)
        for k in range(0, size, DEPTH):
            left = tl.load(a + rows[:, None] * size + (k + depth)[None, :])
            right = tl.load(b + (k + depth)[:, None] * size + columns[None, :])
            total = tl.dot(left, right, total)
        tl.store(c + rows[:, None] * size + columns[None, :], (total / 32).to(tl.float16))

    @triton.jit
    def row_sum_kernel(out, x, columns, BLOCK: tl.constexpr):
        row = tl.program_id(0)
        total = tl.zeros((BLOCK,), dtype=tl.float32)
        for begin in range(0, columns, BLOCK):
            total += tl.load(x + row * columns + begin + tl.arange(0, BLOCK)).to(tl.float32)
        tl.store(out + row, tl.sum(total, axis=0))


def program(outputs):
    import torch

    generator = torch.Generator().manual_seed(7)

    def random(*shape):
        return torch.randn(*shape, generator=generator)

    def collect(tensor):
        outputs.append(tensor.cpu().numpy().tobytes())

    x = random(4096, 1000).cuda()
    out = torch.empty_like(x)
    for _ in range(30):
        softmax_kernel[(4096,)](out, x, 1000, BLOCK=1024, num_warps=4)
        x, out = out, x
    collect(x)

    size = 1024
    a, b = random(size, size).half().cuda(), random(size, size).half().cuda()
    c = torch.empty_like(a)
    with torch.cuda.stream(torch.cuda.Stream()):
        torch.cuda.current_stream().wait_stream(torch.cuda.default_stream())
        for _ in range(30):
            matmul_kernel[(size // 64, size // 64)](c, a, b, size, TILE=64, DEPTH=32, num_warps=4,
                                                    num_stages=3)
            a, c = c, a
        torch.cuda.current_stream().synchronize()
        collect(a)

    sums = torch.empty(size, device="cuda")
    row_sum_kernel[(size,)](sums, b, size, BLOCK=256, num_warps=4)
    torch.cuda.synchronize()
    collect(sums)


if __name__ == "__main__":
    equality.main(__file__, ["triton", "torch"], program)
