#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""PyTorch: matrix products, half-precision convolutions, a captured CUDA graph that is replayed."""
import equality


def program(outputs):
    import torch

    # Kernels chosen by timing, or by what another thread does at the time, would differ bare, too.
    torch.backends.cudnn.benchmark = False
    torch.backends.cudnn.deterministic = True
    torch.backends.cuda.matmul.allow_tf32 = False
    torch.use_deterministic_algorithms(True)
    generator = torch.Generator().manual_seed(7)

    def random(*shape):
        return torch.randn(*shape, generator=generator)

    def collect(tensor):
        outputs.append(tensor.cpu().numpy().tobytes())

    a, b = random(1024, 1024).cuda(), random(1024, 1024).cuda()
    product = a
    for _ in range(50):
        product = torch.tanh(product @ b / 32)
    torch.cuda.synchronize()
    collect(product)

    image = random(8, 64, 56, 56).half().cuda()
    weight = random(64, 64, 3, 3).half().cuda() * 0.05
    for _ in range(20):
        image = torch.nn.functional.conv2d(image, weight, padding=1)
    collect(image)

    static = random(512, 512).cuda()
    side = torch.cuda.Stream()
    side.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(side):
        for _ in range(3):
            result = (static @ static).relu().sum(0)
    torch.cuda.current_stream().wait_stream(side)
    graph = torch.cuda.CUDAGraph()
    # thread_local: in the default mode another thread's synchronisation would break the capture.
    with torch.cuda.graph(graph, capture_error_mode="thread_local"):
        result = (static @ static).relu().sum(0)
    for _ in range(20):
        static.mul_(0.99)
        graph.replay()
    torch.cuda.synchronize()
    collect(result)


if __name__ == "__main__":
    equality.main(__file__, ["torch"], program,
                  environment=lambda: {"CUBLAS_WORKSPACE_CONFIG": ":4096:8"})
