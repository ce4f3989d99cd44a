#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How well ug_position() knows where the GPU is, for every way of tracking.

The ten chains run under UrgenGo, once a row; their kernels write down when they began and ended
(`urgengo-chains run --stamps`), and a thread asks for positions at random times. Afterwards each
answer is compared with the stamps: accuracy_analysis.py says how. The workload is calibrated and
profiled once, at the begin, with stamps as in the rows.

  tools/bench/position_accuracy.py --build build/release --out result.json --plot figure.svg
  tools/bench/position_accuracy.py --plot-only result.json,beside.json --plot figure.svg
  CUDA_VISIBLE_DEVICES=1 tools/bench/position_accuracy.py --rows progress,overlapped@500

--bystander runs --bystander-rows again while a thread of no chain fills the GPU. A stamp is not a
mark: that stamps are the truth shows tools/bench/stamps_check.py.

Exit status 0 if the goals are met (those whose rows were run), 1 if not, 77 without a GPU.
"""
import argparse
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
sys.path.insert(0, str(HERE.parents[1] / "tests/gpu"))
import accuracy_analysis  # noqa: E402
import equality  # noqa: E402: where results come from, and how they are written
import stamps_file  # noqa: E402

DEFAULT = "progress"
ROWS = {
    DEFAULT: "",
    "progress@50": "progress: {every_us: 50}",
    "progress@100": "progress: {every_us: 100}",
    "progress@150": "progress: {every_us: 150}",
    "progress/kernel": "progress: {source: kernel}",
    "progress/memop": "progress: {source: memop}",
    "progress/event": "progress: {source: event}",
    "progress/event@25": "progress: {source: event, every_us: 25}",
    "progress/event@50": "progress: {source: event, every_us: 50}",
    "progress/event@100": "progress: {source: event, every_us: 100}",
    "progress/kernel@100": "progress: {source: kernel, every_us: 100}",
    "progress/kernel every kernel": "progress: {source: kernel, every_us: 0}",
    "progress/event every kernel": "progress: {source: event, every_us: 0}",
    "async": "tracking: async",
    "sync": "tracking: sync",
    "batched@500": "tracking: batched, eval_interval_us: 500",
    "overlapped@500": "tracking: overlapped, eval_interval_us: 500",
}
BYSTANDER_ROWS = f"{DEFAULT},progress/kernel,progress/event every kernel,overlapped@500"
PROFILE_LOAD, PROFILE_S = 0.6, 6
GOALS = ("within_one of the default at least 0.95", "remaining p99 of the default at most 200 us",
         "remaining p99 of overlapped@500 at least 3 times the default's",
         "exact (within clocks) of progress/event every kernel at least 0.95")


class Programs:
    def __init__(self, args, folder):
        self.urgengo = str(args.build / "bin/urgengo")
        self.chains = str(args.build / "bin/urgengo-chains")
        self.yaml = (args.build / "share/urgengo/chains.yaml").read_text()
        self.folder = pathlib.Path(folder)
        self.environment = dict(os.environ)
        if args.simgpu:
            simulated = args.build / "lib/simgpu"
            self.environment["LD_LIBRARY_PATH"] = str(simulated)
            self.environment["URGENGO_REAL_LIBCUDA"] = str(simulated / "libcuda.so.1")
        self.workload = str(args.workload or self.folder / "workload.json")
        self.profile = str(args.profile or self.folder / "chains.profile.json")

    def run(self, what, command):
        begin = time.monotonic()
        done = subprocess.run(command, env=self.environment, text=True, capture_output=True)
        if done.returncode != 0:
            sys.exit(f"{what}: exit status {done.returncode}\n{done.stdout[-2000:]}"
                     f"{done.stderr[-4000:]}")
        return done, time.monotonic() - begin

    def config(self, name, f_a, keys):
        """@returns a config as a user would write it, for that load"""
        def at_load(match):
            return f"period_ms: {float(match[1]) / f_a:g}"

        path = self.folder / f"{re.sub('[^a-z0-9]+', '_', name)}.yaml"
        text = re.sub(r"period_ms: ([0-9.]+)", at_load, self.yaml)
        path.write_text(text + (f"\nscheduler: {{{keys}}}\n" if keys else ""))
        return str(path)

    def prepare(self, args):
        if not args.workload:
            _, seconds = self.run("calibrate", [self.chains, "calibrate", "--out", self.workload])
            print(f"calibrated in {seconds:.1f} s", flush=True)
        if not args.profile:
            seconds = args.profile_seconds
            _, took = self.run("profile", [
                self.urgengo, "profile", "-c", self.config("profile", PROFILE_LOAD, ""), "-o",
                self.profile, "--", self.chains, "run", "--workload", self.workload, "--f-a",
                str(PROFILE_LOAD), "--seconds", str(seconds), "--quiet", "--stamps",
                str(self.folder / "profile.stamps"), "--sample-us", "0"])
            print(f"profiled in {took:.1f} s", flush=True)

    def measure(self, row, args, bystander):
        """@returns what the analysis and the program's own report say"""
        stamps, report, stats = (str(self.folder / f"row.{kind}")
                                 for kind in ("stamps", "json", "stats"))
        command = [self.urgengo, "run", "--quiet", "-c", self.config("row", args.f_a, ROWS[row]),
                   "--profile", self.profile, "--stats", stats, "--", self.chains, "run",
                   "--workload", self.workload, "--f-a", str(args.f_a), "--seconds",
                   str(args.seconds), "--seed", str(args.seed), "--stamps", stamps, "--sample-us",
                   str(args.sample_us), "--json", report]
        if bystander:
            command += ["--bystander", str(args.bystander), "--bystander-every",
                        str(args.bystander_every)]
        _, took = self.run(row, command)
        file = stamps_file.StampsFile(stamps)
        counts = json.loads(pathlib.Path(stats).read_text())
        if counts["tripped"]:
            sys.exit(f"{row}: UrgenGo gave up: {counts['tripped']}")
        found = accuracy_analysis.analyse(file, json.loads(pathlib.Path(self.profile).read_text()))
        said = json.loads(pathlib.Path(report).read_text())
        return {"gpu": file.header["gpu"], "seconds": round(took, 1),
                "miss_ratio": said["overall_miss_ratio"],
                "launches": sum(stream.launches for stream in file.streams),
                "stamps_lost": sum(stream.lost for stream in file.streams),
                "marks": sum(chain.get("marks", 0) for chain in counts["chains"]),
                "clock": {"bound_ns": file.clock.bound_ns, "drift_ppm": file.clock.drift_ppm,
                          "round_trips": file.clock.round_trips,
                          "resolution_ns": file.resolution_ns()},
                "sampler": file.header["sampler"], **found}


def number(value, form):
    return "-" if value is None else format(value, form)


def heading():
    return (f"{'':<30} {'samples':>7} {'exact':>6} {'clocks':>6} {'+-1':>6}   kernels: "
            f"{'p50':>4} {'p95':>5} {'p99':>5} {'max':>5}   remaining us: {'p50':>7} {'p95':>8} "
            f"{'p99':>8} {'max':>9}  {'misses':>7} {'clock us':>8} {'left out':>8}")


def line_of(row, r):
    kernels, us = r["kernels"], r["remaining_us"]
    shares = " ".join(number(r[name] and 100 * r[name], "6.1f")
                      for name in ("exact", "exact_within_clocks", "within_one"))
    return (f"{row:<30} {r['samples']:>7} {shares}            "
            + " ".join(number(kernels[p], w) for p, w in
                       (("p50", "4"), ("p95", "5"), ("p99", "5"), ("max", "5")))
            + "                 "
            + " ".join(number(us[p], w) for p, w in
                       (("p50", "7.1f"), ("p95", "8.1f"), ("p99", "8.1f"), ("max", "9.1f")))
            + f"  {100 * r['miss_ratio']:6.1f}% {r['clock']['bound_ns'] / 1000:8.2f} "
            f"{sum(r['left_out'].values()):>8}")


def unmet_goals(rows):
    """@param rows  those without a bystander. @returns what they show against the goals"""
    unmet, default, overlapped = [], rows.get(DEFAULT), rows.get("overlapped@500")
    every = rows.get("progress/event every kernel")

    def check(holds, goal, found):
        if not holds:
            unmet.append(f"found {found:.3f}, accepted: {goal}")

    for name, row in rows.items():
        if not row["samples"]:
            unmet.append(f"{name}: no sample")
    if unmet:
        return unmet
    if default:
        p99 = default["remaining_us"]["p99"]
        check(default["within_one"] >= 0.95, GOALS[0], default["within_one"])
        check(p99 <= 200, GOALS[1], p99)
        if overlapped:
            check(overlapped["remaining_us"]["p99"] >= 3 * p99, GOALS[2],
                  overlapped["remaining_us"]["p99"] / p99)
    if every:
        check(every["exact_within_clocks"] >= 0.95, GOALS[3], every["exact_within_clocks"])
    return unmet


def plot(results, path):
    """Distributions of the error in remaining work: left without a bystander, right with one."""
    import matplotlib
    matplotlib.use("svg")
    from matplotlib import pyplot

    panels = [("ten chains", "rows"),
              ("ten chains, and a bystander that fills the GPU", "bystander_rows")]
    panels = [panel for panel in panels if any(result.get(panel[1]) for result in results)]
    figure, axes = pyplot.subplots(1, len(panels), figsize=(6.5 * len(panels), 4.5), sharey=True,
                                   squeeze=False)
    ends = accuracy_analysis.bin_ends_us()
    for axis, (title, key) in zip(axes[0], panels):
        for row, r in ((row, r) for result in results for row, r in result[key].items()):
            counts, below, shares = r["remaining_histogram"], 0, []
            for count in counts:
                below += count
                shares.append(below / max(1, r["samples"]))
            axis.plot(ends, shares, label=row, color=f"C{list(ROWS).index(row)}",
                      linestyle="-" if row.startswith("progress") else "--")
        axis.set(xscale="log", xlim=(1, 1e5), ylim=(0, 1), title=title,
                 xlabel="error in remaining work [us]")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    axes[0][0].set_ylabel("share of samples")
    figure.tight_layout()
    figure.savefig(path)


def rows_from(text, parser, option):
    rows = [row.strip() for row in text.split(",") if row.strip()]
    unknown = [row for row in rows if row not in ROWS]
    if unknown:
        parser.error(f"{option}: found {', '.join(unknown)}, accepted: {', '.join(ROWS)}")
    return rows


def parse():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    path = pathlib.Path
    parser.add_argument("--build", type=path, default="build/release",
                        help="folder with bin/, lib/urgengo and share/urgengo [build/release]")
    parser.add_argument("--rows", default=",".join(ROWS), help="[all]: " + ", ".join(ROWS))
    parser.add_argument("--f-a", type=float, default=0.9, help="factor on arrival rates [0.9]")
    parser.add_argument("--seconds", type=float, default=12, help="of a row [12]")
    parser.add_argument("--seed", type=int, default=1, help="of arrivals and samples [1]")
    parser.add_argument("--sample-us", type=float, default=500,
                        help="mean distance between samples [500]")
    parser.add_argument("--bystander", type=float, default=0, metavar="MS",
                        help="also with a bystander whose kernels take so long [0: not]")
    parser.add_argument("--bystander-every", type=float, default=10, metavar="MS",
                        help="from one of its kernels to the next [10]")
    parser.add_argument("--bystander-rows", default=BYSTANDER_ROWS, help=f"[{BYSTANDER_ROWS}]")
    parser.add_argument("--workload", type=path, help="calibrated before [calibrate]")
    parser.add_argument("--profile", type=path, help="of that workload [learn one]")
    parser.add_argument("--profile-seconds", type=float, default=PROFILE_S,
                        help=f"learn it for so long [{PROFILE_S}]")
    parser.add_argument("--simgpu", action="store_true", help="on the simulated GPU")
    parser.add_argument("--out", type=path, help="write all numbers to this JSON file")
    parser.add_argument("--commit", default="", help="that was built, for the JSON file")
    parser.add_argument("--plot", type=path, metavar="SVG", help="needs matplotlib")
    parser.add_argument("--plot-only", metavar="JSON,...", help="plot such files, measure nothing")
    args = parser.parse_args()
    args.rows = rows_from(args.rows, parser, "--rows")
    args.bystander_rows = rows_from(args.bystander_rows, parser, "--bystander-rows")
    if args.bystander <= 0:
        args.bystander_rows = []
    for name in ("workload", "profile"):
        if getattr(args, name):
            setattr(args, name, getattr(args, name).resolve())
    return args


def main():
    args = parse()
    if args.plot_only:
        plot([json.loads(pathlib.Path(name).read_text()) for name in args.plot_only.split(",")],
             args.plot)
        return
    if not args.simgpu:
        equality.skip_if(equality.why_not_here(()))
    args.build = equality.check_build(args.build)
    results = {"rows": {}, "bystander_rows": {}}
    with tempfile.TemporaryDirectory() as folder:
        programs = Programs(args, folder)
        programs.prepare(args)
        print(heading(), flush=True)
        for row in args.rows:
            results["rows"][row] = programs.measure(row, args, False)
            print(line_of(row, results["rows"][row]), flush=True)
        for row in args.bystander_rows:
            results["bystander_rows"][row] = programs.measure(row, args, True)
            print(line_of(f"{row} +bystander", results["bystander_rows"][row]), flush=True)
    unmet = unmet_goals(results["rows"])
    every = [*results["rows"].values(), *results["bystander_rows"].values()]
    if args.out and every:
        where = {} if args.simgpu else equality.where_and_when("tools/bench/position_accuracy.py", args.build, args.commit)
        conditions = {name: getattr(args, name.replace("-", "_"))
                      for name in ("f_a", "seconds", "seed", "sample_us", "bystander",
                                   "bystander_every")}
        equality.write_json(args.out, {
            **where, "program": "tools/bench/position_accuracy.py", "gpu": every[0]["gpu"],
            "conditions": conditions, "scheduler": {row: ROWS[row] for row in args.rows},
            "histogram_ends_us": [round(end, 4) for end in accuracy_analysis.bin_ends_us()],
            "goals": GOALS, "unmet": unmet, **results})
    if args.plot and every:
        plot([results], args.plot)
    if unmet:
        sys.exit("\n".join(unmet))


if __name__ == "__main__":
    main()
