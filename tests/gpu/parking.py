#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Which driver calls wait for a kernel that stays or a gate that is closed, and are those UrgenGo's?

Compiles parking.cu here and runs it. Bare: a call that waits must be one before which UrgenGo opens
all gates and ends its resident kernel (`parks` of parking_table.h). Then, bare and under UrgenGo with
gates that the GPU opens: the call is made by a thread of no chain, while a chain's kernel is on the
GPU and another's behind a gate. It must not take longer than bare, and all kernels must have run.

  tests/gpu/parking.py --build build/release --out result.json
  tests/gpu/parking.py --build build/release --simulated   # to try the script: compares no times

Exit status 0 if so, 1 if not, 77 (skipped) without nvcc or a GPU.
"""
import argparse
import json
import math
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

import build_math_libraries
import equality

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools/bench"))
import result_file  # noqa: E402
from dispatch_ways import DISPATCH, dispatch_key  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
MORE_SHARE = 0.15  # calls that make or end contexts take hundreds of ms, and never twice the same
TIMEOUT_S, LEARN_ROUNDS, KERNEL_MS = 240, 25, 20
# Nothing shares the GPU with the urgent chain, so that each of the loose one's launches has a gate.
CONFIG = """version: 1
mode: enforce
scheduler:
  {{guard: off, pack_limit: 0.1, share_limit: 0.1, share_slack_us: 10000000{dispatch}}}
chains:
  - name: urgent
    period_ms: 50
    deadline_ms: 40
    tasks: [{{name: urgent, thread: urgent}}]
  - name: loose
    period_ms: 50
    deadline_ms: 400
    tasks: [{{name: loose, thread: loose}}]
"""
SIMULATED_COSTS = {"bare": 100_000_000, "rounds": KERNEL_MS * 1_000_000}  # of a spinning kernel


class Failed(Exception):
    pass


class Runs:
    def __init__(self, options, folder):
        self.options, self.folder = options, folder
        self.program = str(folder / "parking")
        self.build = equality.check_build(options.build)
        self.urgengo = str(self.build / "bin/urgengo")
        self.profile = folder / "profile.json"
        self.fatbin = folder / "image.fatbin"
        self.driver = []
        if options.simulated:
            self.driver = ["--real-libcuda", str(self.build / "lib/simgpu/libcuda.so.1")]

    def environment(self, what):
        its = result_file.without_urgengo(dict(os.environ))
        its["URGENGO_SHARE"] = str(self.folder)
        # As gates need them, in all rows: contexts take longer to make with so many.
        its["CUDA_DEVICE_MAX_CONNECTIONS"] = "32"
        its["PARKING_FATBIN"] = str(self.fatbin)
        if self.options.simulated:
            costs = self.folder / f"{what}.json"
            costs.write_text(json.dumps({"kernels": [
                {"name": "parking_spin", "block_ns": SIMULATED_COSTS[what], "blocks_per_sm": 4},
                {"name": "parking_nop", "block_ns": 1000}]}))
            its.update(LD_LIBRARY_PATH=str(self.build / "lib/simgpu"), SIMGPU_COSTS=str(costs),
                       PARKING_SIMULATED="1")
        return its

    def compile(self):
        arch = [] if self.options.simulated else ["-arch=native"]
        build_math_libraries.compile_with_nvcc(
            ["-std=c++20", *arch, f"-I{ROOT}", str(HERE / "parking.cu"), "-lcuda", "-o",
             self.program])
        # The simulated GPU reads the text.
        image = self.folder / "image.ptx"
        image.write_text(subprocess.run([self.program, "image"], text=True, capture_output=True,
                                        env=self.environment("bare"), check=True).stdout)
        if not self.options.simulated:
            build_math_libraries.compile_with_nvcc(["-fatbin", str(image), "-o", str(self.fatbin)])
        else:
            image.rename(self.fatbin)

    def run(self, command, what):
        try:
            done = subprocess.run(command, text=True, capture_output=True, timeout=TIMEOUT_S,
                                  env=self.environment(what), check=False)
        except subprocess.TimeoutExpired as error:
            printed = (error.stdout or b"").decode().splitlines()
            raise Failed(f"hangs: not done after {TIMEOUT_S} s; the last line was "
                         f"{printed[-1] if printed else 'none'}") from error
        equality.skip_if("no GPU" if done.returncode == equality.SKIPPED else "")
        lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        if done.returncode != 0:
            raise Failed(f"{' '.join(command[-4:])}: exit status {done.returncode}: "
                         f"{done.stdout[-300:]}{done.stderr[-1000:]}")
        return lines

    def config(self, row):
        path = self.folder / "chains.yaml"
        path.write_text(CONFIG.format(dispatch=dispatch_key(row)))
        return str(path)

    def learn(self):
        self.run([self.urgengo, "profile", *self.driver, "-c", self.config("thread"), "-o",
                  str(self.profile), "--", self.program, "learn", str(LEARN_ROUNDS),
                  str(KERNEL_MS)], "rounds")

    def rounds(self, row):
        command = [self.program, "rounds", str(self.options.rounds), str(KERNEL_MS)]
        stats = self.folder / "stats.json"
        if row != "bare":
            command = [self.urgengo, "run", *self.driver, "-c", self.config(row), "--quiet",
                       "--profile", str(self.profile), "--stats", str(stats), "--", *command]
        lines = self.run(command, "rounds")
        calls = {line["call"]: line for line in lines if "call" in line}
        known = json.loads(stats.read_text()) if row != "bare" else {}
        return {"calls": calls, "gates": known.get("gates"), "tripped": known.get("tripped", ""),
                "rounds": lines[-1]["rounds"], "right": lines[-1]["right"]}


def waits_unparked(table):
    return [f"{row['call']} waits for {what} and does not park" for row in table
            for what in ("kernel", "gate") if not row.get("skipped") and not row["parks"] and
            row[f"waits_for_{what}"]]


def median_ms(line):
    return statistics.median(line["us"]) / 1000 if line["us"] else 0


def wrong_in(row, found, bare, table, more_ms):
    wrong = [] if found["right"] else [f"{row}: not each kernel has run once"]
    if found["tripped"]:
        wrong.append(f"{row}: UrgenGo gave up: {found['tripped']}")
    if found["gates"]["closed"] < found["rounds"] / 2 or not found["gates"]["parks"]:
        wrong.append(f"{row}: gates {found['gates']}: it shows nothing")
    parks = {its["call"] for its in table if its.get("parks")} if table else set()
    for call, line in found["calls"].items():
        if call in parks and not line["gated"]:
            wrong.append(f"{row}: {call} met no closed gate: it shows nothing")
        took, alone = median_ms(line), median_ms(bare["calls"][call])
        if line["failed"] != bare["calls"][call]["failed"]:
            wrong.append(f"{row}: {call} fails {line['failed']} times")
        # A call that waits makes the gated kernel go, which takes its whole time from then on.
        if alone > KERNEL_MS / 2:
            alone = max(alone, KERNEL_MS)
        if took > (1 + MORE_SHARE) * alone + more_ms:
            wrong.append(f"{row}: {call} takes {took:.1f} ms, bare {alone:.1f}")
    return wrong


def print_table(table, rows):
    print(f"{'call':38} {'waits for':12} {'parks':6}" +
          "".join(f"{row + ' ms':>13}" for row in rows))
    bare = {row["call"]: row for row in table}
    for call, its in bare.items():
        if its.get("skipped"):
            print(f"{call:38} (not here)")
            continue
        waits = [what for what in ("kernel", "gate") if its[f"waits_for_{what}"]]
        times = [median_ms(rows[row]["calls"][call]) if call in rows[row]["calls"] else None
                 for row in rows]
        print(f"{call:38} {', '.join(waits) or '-':12} {'yes' if its['parks'] else 'no':6}" +
              "".join(f"{'' if ms is None else format(ms, '.2f'):>13}" for ms in times))


def run_all(options, folder):
    """@returns the result, and what is wrong"""
    runs = Runs(options, folder)
    runs.compile()
    table, wrong, rows = runs.run([runs.program, "bare"], "bare"), [], {}
    # What the simulated GPU does not wait for, or waits for, is nothing that a driver does.
    if not options.simulated:
        wrong += waits_unparked(table)
    runs.learn()
    for row in ("bare", *options.rows.split(",")):
        try:
            rows[row] = runs.rounds(row)
        except Failed as error:
            wrong.append(f"{row}: {error}")
            continue
        if row != "bare":
            wrong += wrong_in(row, rows[row], rows["bare"], table,
                              math.inf if options.simulated else options.more_ms)
    print_table(table, rows)
    for row, found in rows.items():
        if found["gates"]:
            print(f"{row}: {found['rounds']} rounds, {found['gates']['parks']} parks of "
                  f"{found['gates'].get('park_us', 0):.1f} us, {found['gates']['closed']} gates")
    return {"table": table, "rows": rows, "wrong": wrong}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=pathlib.Path("build/release"),
                        help="folder with bin/urgengo and lib/urgengo [build/release]")
    parser.add_argument("--rounds", type=int, default=3, help="of a call in a row [3]")
    parser.add_argument("--rows", default="armed,leased", help=f"of {','.join(DISPATCH)}; "
                        "bare is always there; marks of piggyback do not begin beside these kernels "
                        "[armed,leased]")
    parser.add_argument("--more-ms", type=float, default=2.0, help="that a call may take more than "
                        f"bare, and {100 * MORE_SHARE:.0f} %%, median of its rounds [2]")
    parser.add_argument("--simulated", action="store_true", help="on the simulated GPU")
    parser.add_argument("--out", type=pathlib.Path, help="write all numbers to this JSON file")
    parser.add_argument("--commit", default="", help="that was built, for the JSON file")
    options = parser.parse_args()
    unknown = set(options.rows.split(",")) - set(DISPATCH)
    if unknown:
        parser.error(f"--rows: found '{min(unknown)}', accepted: {', '.join(DISPATCH)}")
    if not options.simulated:
        equality.skip_if(equality.why_not_here([]))
    equality.skip_if("" if build_math_libraries.nvcc() else "no nvcc")
    # In memory, as the status page wants it.
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        try:
            found = run_all(options, pathlib.Path(folder))
        except Failed as error:
            found = {"wrong": [str(error)]}
    for line in found["wrong"]:
        print(f"FAILURE: {line}")
    if options.out:
        result_file.write(options.out, {
            **result_file.where_and_when("tests/gpu/parking.py", options.build, options.commit),
            "simulated": options.simulated, **found})
    return 1 if found["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
