#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""ResNet-50 (torchvision, random weights) in PyTorch: eager and as a CUDA graph, fp32 and fp16."""
import equality
import torch_parts as parts


def program(outputs):
    torch = parts.pinned_torch()
    with torch.inference_mode():
        model, images = parts.resnet50(), torch.randn(4, 3, 224, 224).cuda()
    parts.infer_every_way(torch, outputs, model, images)


if __name__ == "__main__":
    equality.main(__file__, ["torch", "torchvision"], program,
                  environment=lambda: parts.ENVIRONMENT)
