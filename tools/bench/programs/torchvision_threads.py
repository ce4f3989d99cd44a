#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Vision networks as periodic threads: a camera's frames are classified, another's segmented.

An ordinary PyTorch program, as a robotics team would write it: every network has its own thread and
its own CUDA stream, takes a frame when it is due, copies it to the GPU, runs, and reads the result
back. It counts how many frames were later than their deadline and knows nothing of any scheduler.

  torchvision_threads.py --calibrate batches.json     # once: batch sizes that load this GPU
  torchvision_threads.py --batches batches.json --seconds 30 --json report.json

Random weights and random images, both seeded: the time that a network takes does not depend on
them. Without torchvision the networks are transformers' of the same kinds.
"""
import argparse
import json
import pathlib
import random
import statistics
import sys
import threading
import time

import torch

IMAGE_SIZE = 512
NUM_IMAGES = 4
WARM_UP_FRAMES = 20

# name, period, deadline, share of the GPU's load
NETWORKS = [("classify", 33.3, 25.0, 0.45), ("segment", 80.0, 80.0, 0.55)]
THIRD_NETWORK = ("depth", 100.0, 100.0, 0.3)


def make_with_torchvision(name):
    from torchvision import models

    if name == "classify":
        return models.resnet50(weights=None)
    if name == "segment":
        return models.segmentation.deeplabv3_resnet50(weights=None, weights_backbone=None)
    return models.segmentation.lraspp_mobilenet_v3_large(weights=None, weights_backbone=None)


def make_with_transformers(name):
    import transformers as t

    if name == "classify":
        return t.ResNetForImageClassification(t.ResNetConfig())
    if name == "segment":
        return t.SegformerForSemanticSegmentation(t.SegformerConfig(
            depths=[3, 4, 6, 3], hidden_sizes=[64, 128, 320, 512], decoder_hidden_size=768,
            num_labels=19))
    return t.ViTForImageClassification(t.ViTConfig(image_size=IMAGE_SIZE))


def make_network(name):
    """@returns the network on the GPU, and the library that it is from"""
    torch.manual_seed(1)
    try:
        network, library = make_with_torchvision(name), "torchvision"
    except ImportError:
        network, library = make_with_transformers(name), "transformers"
    return network.eval().cuda(), library


def scores_of(output):
    """Class scores, whatever kind of object the network returns."""
    if isinstance(output, torch.Tensor):
        return output
    return output["out"] if "out" in output else output["logits"]


class Camera:
    """A network with its stream, its pictures, and what became of its frames."""

    def __init__(self, name, period_ms, deadline_ms, batch, seed):
        self.name, self.period_ms, self.deadline_ms = name, period_ms, deadline_ms
        self.network, self.library = make_network(name)
        self.stream = torch.cuda.Stream()
        self.random = random.Random(seed)
        self.latencies_ms = []
        self.checksums = {}  # image -> every checksum seen
        self.set_batch(batch)

    def set_batch(self, batch):
        self.batch = batch
        generator = torch.Generator().manual_seed(2)
        self.images = [torch.rand(batch, 3, IMAGE_SIZE, IMAGE_SIZE,
                                  generator=generator).pin_memory() for _ in range(NUM_IMAGES)]

    def process(self, index):
        """One frame, from picture to labels in the host's memory."""
        with torch.inference_mode(), torch.cuda.stream(self.stream):
            image = self.images[index].to("cuda", non_blocking=True)
            scores = scores_of(self.network(image))
            small = torch.uint8 if scores.shape[1] <= 256 else torch.int16
            return scores.argmax(dim=1).to(small).cpu()

    def warm_up(self, frames=WARM_UP_FRAMES):
        for i in range(frames):
            self.process(i % NUM_IMAGES)

    def run(self, start, seconds, jitter_ms):
        for frame in range(int(seconds * 1000 / self.period_ms)):
            due = start + (frame * self.period_ms + self.random.uniform(0, jitter_ms)) / 1000
            time.sleep(max(0, due - time.monotonic()))
            index = frame % NUM_IMAGES
            labels = self.process(index)
            self.latencies_ms.append((time.monotonic() - due) * 1000)
            self.checksums.setdefault(index, set()).add(int(labels.sum()))

    def isolated_ms(self, frames=15):
        self.warm_up(5)
        times = []
        for i in range(frames):
            begin = time.monotonic()
            self.process(i % NUM_IMAGES)
            times.append((time.monotonic() - begin) * 1000)
        return statistics.median(times)

    def report(self):
        latencies = sorted(self.latencies_ms)
        missed = sum(latency > self.deadline_ms for latency in latencies)

        def at(share):
            return latencies[int(share * (len(latencies) - 1))]

        return {"name": self.name, "library": self.library, "batch": self.batch,
                "period_ms": self.period_ms, "deadline_ms": self.deadline_ms,
                "frames": len(latencies), "missed": missed,
                "miss_pct": 100 * missed / len(latencies),
                "latency_ms": {"p50": at(0.5), "p90": at(0.9), "p99": at(0.99), "max": at(1)},
                "checksums": {index: sorted(sums) for index, sums in self.checksums.items()}}


def calibrate(cameras, shares, load):
    """@returns the batch of each camera with which its frames take, alone, its share of the load"""
    batches = {}
    for camera, share in zip(cameras, shares):
        target_ms = load * share * camera.period_ms
        batch, last_ms, time_ms = 1, 0.0, camera.isolated_ms()
        while time_ms < target_ms and batch < 512:
            last_ms, batch = time_ms, batch * 2
            camera.set_batch(batch)
            time_ms = camera.isolated_ms()
        if batch > 1:  # between the last two
            batch = max(1, round(batch / 2 * (1 + (target_ms - last_ms) / (time_ms - last_ms))))
        camera.set_batch(batch)
        time_ms = camera.isolated_ms()
        print(f"{camera.name}: batch {batch}, {time_ms:.1f} ms alone, wanted {target_ms:.1f}")
        batches[camera.name] = {"batch": batch, "isolated_ms": time_ms}
    return batches


def name_thread(name):
    """For tools that list threads. Python does so by itself from 3.14 on."""
    import ctypes

    ctypes.CDLL(None).prctl(15, name.encode(), 0, 0, 0)


def run(cameras, args):
    ready = threading.Barrier(len(cameras) + 1)
    start = []

    def work(camera):
        try:
            if args.name_threads:
                name_thread(camera.name)
            camera.warm_up()
            ready.wait()  # everybody has warmed up
            ready.wait()  # the start is known
            camera.run(start[0], args.seconds, args.jitter_ms)
        except BaseException:
            ready.abort()
            raise

    threads = [threading.Thread(target=work, args=(camera,), name=camera.name)
               for camera in cameras]
    for thread in threads:
        thread.start()
    ready.wait()
    start.append(time.monotonic() + 0.2)
    ready.wait()
    for thread in threads:
        thread.join()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--json", type=pathlib.Path, help="write the report here as well")
    parser.add_argument("--networks", type=int, choices=(2, 3), default=2)
    parser.add_argument("--load", type=float, default=0.85,
                        help="share of the GPU's time that the networks need together [0.85]")
    parser.add_argument("--calibrate", type=pathlib.Path, metavar="FILE",
                        help="find the batch sizes for --load, write them, and stop")
    parser.add_argument("--batches", type=pathlib.Path, metavar="FILE", help="use them again")
    parser.add_argument("--jitter-ms", type=float, default=3.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--name-threads", action="store_true",
                        help="name the operating system's threads after the networks")
    args = parser.parse_args()
    if not args.calibrate and not args.batches:
        parser.error("--batches FILE is needed, or --calibrate FILE to make one")
    if not torch.cuda.is_available():
        print("skipped: no GPU")
        sys.exit(77)

    networks = NETWORKS + ([THIRD_NETWORK] if args.networks == 3 else [])
    known = json.loads(args.batches.read_text())["batches"] if args.batches else {}
    missing = [n[0] for n in networks if args.batches and n[0] not in known]
    if missing:
        sys.exit(f"{args.batches}: no batch for {', '.join(missing)}; calibrate again")
    cameras = [Camera(name, period, deadline, known.get(name, {}).get("batch", 1), args.seed + i)
               for i, (name, period, deadline, _) in enumerate(networks)]
    if args.calibrate:
        total = sum(n[3] for n in networks)
        batches = calibrate(cameras, [n[3] / total for n in networks], args.load)
        args.calibrate.write_text(json.dumps({"load": args.load, "batches": batches}, indent=1))
        return

    run(cameras, args)
    reports = [camera.report() for camera in cameras]
    print(f"{'network':<10} {'frames':>7} {'missed':>7} {'miss %':>7} {'deadline':>9}"
          f" {'p50 ms':>8} {'p99 ms':>8} {'max ms':>8}")
    for r in reports:
        latency = r["latency_ms"]
        print(f"{r['name']:<10} {r['frames']:>7} {r['missed']:>7} {r['miss_pct']:>7.1f}"
              f" {r['deadline_ms']:>9.1f} {latency['p50']:>8.1f} {latency['p99']:>8.1f}"
              f" {latency['max']:>8.1f}")
    overall = statistics.mean(r["miss_pct"] for r in reports)
    print(f"overall {overall:.1f} % missed (mean over networks)")
    if args.json:
        args.json.write_text(json.dumps({
            "gpu": torch.cuda.get_device_name(), "torch": torch.__version__,
            "seconds": args.seconds, "seed": args.seed, "jitter_ms": args.jitter_ms,
            "overall_miss_pct": overall, "networks": reports}, indent=1) + "\n")


if __name__ == "__main__":
    main()
