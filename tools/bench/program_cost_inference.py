# SPDX-License-Identifier: Apache-2.0
"""The program that program_cost.py measures: inferences of one network, eager or as a graph."""
import pathlib
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests/gpu"))
sys.path.insert(0, str(HERE))
import driver_pointers  # noqa: E402
import equality  # noqa: E402
from program_cost_ratios import CHAIN, DIRECT  # noqa: E402

METRICS = ("latency_us", "thread_cpu_us", "process_cpu_us")
WARM_UP = 50
NUM_SKIPPED = 5  # of a block: the GPU comes from another process


class Inference:
    """In a process of its own: ResNet-50, in a thread that is the chain or is of none."""

    def __init__(self, batch, kinds):
        import torch
        import torchvision

        torch.backends.cudnn.benchmark = False  # nothing is chosen by timing
        torch.manual_seed(7)
        self.torch = torch
        self.model = torchvision.models.resnet50(weights=None).half().eval().cuda()
        self.picture = torch.randn(batch, 3, 224, 224).half().pin_memory()
        self.static = self.picture.cuda()
        with torch.inference_mode():
            for _ in range(WARM_UP):
                self.eager()
            torch.cuda.synchronize()
            self.captured = torch.cuda.CUDAGraph()
            with torch.cuda.graph(self.captured, capture_error_mode="thread_local"):
                self.scores = self.model(self.static)
            for _ in range(WARM_UP):
                self.graph()
        self.kinds = kinds
        self.pointers = driver_pointers.DriverPointers() if DIRECT in kinds else None
        if self.pointers:
            equality.name_thread(CHAIN)
            with torch.inference_mode():
                # Is no instance of the chain's: what_statistics_show() counts them.
                self.pointers.go(directly=True)
                self.eager()
                self.graph()

    def eager(self):
        self.static.copy_(self.picture, non_blocking=True)
        return self.model(self.static).cpu()

    def graph(self):
        self.static.copy_(self.picture, non_blocking=True)
        self.captured.replay()
        return self.scores.cpu()

    def one(self, infer):
        """@returns what an inference takes, in us"""
        begin = time.process_time_ns(), time.thread_time_ns(), time.perf_counter_ns()
        infer()
        end = time.perf_counter_ns(), time.thread_time_ns(), time.process_time_ns()
        return {name: (after - before) / 1000
                for name, before, after in zip(METRICS, reversed(begin), end)}

    def measure(self, program, count):
        """@returns times of `count` inferences of each kind, in turns"""
        infer, block = getattr(self, program), {kind: [] for kind in self.kinds}
        with self.torch.inference_mode():
            for kind, counts in self.turns(count):
                if self.pointers:
                    self.pointers.go(directly=kind == DIRECT)
                else:
                    equality.name_thread(kind)
                its = self.one(infer)
                if counts:
                    block[kind].append(its)
        return block

    def turns(self, count):
        """@returns the kinds of the inferences of a block, in turns, and whether each counts"""
        for i in range(NUM_SKIPPED + count):
            for kind in self.kinds:
                if self.pointers:
                    yield kind, False  # what it uses is in the caches, as far as it stays there
                yield kind, i >= NUM_SKIPPED
