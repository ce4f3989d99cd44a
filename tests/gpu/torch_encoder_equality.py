#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A transformer encoder in PyTorch: eager and as a CUDA graph, fp32 and fp16."""
import equality
import torch_parts as parts


def program(outputs):
    torch = parts.pinned_torch()
    with torch.inference_mode():
        model, tokens = parts.encoder(torch), torch.randn(8, 256, 512).cuda()
    parts.infer_every_way(torch, outputs, model, tokens)


if __name__ == "__main__":
    equality.main(__file__, ["torch"], program, environment=lambda: parts.ENVIRONMENT)
