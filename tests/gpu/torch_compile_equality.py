#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""ResNet-50 (fp16) and a transformer encoder (fp32, fp16) through torch.compile, also in graphs."""
import equality
import torch_parts as parts


def program(outputs):
    torch = parts.pinned_torch()

    def use(model, inputs):
        compiled = torch.compile(model, dynamic=False)
        parts.infer(torch, outputs, compiled, inputs, 10)
        parts.infer(torch, outputs, parts.captured(torch, compiled, inputs), inputs, 10)

    with torch.no_grad():
        use(parts.resnet50().half(), torch.randn(4, 3, 224, 224).half().cuda())
        tokens = torch.randn(8, 256, 512).cuda()
        use(parts.encoder(torch), tokens)
        use(parts.encoder(torch).half(), tokens.half())


if __name__ == "__main__":
    equality.main(__file__, ["torch", "torchvision", "triton"], program,
                  environment=lambda: parts.ENVIRONMENT, compiles=True)
