#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Do many chains on few cores cost too much, or miss more with UrgenGo than without?

Each chain is a thread of one program (urgengo_thread_mix) on the simulated GPU: every 100 ms some
kernels of 50 us, so many that all together are at --load, with arrivals spread over the period, or
--at-once. Rows: bare, and under UrgenGo as configured by default, with no profile. The program's own
threads and those of the simulated GPU use the same cores, so what UrgenGo costs is the cores that a
row takes more than bare.

  tools/bench/many_chains.py --build build/release --counts 48,64,256 --rounds 3 --out many.json
  taskset -c 0,1 tools/bench/many_chains.py                        # on two cores of a larger machine

Exit status 0 if under UrgenGo no more is missed than bare (--most-more points), for at most
--most-cores; else 1.
"""
import argparse
import json
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import mix_plan  # noqa: E402
import result_file  # noqa: E402

ROWS = ("bare", "urgengo")
PERIOD_MS, KERNEL_US, LAUNCH_OVERHEAD_US = 100, 50, 2
TIMEOUT_S = 120


def spec_of(count, load, spread):
    """@param spread  the arrivals, over the period; else all come at once
    @returns a spec for urgengo_thread_mix"""
    kernels = max(1, round(1000 * PERIOD_MS * load / count / (KERNEL_US + LAUNCH_OVERHEAD_US)))
    return {"chains": [{"name": f"c{i}", "period_ms": PERIOD_MS, "deadline_ms": PERIOD_MS,
                        "offset_ms": PERIOD_MS * i / count if spread else 0, "kernels": kernels,
                        "kernel_us": KERNEL_US, "streams": 1} for i in range(count)]}


class Runs:
    def __init__(self, args, folder):
        self.args, self.folder = args, folder
        simulated = str((args.build / "lib/simgpu").resolve())
        self.environment = result_file.without_urgengo(os.environ) | {
            "LD_LIBRARY_PATH": simulated, "URGENGO_REAL_LIBCUDA": simulated + "/libcuda.so.1"}

    def run(self, row, count):
        """@returns misses and cores of one process"""
        spec, out, stats, config = (self.folder / name for name in
                                    ("spec.json", "out.json", "stats.json", "chains.yaml"))
        its = spec_of(count, self.args.load, not self.args.at_once)
        result_file.write(spec, its)
        config.write_text(mix_plan.config_text(its["chains"], self.args.scheduler, ""))
        command = [str((self.args.build / "bin/urgengo_thread_mix").resolve()), "--spec", str(spec),
                   "--seconds", str(self.args.seconds), "--seed", "1", "--json", str(out)]
        if row != "bare":
            command = [str((self.args.build / "bin/urgengo").resolve()), "run", "-c", str(config),
                       "--quiet", "--stats", str(stats), "--", *command]
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        subprocess.run(command, env=self.environment, check=True, capture_output=True,
                       timeout=TIMEOUT_S)
        wall_s, after = time.monotonic() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        chains = json.loads(out.read_text())["chains"]
        found = {"row": row, "chains": count, "frames": sum(one["frames"] for one in chains),
                 "missed": sum(one["missed"] for one in chains), "cores": round(cpu_s / wall_s, 3)}
        if row != "bare":
            its_stats = json.loads(stats.read_text())
            found["warnings"] = its_stats["warnings"]
            found["holds"] = sum(one["holds"] for one in its_stats["chains"])
        print(f"  {count} chains, {row}: {found['missed']} of {found['frames']} missed, "
              f"{found['cores']:.2f} cores", file=sys.stderr, flush=True)
        return found


def compare(runs, counts):
    """@returns of each count, medians: misses, %, and cores of each row, and the cores more"""
    cells = []
    for count in counts:
        cell = {"chains": count}
        for row in ROWS:
            its = [run for run in runs if (run["chains"], run["row"]) == (count, row)]
            cell[row] = {
                "missed_pct": round(statistics.median(100 * run["missed"] / run["frames"]
                                                      for run in its), 3),
                "cores": round(statistics.median(run["cores"] for run in its), 3)}
        cell["cores_more"] = round(cell["urgengo"]["cores"] - cell["bare"]["cores"], 3)
        cells.append(cell)
    return cells


def parse():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=pathlib.Path("build/release"),
                        help="folder with bin/urgengo and lib/simgpu [build/release]")
    parser.add_argument("--counts", default="48,64,256", help="of chains, 1 to 256 [48,64,256]")
    parser.add_argument("--load", type=float, default=0.38, help="of the GPU, by all [0.38]")
    parser.add_argument("--at-once", action="store_true", help="all frames of a period arrive at once")
    parser.add_argument("--seconds", type=float, default=8, help="of a run [8]")
    parser.add_argument("--rounds", type=int, default=3, help="all rows in turns [3]")
    parser.add_argument("--scheduler", default="", metavar="KEYS", help="of scheduler:")
    parser.add_argument("--most-more", type=float, default=0.2, metavar="POINTS",
                        help="missed more than bare [0.2]")
    parser.add_argument("--most-cores", type=float, default=0.5, help="more than bare [0.5]")
    parser.add_argument("--out", type=pathlib.Path, help="write all numbers to this JSON file")
    parser.add_argument("--commit", default="", help="that was built, for the JSON file")
    args = parser.parse_args()
    words = args.counts.split(",")
    if not all(word.isdigit() and 1 <= int(word) <= 256 for word in words):
        parser.error(f"--counts: found {args.counts}, accepted: 1 to 256, with commas between them")
    args.counts = [int(word) for word in words]
    if args.rounds < 1 or args.seconds <= 0 or not 0 < args.load <= 1:
        parser.error("accepted: --rounds from 1, --seconds above 0, --load above 0, up to 1")
    return args


def main():
    args = parse()
    with tempfile.TemporaryDirectory() as folder:
        runs = Runs(args, pathlib.Path(folder))
        try:
            found = [runs.run(row, count) | {"round": turn} for turn in range(args.rounds)
                     for count in args.counts for row in mix_plan.in_turns(ROWS, turn)]
        except subprocess.CalledProcessError as error:
            sys.exit(f"exit status {error.returncode}: {(error.stdout + error.stderr)[-800:]}")
        except subprocess.TimeoutExpired:
            sys.exit(f"a program hung for {TIMEOUT_S} s")
    cells = compare(found, args.counts)
    for cell in cells:
        print(f"{cell['chains']:>4} chains: bare {cell['bare']['missed_pct']:.1f} %, urgengo "
              f"{cell['urgengo']['missed_pct']:.1f} %, for {cell['cores_more']:.2f} cores more")
    if args.out:
        result_file.write(args.out, {
            **result_file.where_and_when("tools/bench/many_chains.py", args.build, args.commit),
            "load": args.load, "at_once": args.at_once, "cells": cells, "runs": found})
    sys.exit(any(cell["cores_more"] > args.most_cores or cell["urgengo"]["missed_pct"] >
                 cell["bare"]["missed_pct"] + args.most_more for cell in cells))


if __name__ == "__main__":
    main()
