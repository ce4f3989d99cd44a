#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Are the causes given for misses the causes? Compares them with CUPTI's records of the same run.

The ten chains (tools/chains) run under UrgenGo with --trace, and with CUPTI's concurrent-kernel
records beside it (cupti_kernels.cpp): once at low load, observed, for what is usual, then

  load       at f_a 1.1
  sizes      the same, inputs vary in size from frame to frame
  cpu        at f_a 0.9, C1 and C6 compute 25 ms longer than profiled
  gpu        at f_a 0.9, kernels of C4 and C8 take twice as long as profiled
  bystander  at f_a 0.9, kernels of 15 ms of a thread of no chain, every 100 ms

No chain ends a late frame early here (no on_late: exit), so that each can be judged. Which cause is
right says causes_analysis.py, by CUPTI alone but for the times of holds and waits. All late frames are
judged; --frames of them, drawn by --seed, are the result.

  tools/bench/causes_check.py --build build/release --out causes.json
  tools/bench/causes_check.py --simulated --cpu sleep --out causes.json   # a libcupti of the tests

The simulated GPU's kernels have the times that they should have, not those that they had: frames
that were late for that are left out. It is to try the program, not to measure. With --cpu sleep
nearly every CPU segment is longer than profiled: a profile has the time that a thread computes, a
live run the time that passes.

Exit status 0 if 28 of 30 are right (that share of --frames), 1 if not, 77 (skipped) without CUPTI.
"""
import argparse
import csv
import json
import lzma
import os
import pathlib
import random
import re
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import causes_analysis as analysis  # noqa: E402
import cupti_library  # noqa: E402
import result_file  # noqa: E402
from kill_switch import Bench, Failed  # noqa: E402

SKIPPED = 77
GOAL = 28 / 30
USUAL = "usual"
SCENARIOS = {
    USUAL: {"f_a": 0.4, "observe": True},
    "load": {"f_a": 1.1},
    "sizes": {"f_a": 1.1, "options": ("--variable",)},
    "cpu": {"f_a": 0.9, "cpu_more_ms": {"C1": 25, "C6": 25}},
    "gpu": {"f_a": 0.9, "gpu_times": {"C4": 2, "C8": 2}},
    "bystander": {"f_a": 0.9, "options": ("--bystander", "15", "--bystander-every", "100")},
}
PROFILE_F_A = 0.6


def disturbed(workload, scenario):
    """@returns the workload that this scenario runs"""
    for chain in workload["chains"]:
        chain["tasks"][0]["cpu_ms"] += scenario.get("cpu_more_ms", {}).get(chain["name"], 0)
        for task in chain["tasks"]:
            for kernel in task["kernels"]:
                kernel["iterations"] *= scenario.get("gpu_times", {}).get(chain["name"], 1)
    return workload


def kernels_by_chain(records, chains):
    """@returns {chain: kernels}, those of no chain under BYSTANDER; and how many have no launch"""
    found, unknown = {name: [] for name in [*chains, analysis.BYSTANDER]}, 0
    for kernel in records.kernels:
        if kernel.name not in cupti_library.CHAINS_KERNELS:
            continue  # a mark
        thread, launched_ns = records.launches.get(kernel.correlation, (None, None))
        unknown += thread is None
        chain = records.threads.get(thread, "").split(".")[0]
        begin_ns, end_ns = map(records.to_monotonic, (kernel.begin_ns, kernel.end_ns))
        found[chain if chain in chains else analysis.BYSTANDER].append(analysis.Kernel(
            begin_ns if launched_ns is None else min(launched_ns, begin_ns), begin_ns, end_ns))
    return found, unknown


def read_frames(table, info):
    """@param table  lines of `urgengo trace export --csv`
    @param info   of `urgengo trace info --json`"""
    deadlines = {chain["name"]: round(chain["deadline_ms"] * 1e6) for chain in info["chains"]}
    exited = {(frame["chain"], frame["frame"]) for frame in info["late"] if frame.get("exited")}
    frames, holds = [], {}
    for row in csv.DictReader(table):
        if not row["frame"] or not row["end_ns"]:
            continue
        which = (row["chain"], int(row["frame"]))
        if row["kind"] == "frame":
            frames.append(analysis.Frame(
                *which, int(row["begin_ns"]), int(row["end_ns"]), deadlines[row["chain"]],
                row["why"], row["behind"], int(row["cause_ns"] or 0), which in exited))
        elif row["kind"] in ("held", "gate", "paced", "wait"):
            holds.setdefault(which, []).append(analysis.Hold(
                int(row["begin_ns"]), int(row["end_ns"]), row["kind"], row["behind"]))
    return [frame._replace(holds=tuple(holds.get((frame.chain, frame.number), ())))
            for frame in frames]


def farthest_end_us(frames, report):
    """@returns by how much the trace and the program differ in when a frame ended, at most"""
    ends = {(chain["name"], record["arrival_ns"]): record["end_ns"]
            for chain in report["chains"] for record in chain["records"] if "end_ns" in record}
    return max((abs(ends[frame.chain, frame.arrival_ns] - frame.end_ns) / 1000 for frame in frames
                if (frame.chain, frame.arrival_ns) in ends), default=None)


class Checked(Bench):
    def __init__(self, options, folder, library):
        super().__init__(options, folder)
        if options.simulated:
            self.environment["TWIN_SIMGPU"] = self.driver[1]
        self.recorded = {**self.environment, "CUDA_INJECTION64_PATH": str(library),
                         "CUPTI_KERNELS": str(folder / "records"), "CUPTI_LAUNCHES": "1"}

    def must(self, what, command, environment=None):
        done = subprocess.run(command, env=environment or self.environment, cwd=self.folder,
                              text=True, capture_output=True, timeout=300)
        if done.returncode != 0:
            raise Failed(f"{what}: exit status {done.returncode}: {done.stderr.strip()[-2000:]}")
        return done.stdout

    def config(self, f_a):
        def at_load(match):
            return f"period_ms: {float(match[1]) / f_a:g}"
        text = re.sub(r" *on_late: exit.*\n", "",
                      (HERE.parent / "chains/chains.yaml").read_text())
        (self.folder / "c.yaml").write_text(re.sub(r"period_ms: ([0-9.]+)", at_load, text))
        return "c.yaml"

    def program(self, f_a, seconds, *more):
        return [self.chains, "run", "--f-a", str(f_a), "--seconds", str(seconds), "--cpu",
                self.options.cpu, "--quiet", *more]

    def prepare(self):
        self.must("calibrate", [self.chains, "calibrate"])
        self.must("profile", [self.urgengo, "profile", "-q", *self.driver, "-c",
                              self.config(PROFILE_F_A), "-o", "c.profile.json", "--source", "marks",
                              "--", *self.program(PROFILE_F_A, self.options.profile_seconds)])

    def run(self, name, usual=None):
        scenario = SCENARIOS[name]
        f_a = scenario["f_a"]
        workload = disturbed(json.loads((self.folder / "workload.json").read_text()), scenario)
        (self.folder / "its.json").write_text(json.dumps(workload))
        (self.folder / "records").unlink(missing_ok=True)
        self.must(name, [
            self.urgengo, "run", "-q", *self.driver, "-c", self.config(f_a), "--trace",
            "run.ugtrace", "--stats", "stats.json",
            *(["--observe"] if scenario.get("observe") else []), "--",
            *self.program(f_a, self.options.seconds, "--workload", "its.json", "--seed",
                          str(self.options.seed), "--instances", "--json", "report.json",
                          *scenario.get("options", ()))], self.recorded)
        return self.read_run(name, usual)

    def keep(self, name):
        """What a run left, compressed, to be looked at again without a GPU."""
        if not self.options.keep:
            return
        for part in ("records", "run.csv"):
            self.options.keep.mkdir(parents=True, exist_ok=True)
            with lzma.open(self.options.keep / f"{name}.{part}.xz", "wb", preset=1) as kept:
                kept.write((self.folder / part).read_bytes())

    def read_run(self, name, usual):
        """@returns the run's RunRecords, and what is told of them"""
        if not (self.folder / "records").exists():
            raise Failed(f"{name}: CUPTI has recorded nothing")
        self.must("export", [self.urgengo, "trace", "export", "--csv", "run.ugtrace", "-o",
                             "run.csv"])
        self.keep(name)
        info = json.loads(self.must("info", [self.urgengo, "trace", "info", "--json",
                                             "run.ugtrace"]))
        with open(self.folder / "run.csv", newline="") as table:
            frames = read_frames(table, info)
        records = cupti_library.read_records(self.folder / "records")
        chains = [chain["name"] for chain in info["chains"]]
        kernels, unknown = kernels_by_chain(records, chains)
        report = json.loads((self.folder / "report.json").read_text())
        stats = json.loads((self.folder / "stats.json").read_text())
        return analysis.RunRecords(frames, kernels, usual), {
            "f_a": SCENARIOS[name]["f_a"], "gpu": report["gpu"], "frames": len(frames),
            "late": sum(bool(frame.cause) for frame in frames),
            "miss_pct": 100 * report["overall_miss_ratio"], "urgengo": report["urgengo"],
            "tripped": stats["tripped"], "trace_lost": info["lost"],
            "kernels": sum(map(len, kernels.values())), "kernels_dropped": records.dropped,
            "kernels_of_no_launch": unknown,
            "clock_drift_ppm": (records.to_monotonic(1e9) - records.to_monotonic(0)) / 1e3 - 1e6,
            "ends_differ_at_most_us": farthest_end_us(frames, report)}


def line_of(verdict):
    def name(kind, behind):
        return f"{kind} {behind}".strip()
    components = ", ".join(f"{name(kind, behind)} {ms:.1f}"
                           for kind, behind, ms in verdict["components"][:5])
    for part in ("paced", "told_late"):  # with none of its kernels on the GPU
        if verdict["parts_ms"][part] > 0.1 * verdict["late_ms"]:
            components += f"; {part} {verdict['parts_ms'][part]:.1f}"
    return (f"{verdict['scenario']:<10} {verdict['chain']:>3} #{verdict['frame']:<4} late by "
            f"{verdict['late_ms']:7.2f} ms  {name(verdict['cause'], verdict['behind']):<20} "
            f"{verdict['cause_ms']:7.2f}  {'right' if verdict['right'] else 'WRONG'}  {components}")


def parse():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", default="build/release")
    parser.add_argument("--scenarios", default=",".join(name for name in SCENARIOS
                                                        if name != USUAL))
    parser.add_argument("--frames", type=int, default=30, help="that are drawn")
    parser.add_argument("--seed", type=int, default=1, help="of arrivals and of the draw")
    parser.add_argument("--seconds", type=float, default=10, help="of a run")
    parser.add_argument("--profile-seconds", type=float, default=8)
    parser.add_argument("--cpu", default="auto", choices=("auto", "spin", "sleep"))
    parser.add_argument("--simulated", action="store_true", help="on the simulated GPU")
    parser.add_argument("--keep", type=pathlib.Path, help="keep each run's CUPTI records and events "
                        "in this folder")
    parser.add_argument("--no-goal", action="store_true", help="exit status 0 if frames were judged")
    parser.add_argument("--commit", default="")
    parser.add_argument("--out", type=pathlib.Path)
    options = parser.parse_args()
    options.scenarios = options.scenarios.split(",")
    if unknown := set(options.scenarios) - set(SCENARIOS):
        parser.error(f"--scenarios: found {', '.join(sorted(unknown))}, accepted: "
                     f"{', '.join(SCENARIOS)}")
    return options


def measure(bench, options):
    """@returns what is told of each run, and all verdicts"""
    bench.prepare()
    records, told = bench.run(USUAL)
    usual, runs, verdicts = analysis.usual_of(records), {USUAL: told}, []
    for name in options.scenarios:
        records, told = bench.run(name, usual)
        its, left_out = analysis.judge_run(records, usual, is_nominal=options.simulated)
        runs[name] = {**told, "judged": len(its), "left_out": left_out}
        verdicts += [{"scenario": name, **verdict} for verdict in its]
        print(f"{name}: {runs[name]}", file=sys.stderr, flush=True)
    return runs, verdicts


def print_table(drawn, verdicts):
    print("cause: as named, ms; then what CUPTI says, ms")
    for verdict in drawn:
        print(line_of(verdict))
    for what, its in (("drawn", drawn), ("all", verdicts)):
        right = sum(verdict["right"] for verdict in its)
        print(f"\n{what}: {right} of {len(its)} right")
        for cause, count in sorted(analysis.tally(its).items()):
            print(f"  {cause:<16} {count['right']} of {count['frames']}, of the right kind "
                  f"{count['kind_right']}")


def main():
    options, wrong, runs, verdicts = parse(), "", {}, []
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        fake = pathlib.Path(options.build).resolve() / "tests/interposer/libfake_cupti.so"
        library, missing = cupti_library.build(folder, fake if options.simulated else None)
        if not library:
            print(missing, file=sys.stderr)
            return SKIPPED
        try:
            runs, verdicts = measure(Checked(options, pathlib.Path(folder), library), options)
        except (Failed, OSError, subprocess.SubprocessError) as error:
            wrong = str(error)
    drawn = random.Random(options.seed).sample(verdicts, min(options.frames, len(verdicts)))
    right = sum(verdict["right"] for verdict in drawn)
    print_table(drawn, verdicts)
    if not wrong and len(drawn) < options.frames:
        wrong = f"found {len(drawn)} late frames to judge, accepted: {options.frames}"
    if wrong:
        print(wrong, file=sys.stderr)
    if options.out:
        result_file.write(options.out, {
            **result_file.where_and_when("causes_check.py", options.build, options.commit),
            "simulated": options.simulated, "cores": os.cpu_count(), "wrong": wrong,
            "seconds": options.seconds, "cpu": options.cpu, "seed": options.seed,
            "right": right, "of": len(drawn), "tally": analysis.tally(drawn),
            "all_right": sum(verdict["right"] for verdict in verdicts), "of_all": len(verdicts),
            "all_tally": analysis.tally(verdicts), "runs": runs, "drawn": drawn,
            "not_drawn": [verdict for verdict in verdicts if verdict not in drawn]})
    if wrong:
        return 1
    return 0 if options.no_goal or right >= GOAL * len(drawn) else 1


if __name__ == "__main__":
    sys.exit(main())
