#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What does it cost a program to be watched?

The ten chains (tools/chains), each seed in every row in turns:

  plain    f_a 1.1, scheduled (`urgengo run`)
  again    the same once more: what two runs differ by without a reason
  trace    the same with --trace
  nvtx     the same with an NVTX tool attached: the recorder of the tests, which checks the protocol
  bare     f_a 0.9, without UrgenGo
  bare_again
  observe  the same under `urgengo run --observe`

Of a pair of rows: the mean over the seeds of what they differ by, and its 95 % interval. CPU time
is the program's own, from its first frame on: not that of the command that starts it.

  tools/bench/watching_cost.py --build build/release --seeds 1,2,3,4,5 --out result.json
  tools/bench/watching_cost.py --simulated --cpu sleep --seconds 3 --out result.json

The same command goes on where --limit-s ended it, with the same --folder. What a launch pays:
`urgengo bench calls`.

Exit status 0 if no watched row has more misses, nor observe more CPU time, than its plain one
beyond the interval, and the NVTX tool found no error; else 1.
"""
import argparse
import collections
import json
import math
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import result_file  # noqa: E402
from kill_switch import Bench, Failed  # noqa: E402

ROWS = ("plain", "again", "trace", "nvtx", "bare", "bare_again", "observe")
PAIRS = (("plain", "again"), ("plain", "trace"), ("plain", "nvtx"), ("bare", "bare_again"),
         ("bare", "observe"))
SCHEDULED_F_A, OBSERVED_F_A, PROFILE_F_A, PROFILE_S = 1.1, 0.9, 0.6, 8
# Two-sided 95 % of Student's t, by degrees of freedom from 1; beyond them 1.96.
T_95 = (12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160,
        2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086)


def mean_and_interval(values):
    """@returns mean, and the ends of its 95 % interval; None without two values"""
    mean = statistics.mean(values)
    if len(values) < 2:
        return mean, None
    freedom = len(values) - 1
    t = T_95[freedom - 1] if freedom <= len(T_95) else 1.96
    half = t * statistics.stdev(values) / math.sqrt(len(values))
    return mean, [mean - half, mean + half]


def differences(runs):
    """@returns for each pair of rows what the second has more, seed by seed"""
    by_row = collections.defaultdict(dict)
    for run in runs:
        by_row[run["row"]][run["seed"]] = run
    found = {}
    for plain, watched in PAIRS:
        seeds = sorted(by_row[plain].keys() & by_row[watched].keys())
        if not seeds:
            continue
        told = {"seeds": seeds}
        for what in ("miss_pct", "cpu_s"):
            more = [by_row[watched][seed][what] - by_row[plain][seed][what] for seed in seeds]
            mean, interval = mean_and_interval(more)
            told[what] = {"median_plain": statistics.median(by_row[plain][s][what] for s in seeds),
                          "median_watched": statistics.median(by_row[watched][s][what]
                                                              for s in seeds),
                          "mean_more": mean, "interval": interval, "more": more}
        found[f"{watched} to {plain}"] = told
    return found


def is_more(told):
    return told["interval"] is not None and told["interval"][0] > 0


def unmet_goals(found, runs):
    unmet = [f"{pair}: more misses: {told['miss_pct']['interval']} points"
             for pair, told in found.items()
             if not pair.startswith(("again", "bare_again")) and is_more(told["miss_pct"])]
    observe = found.get("observe to bare")
    if observe and is_more(observe["cpu_s"]):
        unmet.append(f"observe to bare: more CPU time: {observe['cpu_s']['interval']} s")
    for run in runs:
        of = f"{run['row']}, seed {run['seed']}"
        nvtx = run.get("nvtx")
        if nvtx and (nvtx["errors"] or not nvtx["events"]):
            unmet.append(f"{of}: {nvtx['events']} NVTX events, errors: {nvtx['first_errors']}")
        if run.get("trace", {}).get("lost"):
            unmet.append(f"{of}: {run['trace']['lost']} records lost")
        if run.get("tripped"):
            unmet.append(f"{of}: UrgenGo gave up: {run['tripped']}")
    return unmet


def read_recording(path):
    """@returns what the NVTX tool wrote down: how many calls of UrgenGo's domain, by kind, and what
    breaks the protocol"""
    kinds, errors = collections.Counter(), []
    with open(path, errors="replace") as file:
        for line in file:
            if line.startswith("ERROR"):
                errors.append(line.strip())
            elif found := re.match(r"\[urgengo\] (\w+)", line):
                kinds[found[1]] += 1
    return {"events": sum(kinds.values()), "by_kind": dict(kinds.most_common()),
            "errors": len(errors), "first_errors": errors[:5]}


class Watching(Bench):
    def __init__(self, options, folder):
        super().__init__(options, folder)
        self.recorder = str(pathlib.Path(options.nvtx_tool or pathlib.Path(
            options.build, "tests/interposer/libnvtx_recorder.so")).resolve())

    def config(self, f_a):
        """The chains at that load, beside the profile."""
        def at_load(match):
            return f"period_ms: {float(match[1]) / f_a:g}"
        name = f"at_{f_a:g}.yaml".replace(".", "_", 1)
        text = (HERE.parent / "chains/chains.yaml").read_text()
        (self.folder / name).write_text(re.sub(r"period_ms: ([0-9.]+)", at_load, text))
        return name

    def must(self, what, command, environment=None, timeout=None):
        done = subprocess.run(command, env=environment or self.environment, cwd=self.folder,
                              text=True, capture_output=True, timeout=timeout)
        if done.returncode != 0:
            raise Failed(f"{what}: exit status {done.returncode}: {done.stderr.strip()[-2000:]}")
        return done.stdout

    def program(self, f_a, *more):
        return [self.chains, "run", "--f-a", str(f_a), "--cpu", self.options.cpu, "--sync",
                self.options.sync, "--quiet", *more]

    def prepare(self):
        if not (self.folder / "workload.json").exists():
            self.must("calibrate", [self.chains, "calibrate"])
        if not (self.folder / "chains.profile.json").exists():
            self.must("profile", [
                self.urgengo, "profile", "-q", *self.driver, "-c", self.config(PROFILE_F_A), "-o",
                "chains.profile.json", "--source", "marks", "--",
                *self.program(PROFILE_F_A, "--seconds", str(self.options.profile_seconds))],
                timeout=200)

    def run_row(self, row, seed):
        f_a = OBSERVED_F_A if row in ("bare", "bare_again", "observe") else SCHEDULED_F_A
        is_bare = row.startswith("bare")
        environment, files = dict(self.environment), {
            name: self.folder / name for name in ("report.json", "stats.json", "run.ugtrace",
                                                  "recording")}
        for file in files.values():
            file.unlink(missing_ok=True)
        command = [] if is_bare else [
            self.urgengo, "run", "-q", *self.driver, "-c", self.config(f_a), "--profile",
            "chains.profile.json", "--stats", "stats.json",
            *(["--trace", "run.ugtrace"] if row == "trace" else []),
            *(["--observe"] if row == "observe" else []), "--"]
        if row == "nvtx":
            environment["NVTX_INJECTION64_PATH"] = self.recorder
            environment["NVTX_RECORDER_FILE"] = str(files["recording"])
        self.must(f"{row}, seed {seed}", command + self.program(
            f_a, "--seconds", str(self.options.seconds), "--seed", str(seed), "--json",
            "report.json"), environment, timeout=10 * self.options.seconds + 60)
        return self.read_row(row, seed, f_a, files)

    def read_row(self, row, seed, f_a, files):
        report = json.loads(files["report.json"].read_text())
        run = {"row": row, "seed": seed, "f_a": f_a, "gpu": report["gpu"],
               "miss_pct": 100 * report["overall_miss_ratio"],
               "misses": {chain["name"]: [chain["missed"], chain["instances"]]
                          for chain in report["chains"]},
               "cpu_s": report["cpu_cores"] * report["wall_s"], "wall_s": report["wall_s"],
               "urgengo": report["urgengo"]}
        if files["stats.json"].exists():
            stats = json.loads(files["stats.json"].read_text())
            run["tripped"] = stats["tripped"]
            run["launches"] = sum(chain["launches"] for chain in stats["chains"])
        if row == "trace":
            told = json.loads(self.must("trace info", [self.urgengo, "trace", "info", "--json",
                                                       "run.ugtrace"]))
            run["trace"] = {key: told[key] for key in ("records", "lost", "overwritten",
                                                       "warnings")}
        if row == "nvtx":
            if not files["recording"].exists():
                raise Failed(f"the NVTX tool has written nothing: is {self.recorder} built?")
            run["nvtx"] = read_recording(files["recording"])
        return run


def table(found):
    lines = [f"{'':<22} {'seeds':>5} {'misses %':>17} {'more, 95 %':>24} {'CPU s':>15} "
             f"{'more, 95 %':>24}"]
    for pair, told in found.items():
        cells = [f"{pair:<22} {len(told['seeds']):>5}"]
        for what, digits in (("miss_pct", 2), ("cpu_s", 2)):
            its = told[what]
            ends = ("" if its["interval"] is None else
                    f" ({its['interval'][0]:+.{digits}f}..{its['interval'][1]:+.{digits}f})")
            cells.append(f"{its['median_plain']:7.{digits}f} {its['median_watched']:7.{digits}f} "
                         f"{its['mean_more']:+8.{digits}f}{ends:<20}")
        lines.append("  ".join(cells))
    return "\n".join(lines)


def parse():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", default="build/release")
    parser.add_argument("--rows", default=",".join(ROWS))
    parser.add_argument("--seeds", default="1,2,3,4,5")
    parser.add_argument("--seconds", type=float, default=10, help="of a run")
    parser.add_argument("--profile-seconds", type=float, default=PROFILE_S)
    parser.add_argument("--cpu", default="auto", choices=("auto", "spin", "sleep"))
    parser.add_argument("--sync", default="block", choices=("spin", "block"),
                        help="how the program waits; one that spins hides what CPU time costs")
    parser.add_argument("--nvtx-tool", help="[<build>/tests/interposer/libnvtx_recorder.so]")
    parser.add_argument("--simulated", action="store_true", help="on the simulated GPU")
    parser.add_argument("--limit-s", type=float, default=1800, help="no run begins after that")
    parser.add_argument("--folder", type=pathlib.Path, help="keeps workload and profile")
    parser.add_argument("--commit", default="")
    parser.add_argument("--out", type=pathlib.Path)
    options = parser.parse_args()
    options.rows = options.rows.split(",")
    options.seeds = [int(seed) for seed in options.seeds.split(",")]
    if unknown := set(options.rows) - set(ROWS):
        parser.error(f"--rows: found {', '.join(sorted(unknown))}, accepted: {', '.join(ROWS)}")
    return options


def measure(bench, options, runs, begin):
    known = {(run["row"], run["seed"]) for run in runs}
    for seed in options.seeds:
        # From seed to seed the other way round: what wanders takes from all rows.
        for row in options.rows if seed % 2 else options.rows[::-1]:
            if (row, seed) in known:
                continue
            if time.monotonic() - begin > options.limit_s:
                return
            runs.append(bench.run_row(row, seed))
            print(f"{row}, seed {seed}: {runs[-1]['miss_pct']:.2f} % missed, "
                  f"{runs[-1]['cpu_s']:.2f} s of CPU time", file=sys.stderr, flush=True)


def main():
    options, begin, wrong = parse(), time.monotonic(), ""
    conditions = {name: getattr(options, name)
                  for name in ("seconds", "cpu", "sync", "simulated")}
    runs = []
    if options.out and options.out.exists():
        before = json.loads(options.out.read_text())
        if before["conditions"] != conditions:
            sys.exit(f"{options.out}: found {before['conditions']}, accepted: {conditions}")
        runs = before["runs"]
    with tempfile.TemporaryDirectory(dir="/dev/shm") as temporary:
        folder = (options.folder or pathlib.Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        bench = Watching(options, folder)
        try:
            bench.prepare()
            measure(bench, options, runs, begin)
        except (Failed, OSError, subprocess.SubprocessError) as error:
            wrong = str(error)
    found = differences(runs)
    unmet = unmet_goals(found, runs) + ([wrong] if wrong else [])
    print(table(found))
    for run in runs:
        if "nvtx" in run:
            print(f"NVTX, seed {run['seed']}: {run['nvtx']['events']} events, "
                  f"{run['nvtx']['errors']} errors")
    print("\n".join(unmet) or "all goals met")
    if options.out and runs:
        result_file.write(options.out, {
            **result_file.where_and_when("watching_cost.py", options.build, options.commit),
            "cores": os.cpu_count(), "conditions": conditions, "f_a": {
                "scheduled": SCHEDULED_F_A, "observed": OBSERVED_F_A},
            "unmet": unmet, "differences": found, "runs": runs})
    return 1 if unmet else 0


if __name__ == "__main__":
    sys.exit(main())
