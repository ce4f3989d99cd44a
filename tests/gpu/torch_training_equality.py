#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Training steps with fixed seeds in PyTorch: ResNet-50's and an encoder's parameters after SGD."""
import equality
import torch_parts as parts

STEPS = 2


def train(torch, outputs, model, inputs, loss_of):
    optimizer = torch.optim.SGD(model.parameters(), lr=0.01, momentum=0.9)
    model.train()
    for _ in range(STEPS):
        optimizer.zero_grad()
        loss = loss_of(model(inputs))
        loss.backward()
        optimizer.step()
    parts.collect(outputs, torch.cat([p.flatten() for p in model.parameters()]))
    parts.collect(outputs, loss)


def program(outputs):
    # Only a warning: of the max pooling that ResNet uses, the backward pass has no kernel that
    # PyTorch calls deterministic. The bare rows show that it is, for these tensors.
    torch = parts.pinned_torch(warn_only=True)
    # Where it only warns, it also takes the faster backward pass of attention, which is not.
    for fused in ("flash", "mem_efficient", "cudnn"):
        getattr(torch.backends.cuda, f"enable_{fused}_sdp")(False)
    labels = torch.randint(0, 1000, (8,)).cuda()
    train(torch, outputs, parts.resnet50(), torch.randn(8, 3, 96, 96).cuda(),
          lambda scores: torch.nn.functional.cross_entropy(scores, labels))
    wanted = torch.randn(4, 128, 512).cuda()
    train(torch, outputs, parts.encoder(torch, dropout=0.1), torch.randn(4, 128, 512).cuda(),
          lambda result: torch.nn.functional.mse_loss(result, wanted))


if __name__ == "__main__":
    # The backward pass is launched by a thread of the framework, on the chain's stream.
    equality.main(__file__, ["torch", "torchvision"], program,
                  environment=lambda: parts.ENVIRONMENT)
