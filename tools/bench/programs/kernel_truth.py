#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How long networks keep the GPU busy, by CUPTI through torch.profiler, and their latency alone.

Nothing of UrgenGo is in this process. Latencies are measured first, before any tool is loaded.
Graphs are then built anew: what was captured before CUPTI came may have no records of its kernels.

  kernel_truth.py --spec mix.json --out truth.json
"""
import argparse
import contextlib
import json
import pathlib
import statistics
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import kernel_intervals  # noqa: E402
import networks  # noqa: E402

SKIPPED = 77
WARM_UP_FRAMES = 12


def latency_ms(network, count):
    """@returns median and 90th percentile of frames back to back, each waited for"""
    with contextlib.ExitStack() as stack:
        network.enter(stack)
        for _ in range(WARM_UP_FRAMES):
            network.frame()
        times = []
        for _ in range(count):
            begin = time.perf_counter()
            network.frame()
            times.append((time.perf_counter() - begin) * 1000)
    return {"latency_ms": round(statistics.median(times), 5),
            "latency_p90_ms": round(sorted(times)[int(0.9 * (count - 1))], 5)}


def traced(network, count, torch):
    """@returns what torch.profiler recorded of so many frames"""
    activities = [torch.profiler.ProfilerActivity.CPU, torch.profiler.ProfilerActivity.CUDA]
    with contextlib.ExitStack() as stack, tempfile.TemporaryDirectory() as folder:
        network.enter(stack)
        for _ in range(WARM_UP_FRAMES):
            network.frame()
        with torch.profiler.profile(activities=activities) as profiler:
            for i in range(count):
                with torch.profiler.record_function(f"{kernel_intervals.FRAME} {i}"):
                    network.frame()
        path = pathlib.Path(folder, "trace.json")
        profiler.export_chrome_trace(str(path))
        return json.loads(path.read_text())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--spec", type=pathlib.Path, required=True,
                        help="of network_threads.py; periods and deadlines do not matter")
    parser.add_argument("--frames", type=int, default=30, help="recorded of each network [30]")
    parser.add_argument("--latency-frames", type=int, default=60)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    args = parser.parse_args()
    try:
        import torch
    except ImportError as error:
        print(f"skipped: {error}")
        sys.exit(SKIPPED)
    software = networks.set_up_torch()
    if software is None:
        print("skipped: no GPU")
        sys.exit(SKIPPED)
    found, built, broken = {}, {}, {}
    specs = {one["name"]: one for one in json.loads(args.spec.read_text())["networks"]}
    for name, spec in specs.items():
        try:
            built[name] = networks.TorchNetwork(spec)
            found[name] = latency_ms(built[name], args.latency_frames)
        except Exception as error:  # whatever a framework throws
            broken[name] = f"{type(error).__name__}: {error}"[:300]
    for i, name in enumerate(list(found)):
        try:
            if i == 0:
                traced(built[name], 3, torch)  # what the first one costs does not count
            if specs[name]["form"] == "graph":
                built[name] = networks.TorchNetwork(specs[name])
            frames = kernel_intervals.read_trace(traced(built[name], args.frames, torch))
            found[name] |= kernel_intervals.of_frames(frames)
            print(f"{name:<15} {specs[name]['form']:<8} latency {found[name]['latency_ms']:>8.3f} "
                  f"busy {found[name]['busy_ms']:>8.3f} sum {found[name]['sum_ms']:>8.3f} ms, "
                  f"{found[name]['kernels']} kernels on {found[name]['streams']} streams", flush=True)
        except Exception as error:
            broken[name] = f"{type(error).__name__}: {error}"[:300]
            del found[name]
    for name, why in broken.items():
        print(f"{name}: {why}", file=sys.stderr)
    args.out.write_text(json.dumps({**software, "networks": found, "broken": broken}, indent=1) +
                        "\n")


if __name__ == "__main__":
    main()
