#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What does a dispatcher on the GPU cost the work beside it?

The dispatcher's own kernels (device/dispatcher.cu) over two tasks whose gates never open, beside
work that fills the GPU, in one process: `memory` streams; `compute` takes half of the thread slots,
`slots` all of them, in 20 waves; `shared` is one block a multiprocessor that takes its shared memory;
and ResNet-50, batch 32, where there is PyTorch. Rows, in turn: none; leased, resident one lease after
the other; marks, plain ones every 200 us of work; piggyback, each of which runs a round; armed, each
of which wakes an arm. And how long a decision takes on the GPU and on the host's processor
(tests/gpu/dispatch_equality.cu), for 10, 64 and 256 tasks.

  tools/bench/residency_cost.py --build build/release --out result.json
  tools/bench/residency_cost.py --build build/release --rounds 5 --decisions 2000    # 100 seconds

Exit status 0 if all rows ran and the resident kernel was there for 90 % of the time, 1 if not, 77
(skipped) without nvcc or a GPU.
"""
import argparse
import ctypes
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT / "tests/gpu"))
sys.path.insert(0, str(HERE))
import build_math_libraries  # noqa: E402
import equality  # noqa: E402
import result_file  # noqa: E402

ROWS = ("none", "leased", "marks", "piggyback", "armed")
MARKS = {"marks": 1, "piggyback": 2, "armed": 3}
WORKS = ("memory", "compute", "slots", "shared")
GOALS_PCT = {"leased": 5, "piggyback": 0.5, "armed": 0.5}
GOAL_SLOTS_PCT, LEAST_RESIDENCY = 11, 0.9
LAUNCH_US, ROUND_US, LEASE_US, MARK_EVERY_US = 100, 40_000, 2000, 200
WARM_UP_LAUNCHES, BATCH = 20, 32


class Failed(Exception):
    pass


def compile_parts(folder):
    library = folder / "librc.so"
    shared = ["-std=c++20", "-O2", "--expt-relaxed-constexpr", "-fmad=false", f"-I{ROOT}",
              f"-I{ROOT}/include"]
    build_math_libraries.compile_with_nvcc(
        [*shared, "-shared", "-Xcompiler", "-fPIC", str(HERE / "residency_cost.cu"), "-o",
         str(library)])
    return library


class Gpu:
    def __init__(self, library):
        self.library = ctypes.CDLL(str(library))
        self.must("rc_begin")

    def must(self, name, *arguments):
        error = getattr(self.library, name)(*arguments)
        if error != 0:
            raise Failed(f"{name} answers CUDA error {error}")

    def work_ms(self, kind, size, launches, marks, mark_every):
        ms = ctypes.c_float()
        self.must("rc_work", kind, size, launches, marks, mark_every, ctypes.byref(ms))
        return ms.value

    def resident(self, run):
        """@returns what run() returns, and for which share of the time a lease was under way"""
        leases, us = ctypes.c_int(), ctypes.c_double()
        self.must("rc_leases_begin", LEASE_US)
        try:
            found = run()
        finally:
            self.must("rc_leases_end", ctypes.byref(leases), ctypes.byref(us))
        # And half of the one that is under way, on average.
        return found, (leases.value + 0.5) * LEASE_US / us.value

    def armed(self, run):
        """@returns what run() returns"""
        self.must("rc_arms_begin")
        try:
            return run()
        finally:
            self.must("rc_arms_end")

    def mark(self, stream, kind):
        self.must("rc_mark", ctypes.c_void_p(stream), kind)

    def opened(self):
        """@returns gates that have opened, and rounds of the GPU"""
        rounds = ctypes.c_int()
        return self.library.rc_opened(ctypes.byref(rounds)), rounds.value


class KernelWork:
    """One of the library's own kernels, again and again."""

    def __init__(self, gpu, kind):
        self.gpu, self.kind = gpu, kind
        size = 64 if kind == 0 else 500
        self.size = size
        per_us = self._launch_us(size)
        if kind != 0:
            self.size = max(1, round(size * LAUNCH_US / per_us))
            per_us = self._launch_us(self.size)
        self.launches = max(1, round(ROUND_US / per_us))
        self.mark_every = max(1, round(MARK_EVERY_US / per_us))
        self.about = {"launch_us": round(per_us, 1), "launches": self.launches,
                      "mark_every": self.mark_every}

    def _launch_us(self, size):
        for _ in range(2):  # the first one loads it
            ms = self.gpu.work_ms(self.kind, size, WARM_UP_LAUNCHES, 0, 1)
        return 1000 * ms / WARM_UP_LAUNCHES

    def __call__(self, marks):
        return self.gpu.work_ms(self.kind, self.size, self.launches, marks, self.mark_every)


class ResNet:
    """Inferences on a stream of its own, with a mark behind each block."""

    def __init__(self, gpu, torch, torchvision):
        self.gpu, self.torch, self.marks = gpu, torch, 0
        self.model = torchvision.models.resnet50(weights=None).eval().cuda()
        self.input = torch.randn(BATCH, 3, 224, 224, device="cuda")
        self.stream = torch.cuda.Stream()
        blocks = [m for m in self.model.modules()
                  if isinstance(m, torchvision.models.resnet.Bottleneck)]
        for block in blocks:
            block.register_forward_hook(self._hook)
        self.inferences = 1
        self._time_ms(10)
        self.inferences = max(1, round(ROUND_US / 1000 / self._time_ms(10) * 10))
        self.about = {"inferences": self.inferences, "marks_of_one": len(blocks)}

    def _hook(self, *_):
        if self.marks:
            self.gpu.mark(self.stream.cuda_stream, self.marks)

    def _time_ms(self, inferences):
        torch = self.torch
        begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
        with torch.inference_mode(), torch.cuda.stream(self.stream):
            begin.record()
            for _ in range(inferences):
                self.model(self.input)
            end.record()
        end.synchronize()
        return begin.elapsed_time(end)

    def __call__(self, marks):
        self.marks = marks
        try:
            return self._time_ms(self.inferences)
        finally:
            self.marks = 0


def resnet_or_why_not(gpu):
    try:
        import torch
        import torchvision
    except ImportError as error:
        return None, str(error)
    return ResNet(gpu, torch, torchvision), ""


def measure(gpu, work, rounds):
    times, residency = {row: [] for row in ROWS}, []
    for number in range(rounds):
        # Another row first in each round: clocks drift.
        for row in ROWS[number % len(ROWS):] + ROWS[:number % len(ROWS)]:
            if row == "leased":
                ms, share = gpu.resident(lambda: work(0))
                residency.append(share)
            elif row == "armed":
                ms = gpu.armed(lambda: work(MARKS[row]))
            else:
                ms = work(MARKS.get(row, 0))
            times[row].append(ms)
    base = statistics.median(times["none"])
    found = {}
    for row, its in times.items():
        quarters = statistics.quantiles(its, n=4, method="inclusive") if len(its) > 1 else its * 3
        found[row] = {"median_ms": round(statistics.median(its), 4),
                      "slower_pct": round(100 * (statistics.median(its) / base - 1), 2),
                      "spread_pct": round(100 * (quarters[2] - quarters[0]) / base, 2),
                      "ms": [round(ms, 4) for ms in its]}
    found["leased"]["residency"] = round(statistics.median(residency), 3)
    return {**work.about, "rows": found}


def goal_of(work, row):
    return GOAL_SLOTS_PCT if (work, row) == ("slots", "leased") else GOALS_PCT.get(row)


def tell(name, found):
    for row, its in found["rows"].items():
        goal = goal_of(name, row)
        more = f"  residency {100 * its['residency']:.0f} %" if "residency" in its else ""
        verdict = "" if goal is None else f"  goal {goal} %" + \
            ("" if its["slower_pct"] <= goal else ": ABOVE")
        print(f"{name:9} {row:10} {its['median_ms']:9.3f} ms  {its['slower_pct']:+7.2f} %  "
              f"spread {its['spread_pct']:5.2f} %{more}{verdict}", flush=True)


def decisions(build, snapshots):
    done = subprocess.run([sys.executable, str(ROOT / "tests/gpu/dispatch_equality.py"), "--build",
                           str(build), "--snapshots", str(snapshots)], text=True,
                          capture_output=True, check=False)
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return {"status": done.returncode, "times": [line for line in lines if "gpu_round_us" in line],
            "equality": next((line for line in lines if "snapshots" in line), None)}


def run_all(options, folder):
    gpu = Gpu(compile_parts(folder))
    works = {name: KernelWork(gpu, WORKS.index(name)) for name in WORKS
             if name in options.works.split(",")}
    left_out = {}
    if "resnet50" in options.works.split(","):
        resnet, why = resnet_or_why_not(gpu)
        if resnet:
            works["resnet50"] = resnet
        else:
            left_out["resnet50"] = why
    found, wrong = {}, []
    for name, work in works.items():
        found[name] = measure(gpu, work, options.rounds)
        tell(name, found[name])
        residency = found[name]["rows"]["leased"]["residency"]
        if not LEAST_RESIDENCY <= residency <= 1.02:
            wrong.append(f"{name}: the resident kernel was there {100 * residency:.0f} % of the "
                         "time: it shows nothing")
    opened, rounds = gpu.opened()
    if opened or not rounds:
        wrong.append(f"{opened} gates opened, {rounds} rounds: it shows nothing")
    for name, why in left_out.items():
        print(f"{name}: left out: {why}")
    its = decisions(options.build, options.decisions)
    for line in its["times"]:
        print(f"{line['tasks']:4} tasks, {line['threads']:3} threads: GPU {line['gpu_round_us']:7.2f} "
              f"us, host {line['cpu_round_us']:7.2f} us")
    if its["status"] != 0:
        wrong.append(f"dispatch_equality: exit status {its['status']}")
    above = [f"{name}, {row}: {line['slower_pct']} %" for name, one in found.items()
             for row, line in one["rows"].items()
             if goal_of(name, row) is not None and line["slower_pct"] > goal_of(name, row)]
    return {"works": found, "left_out": left_out, "gpu_rounds": rounds, "decisions": its,
            "above_goal": above, "wrong": wrong}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=pathlib.Path("build/release"),
                        help="folder with bin/urgengo and lib/urgengo [build/release]")
    parser.add_argument("--rounds", type=int, default=15, help="of each row [15]")
    parser.add_argument("--works", default=",".join((*WORKS, "resnet50")), help="[all]")
    parser.add_argument("--decisions", type=int, default=20000, help="random snapshots [20000]")
    parser.add_argument("--out", type=pathlib.Path, help="write all numbers to this JSON file")
    parser.add_argument("--commit", default="", help="that was built, for the JSON file")
    options = parser.parse_args()
    unknown = set(options.works.split(",")) - {*WORKS, "resnet50"}
    if unknown:
        parser.error(f"--works: found '{min(unknown)}', accepted: {','.join(WORKS)},resnet50")
    equality.skip_if(equality.why_not_here([]))
    equality.skip_if("" if build_math_libraries.nvcc() else "no nvcc")
    options.build = equality.check_build(options.build)
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = run_all(options, pathlib.Path(folder))
        except Failed as error:
            found = {"wrong": [str(error)]}
    for line in found["wrong"]:
        print(f"FAILURE: {line}")
    if options.out:
        result_file.write(options.out, {
            **result_file.where_and_when("tools/bench/residency_cost.py", options.build,
                                         options.commit), **found})
    return 1 if found["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
