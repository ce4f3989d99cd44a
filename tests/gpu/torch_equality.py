#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A PyTorch program gives the same bits bare and under UrgenGo.

Runs one program (matrix products, half-precision convolutions, a captured CUDA graph that is
replayed) in a thread named pt_chain, alone and beside a second thread that keeps the GPU busy: bare,
several times, to show that it is deterministic at all; under the preload without a config; and with
a config that names both threads as chains, the second as the more urgent one, in observe and in
enforce mode. Every output must be bit-equal. Exit status 0 if so, 1 if not, 77 (skipped) without
PyTorch or a GPU.
"""
import argparse
import hashlib
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

CONFIG = """version: 1
mode: {mode}
chains:
  - name: pt
    period_ms: 100
    deadline_ms: 500
    tasks: [{{name: all, thread: "pt_chain"}}]
  - name: other
    period_ms: 20
    deadline_ms: 10
    tasks: [{{name: all, thread: "pt_other"}}]
"""


def name_thread(name):
    import ctypes

    ctypes.CDLL(None).prctl(15, name.encode(), 0, 0, 0)  # PR_SET_NAME


def program(outputs):
    """What is compared: appends the bytes of every result."""
    import torch

    name_thread("pt_chain")
    generator = torch.Generator(device="cpu").manual_seed(1)

    def random(*shape):
        return torch.randn(*shape, generator=generator)

    product, factor = random(1024, 1024).cuda(), random(1024, 1024).cuda()
    for _ in range(50):
        product = (product @ factor) / 32
    torch.cuda.synchronize()
    outputs.append(product.cpu().numpy().tobytes())

    image = random(8, 64, 56, 56).half().cuda()
    weight = random(64, 64, 3, 3).half().cuda() * 0.05
    for _ in range(20):
        image = torch.nn.functional.conv2d(image, weight, padding=1)
    outputs.append(image.cpu().numpy().tobytes())

    static = random(512, 512).cuda()
    side = torch.cuda.Stream()
    side.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(side):
        for _ in range(3):
            result = (static @ static).relu().sum(0)
    torch.cuda.current_stream().wait_stream(side)
    graph = torch.cuda.CUDAGraph()
    # thread_local: in the default mode the other thread's synchronisation would break the capture.
    with torch.cuda.graph(graph, capture_error_mode="thread_local"):
        result = (static @ static).relu().sum(0)
    for _ in range(20):
        static.mul_(0.99)
        graph.replay()
    torch.cuda.synchronize()
    outputs.append(result.cpu().numpy().tobytes())


def busy(stop):
    """A second chain, on its own stream, that keeps the first one waiting."""
    import torch

    name_thread("pt_other")
    with torch.cuda.stream(torch.cuda.Stream()):
        x = torch.randn(2048, 2048, device="cuda")
        while not stop.is_set():
            for _ in range(20):
                x = torch.tanh(x)
            torch.cuda.current_stream().synchronize()


def work(beside):
    import threading

    import torch

    # Kernels chosen by timing, or by what another thread does at the time, would differ bare, too.
    torch.backends.cudnn.benchmark = False
    torch.backends.cudnn.deterministic = True
    stop = threading.Event()
    threads = [threading.Thread(target=busy, args=(stop,))] if beside else []
    outputs = []
    for thread in threads:
        thread.start()
    main = threading.Thread(target=program, args=(outputs,))
    main.start()
    main.join()
    stop.set()
    for thread in threads:
        thread.join()
    if len(outputs) != 3:
        sys.exit("the program failed")
    print(json.dumps([hashlib.sha256(o).hexdigest() for o in outputs]))


def run(command, environment=None):
    done = subprocess.run(command, env={**os.environ, **(environment or {})}, text=True,
                          capture_output=True, timeout=300)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}: exit status {done.returncode}\n{done.stderr}")
    return json.loads(done.stdout)


def compare(build, out):
    try:
        import torch
        if not torch.cuda.is_available():
            raise ImportError("no GPU")
    except ImportError as missing:
        print(f"skipped: {missing}")
        sys.exit(77)

    library = build / "lib/urgengo/libcuda.so.1"
    me = [sys.executable, __file__, "--work"]
    rows = {"bare": run(me), "bare again": run(me), "bare, beside": run(me + ["--beside"]),
            "bare, beside, again": run(me + ["--beside"]),
            "preload, no config": run(me, {"LD_PRELOAD": str(library)})}
    held = {}
    with tempfile.TemporaryDirectory() as folder:
        for mode in ("observe", "enforce"):
            config = pathlib.Path(folder, f"{mode}.yaml")
            config.write_text(CONFIG.format(mode=mode))
            for beside in (False, True):
                name = f"{mode}{', beside' if beside else ''}"
                stats = pathlib.Path(folder, "stats.json")
                rows[name] = run([str(build / "bin/urgengo"), "run", "-c", str(config), "--quiet",
                                  "--stats", str(stats), "--"] + me + (["--beside"] * beside))
                held[name] = json.loads(stats.read_text())["chains"][0]
    expected = rows["bare"]
    for name, row in rows.items():
        counts = held.get(name, {})
        print(f"{name:<24} {'equal' if row == expected else 'DIFFERENT':<10}"
              f" launches {counts.get('launches', '-'):>6} marks {counts.get('marks', '-'):>5}"
              f" holds {counts.get('holds', '-'):>5}")
    if out:
        version = subprocess.run([str(build / "bin/urgengo"), "--version"], text=True,
                                 capture_output=True).stdout.strip()
        driver = subprocess.run(["nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader"],
                                text=True, capture_output=True).stdout.strip()
        out.write_text(json.dumps({
            "format_version": 1, "program": "tests/gpu/torch_equality.py",
            "gpu": torch.cuda.get_device_name(), "driver": driver, "torch": torch.__version__,
            "urgengo": version, "date_utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            "command_line": "tests/gpu/torch_equality.py --build " + build.name,
            "sha256": rows, "chain pt": held}, indent=1) + "\n")
    scheduled = held["enforce"]["marks"] > 0 and held["enforce, beside"]["holds"] > 0
    sys.exit(0 if scheduled and all(row == expected for row in rows.values()) else 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", type=pathlib.Path, default="build/release",
                        help="build folder with bin/urgengo and lib/urgengo")
    parser.add_argument("--out", type=pathlib.Path, help="write the digests to this JSON file")
    parser.add_argument("--work", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--beside", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.work:
        work(args.beside)
    else:
        compare(args.build.resolve(), args.out)


if __name__ == "__main__":
    main()
