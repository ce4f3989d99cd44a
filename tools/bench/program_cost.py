#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What UrgenGo costs a program when there is nothing to hold: ResNet-50 inference in PyTorch.

One thread runs the network and takes another name for every inference: the chain's, or one that is
a bystander's (with --direct it keeps one). Rows: native, twice, where neither name is anything, which
shows the noise; chain (the config's only one, enforced); profiled (the same with a profile of the
first program, learned by `urgengo profile` at the begin). A round has several processes of each
row, which take turns on one core.

Costs are told apart. Chain to nobody (the bystander): what being scheduled takes, block by block of pairs in one
process. To native: what the processes with UrgenGo take, as the bystander's and as the chain's, of what
the native ones of their round do: means of their lower quartiles. Processes of one program differ by
1.5 % (standard deviation, H200), so half a per cent needs a hundred of them. Every process maps a
random number of pages before it loads PyTorch: where its smaller libraries and stacks lie is then
chance in every row, and not in each the one place to which what it maps pushes them.

With --direct, instead of both, to direct: all that UrgenGo executes. Compared are inferences of the
same thread, two through UrgenGo and two past it in turns, by its libraries' pointers to the driver
(driver_pointers.py); of each two the second. For it is a program's loop that is to be measured: it
keeps its name, its next inference begins at once, and what one uses is still in the caches as far
as another one leaves it there. Rows: nobody (the bystander), chain, profiled.

Programs: eager fp16 and a CUDA graph of it, from pictures in the host's memory to scores in the
host's memory. Intervals are a bootstrap's: over processes and turns, to native over rounds.

  tools/bench/program_cost.py --build build/release --rounds 14 --out result.json
  tools/bench/program_cost.py --build build/release --programs eager --direct --rounds 4
  tools/bench/program_cost.py --build build/release --programs eager --source event

The last knows the executing kernel from events; --tracking takes the paper's ways instead.

With a build that measures its own time (-DURGENGO_MEASURE_OWN_TIME=ON), also how long a launch of
the chain is in UrgenGo's hands, marks included, and which share of an inference that makes.

Exit status 0 if no row is above the goals, 1 if not, 77 without PyTorch or a GPU.
"""
import argparse
import collections
import contextlib
import io
import json
import mmap
import os
import pathlib
import random
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests/gpu"))
sys.path.insert(0, str(HERE))
import equality  # noqa: E402: configs, and how a program is found to be runnable here
from program_cost_inference import METRICS, NUM_SKIPPED, Inference  # noqa: E402
from program_cost_ratios import (  # noqa: E402
    CHAIN, DIRECT, GOALS, JUDGED_ROWS, NATIVE_ROWS, NOBODY, metric, own_times, print_table,
    ratios_of, summary)

PROGRAMS = ("eager", "graph")
TRACKING = ("progress", "async", "sync", "batched", "overlapped")
SOURCES = ("auto", "kernel", "memop", "event")
# A period that is shorter than any inference: where several fit into one, `urgengo profile` takes
# them for one instance.
MEASURED_CHAIN = f"""  - name: measured
    period_ms: 1
    deadline_ms: 500
    tasks: [{{name: all, thread: "{CHAIN}"}}]
"""
NUM_PROFILED = 200
MOST_PAGES = 2048  # 8 MiB: libraries of 2 MiB and more begin where their pages can be huge ones


def driver_place():
    """@returns where the driver lies in this process: GiB from the C library, and bytes from where
    huge pages would begin; None if it is not found"""
    begin = {}
    for line in pathlib.Path("/proc/self/maps").read_text().splitlines():
        address, *_, name = line.split()
        if re.search(r"/libcuda\.so\.\d+\.", name):
            begin.setdefault("driver", int(address.split("-")[0], 16))
        elif name.endswith("/libc.so.6"):
            begin.setdefault("c_library", int(address.split("-")[0], 16))
    if len(begin) < 2:
        return None
    return {"gib_from_c_library": round((begin["c_library"] - begin["driver"]) / 2**30, 3),
            "bytes_from_huge_page": begin["driver"] % (2 << 20)}


def serve(batch, kinds):
    """Answers each line of standard input, `eager 100`, with one of JSON, in a thread: the first
    one's name is the process's."""
    moved = mmap.mmap(-1, random.randint(1, MOST_PAGES) * mmap.PAGESIZE, mmap.MAP_PRIVATE,
                      mmap.PROT_READ)  # takes no memory, and is kept
    inference = Inference(batch, kinds)

    def work():
        # All processes measure on this core, each in its turn.
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        equality.name_thread(kinds[0])
        num_pointers = len(inference.pointers.where) if inference.pointers else None
        print(json.dumps({"driver_place": driver_place(), "pointers": num_pointers}), flush=True)
        for line in sys.stdin:
            program, count = line.split()
            print(json.dumps(inference.measure(program, int(count))), flush=True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    moved.close()


def kinds_of(row, args):
    """@returns what the inferences of a row's processes are, in turns"""
    if args.direct:
        return (NOBODY if row == NOBODY else CHAIN, DIRECT)
    return (NOBODY, CHAIN)


def serving_command(args, kinds):
    command = [sys.executable, str(pathlib.Path(sys.argv[0]).resolve()), "--serve", ",".join(kinds),
               "--batch", str(args.batch)]
    return (["taskset", "-c", args.cpus] if args.cpus else []) + command


def learn_profile(program, args, folder):
    """@returns a profile of the program, as a user would make it"""
    config, profile = config_of("profiled", args, folder), pathlib.Path(folder, f"{program}.json")
    command = [str(args.build / "bin/urgengo"), "profile", "-c", str(config), "-o", str(profile),
               "--"] + serving_command(args, (NOBODY, CHAIN))
    done = subprocess.run(command, env=equality.clean_environment(), text=True,
                          input=f"{program} {NUM_PROFILED}\n",
                          capture_output=True)
    if done.returncode != 0:
        sys.exit(f"urgengo profile: exit status {done.returncode}\n{done.stderr[-4000:]}")
    return profile


class Process:
    """One of a row's processes in a round, of one program."""

    def __init__(self, row, number, profile, args, folder):
        self.row, self.stats = row, pathlib.Path(folder, f"{row}.{number}.stats.json")
        command = serving_command(args, kinds_of(row, args))
        environment = equality.clean_environment()
        if row not in NATIVE_ROWS:
            config = config_of(row, args, folder, f".{number}")
            if row == "profiled":
                shutil.copy(profile, config.with_suffix(".profile.json"))
            command = [str(args.build / "bin/urgengo"), "run", "-c", str(config), "--quiet",
                       "--stats", str(self.stats),
                       "--"] + command
        self.errors = tempfile.TemporaryFile("w+")
        self.process = subprocess.Popen(command, env=environment, text=True, stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, stderr=self.errors)

    def answer(self):
        line = self.process.stdout.readline()
        if not line:
            self.process.wait()
            self.errors.seek(0)
            sys.exit(f"{self.row}: exit status {self.process.returncode}\n"
                     f"{self.errors.read()[-4000:]}")
        return json.loads(line)

    def measure(self, program, count):
        self.process.stdin.write(f"{program} {count}\n")
        self.process.stdin.flush()
        return self.answer()

    def end(self):
        """@returns UrgenGo's statistics, where it has a config"""
        self.process.stdin.close()
        if self.process.wait(timeout=60) != 0:
            sys.exit(f"{self.row}: exit status {self.process.returncode}")
        if self.row in NATIVE_ROWS:
            return None
        own_time = pathlib.Path(str(self.stats) + ".own_time.json")
        return {**json.loads(self.stats.read_text()),
                "own_time": json.loads(own_time.read_text()) if own_time.exists() else None}

    def kill(self):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()


def scheduler_keys(args):
    """@returns what the config says under `scheduler:`; empty where it says nothing"""
    progress = [f"source: {args.source}"] * bool(args.source)
    progress += [f"every_us: {args.every_us}"] * (args.every_us is not None)
    keys = [f"tracking: {args.tracking}"] * bool(args.tracking)
    keys += [f"progress: {{{', '.join(progress)}}}"] * bool(progress)
    keys += [args.scheduler] * bool(args.scheduler)
    return f"scheduler: {{{', '.join(keys)}}}\n" if keys else ""


def config_of(row, args, folder, which=""):
    path = pathlib.Path(folder, f"{row}{which}.yaml")
    path.write_text(equality.CONFIG.format(mode="enforce") + MEASURED_CHAIN +
                    scheduler_keys(args) +
                    "cpu: {blocking_sync: on}\n" * (row == "blocking_sync"))
    return path


def what_statistics_show(row, program, statistics_of_process, args):
    """@returns what makes the row another one than it is called; empty if nothing does"""
    counts = statistics_of_process["chains"][0]
    if statistics_of_process["tripped"]:
        return f"{row}: UrgenGo gave up: {statistics_of_process['tripped']}"
    if row == NOBODY:
        found = counts["instances"] + counts["launches"]
        return f"{row}: found launches of the chain's, accepted: none" if found else ""
    each = 2 if args.direct else 1
    expected = args.inferences // args.block * (args.block + NUM_SKIPPED) * each
    if counts["instances"] != expected or not counts["scheduled"]:
        return (f"{row}: found {counts['instances']} instances, {counts['scheduled']} launches "
                f"scheduled, accepted: {expected}, and some")
    # The paper's ways of tracking look at every launch.
    may_skip = row == "profiled" and args.tracking in ("", "progress") and program == "eager"
    if may_skip and 2 * counts["as_planned"] < counts["launches"]:
        return (f"{row}: found {counts['as_planned']} of {counts['launches']} launches as planned, "
                "accepted: half of them")
    if counts["holds"]:
        return f"{row}: found {counts['holds']} holds, accepted: 0, as there is nothing to wait for"
    return ""


def run_round(number, rows, program, profile, args):
    """@returns by row, of each process: its blocks by kind, its statistics, and where
    the driver lay and how many pointers to it were found"""
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        processes = []
        for number_of_row in range(args.processes):
            for row in rows:
                processes.append(Process(row, number_of_row, profile, args, folder))
                stack.callback(processes[-1].kill)
        places = [process.answer() for process in processes]
        blocks = [collections.defaultdict(list) for _ in processes]
        order, source = list(range(len(processes))), random.Random(number)
        for _ in range(args.inferences // args.block):
            source.shuffle(order)
            for i in order:
                for thread, its in processes[i].measure(program, args.block).items():
                    blocks[i][thread].append(its)
        statistics_of = [process.end() for process in processes]

        def by_row(its):
            return {row: its[i::len(rows)] for i, row in enumerate(rows)}

        return by_row(blocks), by_row(statistics_of), by_row(places)


class Measured:
    """What the rounds so far have shown."""

    def __init__(self, rows, args):
        self.rows, self.args = rows, args
        self.rounds, self.statistics, self.own, self.wrong = [], [], [], []
        self.driver_places = []

    def add_round(self, number, profiles):
        blocks, counts, own = ({row: {} for row in self.rows} for _ in range(3))
        for program in self.args.programs:
            its, by_row, places = run_round(number, self.rows, program, profiles[program], self.args)
            self.driver_places.append(places)
            for row in self.rows:
                blocks[row][program] = its[row]
                if row in NATIVE_ROWS:
                    continue
                counts[row][program] = [one["chains"][0] for one in by_row[row]]
                own[row][program] = [one["own_time"] for one in by_row[row]]
                wrong = [what_statistics_show(row, program, one, self.args) for one in by_row[row]]
                self.wrong += [one for one in wrong if one]
        self.rounds.append(blocks)
        self.statistics.append(counts)
        self.own.append(own)

    def report(self):
        """Prints the table and writes the file. @returns what is wrong, or above its goal"""
        args, rows, rounds = self.args, self.rows, self.rounds
        summaries = [{row: {program: {kind: summary(processes, kind) for kind in processes[0]}
                            for program, processes in programs.items()}
                      for row, programs in blocks.items()} for blocks in rounds]
        ratios = {program: {name: {row: ratios_of(rounds, row, program, name) for row in rows}
                            for name in GOALS} for program in args.programs}
        above = print_table(rows, summaries, ratios, args.programs)
        times = own_times(rows, rounds, self.own, self.statistics, args.programs)
        if args.out:
            equality.write_json(args.out, {
                **equality.where_and_when("tools/bench/program_cost.py", args.build, args.commit),
                "batch": args.batch, "scheduler": scheduler_keys(args).strip(), "goals": GOALS,
                "ratios": ratios, "own_times": times, "rounds": summaries,
                "statistics": self.statistics, "driver_places": self.driver_places,
                "turns": [{row: {program: [{kind: {name: [round(metric(block, name), 2)
                                                          for block in its] for name in METRICS}
                                            for kind, its in one.items()} for one in processes]
                                 for program, processes in programs.items()}
                           for row, programs in blocks.items()} for blocks in rounds],
                "wrong": self.wrong, "above_goal": above})
        return self.wrong + above


def parse():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default="build/release",
                        help="folder with bin/urgengo and lib/urgengo [build/release]")
    parser.add_argument("--rounds", type=int, default=14, help="of new processes [14]")
    parser.add_argument("--processes", type=int, default=3, help="of each row in a round [3]")
    parser.add_argument("--inferences", type=int, default=64,
                        help="of a process, of each kind [64]")
    parser.add_argument("--block", type=int, help="of those in a turn [8; with --direct 20]")
    parser.add_argument("--programs", default=",".join(PROGRAMS), help="[eager,graph]")
    parser.add_argument("--batch", type=int, default=1, help="pictures in an inference [1]")
    parser.add_argument("--tracking", default="", choices=TRACKING,
                        help="scheduler: {tracking: ...} of all rows but native")
    parser.add_argument("--source", default="", choices=SOURCES,
                        help="scheduler: {progress: {source: ...}}, likewise")
    parser.add_argument("--every-us", type=int,
                        help="scheduler: {progress: {every_us: ...}}, likewise")
    parser.add_argument("--scheduler", default="", metavar="KEYS",
                        help="more keys of scheduler:, likewise, such as 'binding: none'")
    parser.add_argument("--blocking-sync", action="store_true",
                        help="one more row: a chain with cpu: {blocking_sync: on}")
    parser.add_argument("--cpus", default="", help="where all processes run, as in taskset -c")
    parser.add_argument("--out", type=pathlib.Path, help="write all numbers to this JSON file")
    parser.add_argument("--commit", default="", help="that was built, for the JSON file")
    parser.add_argument("--direct", action="store_true",
                        help="compare with inferences past UrgenGo in the same processes, not "
                             "with native ones")
    parser.add_argument("--serve", default="", help=argparse.SUPPRESS)
    args = parser.parse_args()
    args.programs = args.programs.split(",")
    if args.block is None:
        args.block = 20 if args.direct else 8
    if not set(args.programs) <= set(PROGRAMS):
        parser.error(f"--programs: found {','.join(args.programs)}, accepted: {','.join(PROGRAMS)}")
    if args.rounds < 1 or args.processes < 1 or not 1 <= args.block <= args.inferences:
        parser.error("accepted: --rounds and --processes from 1, --block from 1 to --inferences")
    return args


def main():
    args = parse()
    if args.serve:
        serve(args.batch, tuple(args.serve.split(",")))
        return
    equality.skip_if(equality.why_not_here(("torch", "torchvision")))
    args.build = equality.check_build(args.build)
    rows = [*((NOBODY,) if args.direct else NATIVE_ROWS), *JUDGED_ROWS]
    rows += ["blocking_sync"] * args.blocking_sync

    measured = Measured(rows, args)
    with tempfile.TemporaryDirectory() as folder:
        profiles = {program: learn_profile(program, args, folder) for program in args.programs}
        for number in range(args.rounds):
            begin = time.monotonic()
            measured.add_round(number, profiles)
            # A bench that is cut off has lost its last round, no more.
            with contextlib.redirect_stdout(io.StringIO()):
                measured.report()
            print(f"round {number + 1} of {args.rounds}: {time.monotonic() - begin:.1f} s",
                  flush=True)
    too_much = measured.report()
    if too_much:
        sys.exit("\n".join(too_much))


if __name__ == "__main__":
    main()
