#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Mixes of real networks, bare and under UrgenGo: who misses what, with the same arrivals.

  calibrate (latency alone) -> chains.yaml -> profile once a mix -> rows, interleaved

A cell is a mix at a load, with or without a background thread of no chain. Rows of a cell:
  bare        the program as it is
  priorities  under UrgenGo, which holds no launch: `admission: none, guard: off`
  urgengo     as configured by default;   edf, paam: that preset, at loads from 0.9 on
  times_4, times_0.25, random_2   as urgengo, with a profile that is wrong: one chain's times by that
              factor, or all chains', each by its own up to it
  alone       each network alone;   empty: all together with the smallest inputs: two floors, which
              say what a scheduler of the GPU can do about it

All processes start under the same conditions, CUDA_DEVICE_MAX_CONNECTIONS among them. Each network
has one input: if the last frames of its phases do not all have the same bits, in whatever row, it is
named at the end. Everything learned and every run is kept in --folder: a call that was cut off, or
ended by --limit-s, is continued by the same command. --out is written anew after each run, whole or
not at all.

  tools/bench/network_mixes.py --build build/release --mixes A --limit-s 500 --out a.json
  tools/bench/network_mixes.py --mixes A,B,C --plan         # what would run, and how long

--together: one process runs all seeds of a row, with and without the bystander, phase by phase,
which saves start-ups; what UrgenGo learns in one phase it then knows in the next.
"""
import argparse
import json
import os
import pathlib
import shlex
import shutil
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
sys.path.insert(0, str(HERE / "programs"))
import mix_plan  # noqa: E402
import networks  # noqa: E402
import result_file  # noqa: E402
import stalls  # noqa: E402

PROGRAM = HERE / "programs/network_threads.py"
SKIPPED = 77
ROWS = ("bare", "priorities", "urgengo", "edf", "paam", "times_4", "times_0.25", "random_2", "alone",
        "empty")
WRONG_ROWS = ("times_4", "times_0.25", "random_2")
PRESET_ROWS, FLOOR_ROWS = ("edf", "paam"), ("alone", "empty")
PRESET_FROM_LOAD = 0.9
PROFILE_SEED, PROFILE_LOAD = 1000, 0.5
ALONE_SHARE = 0.2  # of --seconds, for each network of the floor
KEPT_ERRORS = 4000
OWN_TIME_S = 30    # of a process, beside its phases, until one has been measured
HANGS_AFTER_S = 200


class Failed(Exception):
    pass


def log(text):
    print(text, file=sys.stderr, flush=True)


def seconds_of_phases(args, phases, count):
    if count == "alone":
        return args.seconds * ALONE_SHARE * 8
    return len(phases) * (args.seconds + args.warmup + 1)


class Experiment:
    def __init__(self, args):
        self.args, self.folder = args, args.folder
        if args.fresh:
            shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.mixes = [mix_plan.parse_mix(text) for text in args.mixes.split(",")]
        self.calibration = self.read("calibration.json", {})
        self.runs = self.read("runs.json", [])
        self.facts = self.read("facts.json", {})
        self.begin = time.monotonic()
        self.own_times_s = []

    def read(self, name, default):
        path = self.folder / name
        return json.loads(path.read_text()) if path.exists() else default

    def keep(self, name, content):
        result_file.write(self.folder / name, content)

    # Programs

    def execute(self, what, command, expected_s, allow_failure=False, stall_ms=0, stall_seed=0):
        """@param stall_ms  the program stands still for so long now and then (stalls.py)
        @returns what the command printed, its end
        @errors Failed; ends this program if the command says that it cannot run here"""
        environment = result_file.without_urgengo(os.environ)
        environment |= {"CUDA_DEVICE_MAX_CONNECTIONS": str(self.args.connections),
                        "TORCHINDUCTOR_CACHE_DIR": str(self.folder / "inductor"),
                        "TRITON_CACHE_DIR": str(self.folder / "triton"),
                        "PYTHONDONTWRITEBYTECODE": "1"}
        begin, limit_s = time.monotonic(), expected_s + HANGS_AFTER_S
        with tempfile.TemporaryFile("w+") as output:
            to = {"env": environment, "stdout": output, "stderr": subprocess.STDOUT}
            try:
                done = stalls.run(command, stall_ms, stall_seed, limit_s, **to) if stall_ms else \
                    subprocess.run(command, timeout=limit_s, **to)
                code = done.returncode
            except subprocess.TimeoutExpired:
                code = "none: it hung"
            output.seek(0)
            text = output.read()[-KEPT_ERRORS:]
        took_s = time.monotonic() - begin
        log(f"  {what}: {took_s:.1f} s")
        self.own_times_s.append(max(0.0, took_s - expected_s))
        if code == SKIPPED:
            print(text)
            sys.exit(SKIPPED)
        if code != 0 and not allow_failure:
            raise Failed(f"{what}: exit status {code}\n{text}")
        return text

    def program(self, spec, *more):
        return [sys.executable, str(PROGRAM), "--spec", str(spec), *map(str, more),
                *["--simulated"] * self.args.simulated]

    def urgengo(self):
        return str((self.args.build / "bin/urgengo").resolve())

    # What is known before the rows

    def calibrate(self):
        """Latency alone of each candidate that has none yet."""
        wanted = {one for mix in self.mixes for one in mix_plan.candidates(mix, networks.KINDS)}
        tried = self.facts.setdefault("broken", {})
        missing = sorted(one for one in wanted if mix_plan.key(*one) not in self.calibration
                         and mix_plan.key(*one) not in tried)
        for form in networks.FORMS:
            its = [one for one in missing if one[1] == form]
            if not its:
                continue
            spec, out = self.folder / f"calibrate_{form}.json", self.folder / "alone.json"
            result_file.write(spec, {"networks": [
                {"name": f"c{i}", "network": network, "form": form, "batch": self.args.batch}
                for i, (network, form) in enumerate(its)]})
            self.execute(f"calibrate {len(its)} {form} networks",
                         self.program(spec, "--alone", "--seconds", 0.5, "--keep-going", "--out",
                                      out), len(its))
            report = json.loads(out.read_text())
            self.facts["software"] = {key: value for key, value in report.items()
                                      if isinstance(value, str)}
            for one in report["alone"]:
                self.calibration[mix_plan.key(one["network"], one["form"])] = {
                    "latency_ms": round(one["latency_ms"]["p50"], 4),
                    "p99_ms": round(one["latency_ms"]["p99"], 4)}
            names = {f"c{i}": mix_plan.key(*one) for i, one in enumerate(its)}
            tried |= {names[name]: why for name, why in report["broken"].items()}
            self.keep("calibration.json", self.calibration)
            self.keep("facts.json", self.facts)

    def file(self, mix, *parts):
        return self.folder / "_".join([mix.name.replace(":", "-").replace("+", "-"),
                                       *map(str, parts)])

    def its_networks(self, mix, load):
        its = mix_plan.networks_of(mix, load, networks.KINDS, self.calibration)
        return [one | {"batch": self.args.batch} for one in its]

    def spec(self, mix, load):
        path = self.file(mix, load, "spec.json")
        result_file.write(path, {"networks": self.its_networks(mix, load)})
        return path

    def config(self, mix, load, row):
        scheduler = {"priorities": self.args.priorities}.get(row, self.args.scheduler)
        more = self.args.config_of_priorities if row == "priorities" else self.args.config
        path = self.file(mix, load, row, "chains.yaml")
        path.write_text(mix_plan.config_text(self.its_networks(mix, load), scheduler, more))
        return path

    def profile(self, mix):
        """@returns the mix's profile, learned at half load if it is not there yet"""
        path = self.file(mix, "chains.profile.json")
        if not path.exists() and not self.args.no_profile:
            text = self.execute(
                f"profile of mix {mix.name}",
                [self.urgengo(), "profile", "-c",
                 str(self.config(mix, PROFILE_LOAD, "urgengo")), "-o", str(path),
                 *shlex.split(self.args.profile_options), "--",
                 *self.program(self.spec(mix, PROFILE_LOAD), "--phases", PROFILE_SEED, "--seconds",
                               self.args.profile_seconds)], self.args.profile_seconds)
            self.facts.setdefault("profile_output", {})[mix.name] = text
            self.keep("facts.json", self.facts)
        return path

    def profile_of_row(self, mix, row):
        """@returns the mix's profile, or a wrong one, and by which factors it is"""
        path = self.profile(mix)
        if row not in WRONG_ROWS:
            return path, None
        wrong, factors = mix_plan.wrong_profile(json.loads(path.read_text()), row, mix.seed)
        path = self.file(mix, row, "chains.profile.json")
        result_file.write(path, wrong)
        return path, factors

    # Rows

    def changes(self):
        """@returns what these rows have that those of other commands in the same folder have not"""
        args = self.args
        return [args.scheduler, args.config, args.priorities, args.config_of_priorities,
                args.run_options, *[args.stall_ms] * (args.stall_ms > 0)]

    def todo(self):
        """@returns (mix, load, row, phases) of every process that is still to run, rows in turns"""
        done = {(*mix_plan.cell_of(run), run["row"], run["seed"]) for run in self.mine()}
        jobs, turn = [], 0
        kinds = [(seed, bystander) for bystander in self.args.bystander for seed in self.args.seeds]
        groups = [kinds] if self.args.together else [[one] for one in kinds]
        for mix in self.mixes:
            for load in self.args.loads:
                for group in groups:
                    rows = [row for row in self.args.rows
                            if row not in PRESET_ROWS or load >= PRESET_FROM_LOAD]
                    for row in mix_plan.in_turns(rows, turn):
                        its = [one for one in group
                               if (mix.name, load, one[1], row, one[0]) not in done]
                        if row in FLOOR_ROWS:  # once: neither arrivals nor a bystander matter
                            its = [one for one in its if one == kinds[0]]
                        if its:
                            jobs.append((mix, load, row, its))
                    turn += 1
        return jobs

    def expected_s(self, job):
        own_s = max(self.own_times_s[-6:], default=OWN_TIME_S)
        return own_s + seconds_of_phases(self.args, job[3], job[2])

    def run(self, mix, load, row, phases):
        args, out, stats = self.args, self.folder / "report.json", self.folder / "stats.json"
        out.unlink(missing_ok=True)
        stats.unlink(missing_ok=True)
        command = self.program(self.spec(mix, load), "--out", out, "--warmup", args.warmup,
                               "--bystander-kind", args.bystander_kind)
        if row == "alone":
            command += ["--alone", "--seconds", str(args.seconds * ALONE_SHARE)]
        else:
            words = ",".join(f"{seed}{'b' * bystander}" for seed, bystander in phases)
            command += ["--phases", words, "--seconds", str(args.seconds)]
        command += ["--empty"] * (row == "empty")
        factors = None
        if row not in ("bare", *FLOOR_ROWS):
            wrapper = [self.urgengo(), "run", "-c", str(self.config(mix, load, row)), "--stats",
                       str(stats)]
            profile, factors = self.profile_of_row(mix, row)
            wrapper += ["--profile", str(profile)] if profile.exists() else []
            wrapper += ["--preset", row] if row in PRESET_ROWS else []
            command = wrapper + shlex.split(args.run_options) + ["--"] + command
        what = f"mix {mix.name}, load {load}, {row}, {phases}"
        begin = time.monotonic()
        text = self.execute(what, command, seconds_of_phases(args, phases, row),
                            stall_ms=args.stall_ms, stall_seed=phases[0][0])
        report = json.loads(out.read_text())
        if row == "alone":
            its = report["alone"]
            report["phases"] = [{"seed": phases[0][0], "bystander": phases[0][1],
                                 "overall_miss_pct": mix_plan.statistics.fmean(
                                     100 * one["missed"] / one["frames"] for one in its),
                                 "networks": its}]
        scheduler = json.loads(stats.read_text()) if stats.exists() else None
        for phase in report["phases"]:
            self.runs.append({"mix": mix.name, "load": load, "row": row, **phase,
                              "changes": self.changes(),
                              "process": {"phases": len(phases), "times_s": report["times_s"],
                                          "wall_s": round(time.monotonic() - begin, 1),
                                          "date_utc": result_file.utc_now()},
                              "profile_factors": factors, "scheduler_stats": scheduler,
                              "printed": text[-1500:] if scheduler else ""})
            log(f"    seed {phase['seed']}{' beside' * phase['bystander']}: "
                f"{phase['overall_miss_pct']:.1f} %")
        self.keep("runs.json", self.runs)

    def mine(self):
        """@returns the runs, earlier ones too, that this command is about"""
        names = {mix.name for mix in self.mixes}
        return [run for run in self.runs
                if run["mix"] in names and run["changes"] == self.changes()]

    def comparison(self):
        table = mix_plan.cells(self.mine())
        kinds = {mix.name: mix_plan.kind_of_mix(mix) for mix in self.mixes}
        return table, {**mix_plan.compare(table, kinds),
                       "answers": mix_plan.answers(self.mine())}

    def report(self):
        if not self.args.out:
            return
        table, comparison = self.comparison()
        args = {key: str(value) if isinstance(value, pathlib.Path) else value
                for key, value in vars(self.args).items() if key not in ("folder", "out", "build")}
        result_file.write(self.args.out, {
            **result_file.where_and_when("tools/bench/network_mixes.py", self.args.build,
                                         self.args.commit), **self.facts,
            "options": args, "calibration": self.calibration,
            "mixes": {mix.name: {str(load): self.its_networks(mix, load)
                                 for load in self.args.loads} for mix in self.mixes},
            "cells": [{"mix": cell[0], "load": cell[1], "bystander": cell[2], "rows": rows}
                      for cell, rows in sorted(table.items())],
            "comparison": comparison, "runs": self.mine()})


def experiment_of(args, *more):
    """What calibrates, profiles and writes configs for one mix at one load.
    @param args  of a parser_of() with --mix, --load and --scheduler
    @param more  options of this program"""
    options = ["--build", args.build, "--folder", args.folder, "--mixes", args.mix, "--loads",
               args.load, "--scheduler", args.scheduler, *["--simulated"] * args.simulated, *more]
    return Experiment(parse([str(one) for one in options]))


def parser_of(text):
    """@returns a parser of what all programs take that run mixes"""
    parser = argparse.ArgumentParser(description=text,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=pathlib.Path("build/release"),
                        help="folder with bin/urgengo and lib/urgengo [build/release]")
    parser.add_argument("--folder", type=pathlib.Path,
                        default=pathlib.Path(tempfile.gettempdir(), "urgengo_mixes"),
                        help="what is learned and every run is kept here [urgengo_mixes in /tmp]")
    parser.add_argument("--simulated", action="store_true",
                        help="kernels of the simulated GPU instead of networks, to try this program")
    parser.add_argument("--out", type=pathlib.Path, help="write all numbers to this JSON file")
    parser.add_argument("--commit", default="", help="that was built, for the JSON file")
    return parser


def parse(arguments=None):
    parser = parser_of(__doc__)
    parser.add_argument("--fresh", action="store_true", help="first empty that folder")
    parser.add_argument("--mixes", default="A,B,C", help="or COUNT:FORM+FORM:SEED [A,B,C]")
    parser.add_argument("--loads", default="0.5,0.9")
    parser.add_argument("--seeds", default="1,2")
    parser.add_argument("--bystander", default="no,yes", help="no, yes or both [no,yes]")
    parser.add_argument("--bystander-kind", default="matmul", help="matmul or train [matmul]")
    parser.add_argument("--rows", default="bare,priorities,urgengo,edf,paam",
                        help=f"of {','.join(ROWS)} [bare,priorities,urgengo,edf,paam]")
    parser.add_argument("--seconds", type=float, default=10, help="of a run that count [10]")
    parser.add_argument("--warmup", type=float, default=1, help="of a run before them [1]")
    parser.add_argument("--batch", type=int, default=0, help="of every network [each its own]")
    parser.add_argument("--stall-ms", type=float, default=0, metavar="MS",
                        help="now and then the programs stand still for so long, as on a loud "
                             "machine; when is drawn from a process's start on, so rows whose "
                             "programs start up more slowly have other stalls; 0: they do not [0]")
    parser.add_argument("--connections", type=int, default=32, help="of all processes [32]")
    parser.add_argument("--together", action="store_true", help="all phases of a row: one process")
    parser.add_argument("--limit-s", type=float, default=0,
                        help="begin nothing that would end later than this; 0: no limit [0]")
    parser.add_argument("--profile-seconds", type=float, default=6)
    parser.add_argument("--profile-options", default="", help="more for urgengo profile")
    parser.add_argument("--no-profile", action="store_true", help="rows run without one")
    parser.add_argument("--run-options", default="",
                        help="more for urgengo run, as in --run-options=-v")
    parser.add_argument("--scheduler", default="", metavar="KEYS", help="of scheduler:, all rows")
    parser.add_argument("--priorities", default="admission: none, guard: off", metavar="KEYS",
                        help="of scheduler:, the row priorities [admission: none, guard: off]")
    parser.add_argument("--config", default="", metavar="LINE", help="one more line of chains.yaml")
    parser.add_argument("--config-of-priorities", default="", metavar="LINE",
                        help="the same, of the row priorities")
    parser.add_argument("--plan", action="store_true", help="say what would run, and run nothing")
    args = parser.parse_args(arguments)
    if args.stall_ms < 0:
        parser.error(f"--stall-ms: found {args.stall_ms:g}, accepted: 0 or more")
    try:
        args.loads = [float(one) for one in args.loads.split(",")]
        args.seeds = [int(one) for one in args.seeds.split(",")]
        args.bystander = [{"no": False, "yes": True}[one] for one in args.bystander.split(",")]
        args.rows = args.rows.split(",")
        mixes = [mix_plan.parse_mix(one) for one in args.mixes.split(",")]
        if not set(args.rows) <= set(ROWS):
            raise ValueError(f"--rows: found {','.join(args.rows)}, accepted: {','.join(ROWS)}")
        forms = {form for mix in mixes for form in mix.forms}
        if not forms <= set(networks.FORMS):
            raise ValueError(f"--mixes: found {','.join(sorted(forms))}, accepted: "
                             f"{','.join(networks.FORMS)}")
    except (ValueError, KeyError) as error:
        parser.error(str(error))
    return args


def main():
    args = parse()
    experiment = Experiment(args)
    if args.plan:
        jobs = experiment.todo()
        for mix, load, row, phases in jobs:
            print(f"mix {mix.name} load {load} {row:<11} {phases}")
        print(f"{len(jobs)} processes, about "
              f"{sum(experiment.expected_s(job) for job in jobs) / 60:.0f} min")
        return
    left_out, failures = 0, []
    try:
        experiment.calibrate()
        for mix in experiment.mixes:
            experiment.profile(mix)
        for job in experiment.todo():
            passed_s = time.monotonic() - experiment.begin
            if args.limit_s and passed_s + experiment.expected_s(job) > args.limit_s:
                left_out += 1
                continue
            try:
                experiment.run(*job)
            except Failed as error:  # one row that fails is a result; the others go on
                failures.append(str(error))
                log(str(error))
            experiment.report()
    except Failed as error:
        sys.exit(str(error))
    table, comparison = experiment.comparison()
    print(mix_plan.table_text(table, ROWS))
    print(json.dumps({key: comparison[key] for key in ("kinds", "worse", "answers")}, indent=1))
    experiment.report()
    if left_out:
        print(f"{left_out} processes are left: the same command goes on")
    if failures:
        sys.exit(f"{len(failures)} runs failed")


if __name__ == "__main__":
    main()
