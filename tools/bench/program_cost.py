#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What UrgenGo costs a program when there is nothing to hold: ResNet-50 inference in PyTorch.

One thread runs the network and takes another name for every inference: the chain's, or one that is
nobody's (with --direct it keeps one). Rows: native, twice, where neither name is anything, which
shows the noise; chain (the config's only one, enforced); profiled (the same with a profile of the
first program, learned by `urgengo profile` at the begin). A round has several processes of each
row, which take turns on one core.

Costs are told apart. Chain to nobody: what being scheduled takes, block by block of pairs in one
process. To native: what the processes with UrgenGo take, as nobody's and as the chain's, of what
the native ones of their round do: means of their lower quartiles. Processes of one program differ by
1.5 % (standard deviation, H200), so half a per cent needs a hundred of them. Every process maps a
random number of pages before it loads PyTorch: where its smaller libraries and stacks lie is then
chance in every row, and not in each the one place to which what it maps pushes them.

With --direct, instead of both, to direct: all that UrgenGo executes. Compared are inferences of the
same thread, two through UrgenGo and two past it in turns, by its libraries' pointers to the driver
(driver_pointers.py); of each two the second. For it is a program's loop that is to be measured: it
keeps its name, its next inference begins at once, and what one uses is still in the caches as far
as another one leaves it there. Rows: nobody, chain, profiled.

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
import statistics
import subprocess
import sys
import tempfile
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests/gpu"))
sys.path.insert(0, str(HERE))
import driver_pointers  # noqa: E402
import equality  # noqa: E402: configs, and how a program is found to be runnable here

PROGRAMS = ("eager", "graph")
TRACKING = ("progress", "async", "sync", "batched", "overlapped")
SOURCES = ("auto", "kernel", "memop", "event")
METRICS = ("latency_us", "thread_cpu_us", "process_cpu_us")
GOALS = {"latency_us": 1.005, "p99_us": None, "thread_cpu_us": 1.02, "process_cpu_us": 1.02}
NATIVE_ROWS = ("native", "native_again")
JUDGED_ROWS = ("chain", "profiled")
NOBODY, CHAIN = "nobody", equality.CHAIN_THREAD
DIRECT = "direct"  # past UrgenGo, in the thread of the other kind
# A period that is shorter than any inference: where several fit into one, `urgengo profile` takes
# them for one instance.
MEASURED_CHAIN = f"""  - name: measured
    period_ms: 1
    deadline_ms: 500
    tasks: [{{name: all, thread: "{CHAIN}"}}]
"""
WARM_UP = 50
NUM_PROFILED = 200
NUM_SKIPPED = 5  # of a block: the GPU comes from another process
RESAMPLES = 2000
MOST_PAGES = 2048  # 8 MiB: libraries of 2 MiB and more begin where their pages can be huge ones


class Inference:
    """In a process of its own: ResNet-50, in a thread that is the chain or is of none."""

    def __init__(self, batch, kinds):
        import torch
        import torchvision

        torch.backends.cudnn.benchmark = False  # nothing is chosen by timing
        torch.manual_seed(7)
        self.torch = torch
        self.model = torchvision.models.resnet50(weights=None).half().eval().cuda()
        self.picture = torch.randn(batch, 3, 224, 224).half().pin_memory()
        self.static = self.picture.cuda()
        with torch.inference_mode():
            for _ in range(WARM_UP):
                self.eager()
            torch.cuda.synchronize()
            self.captured = torch.cuda.CUDAGraph()
            with torch.cuda.graph(self.captured, capture_error_mode="thread_local"):
                self.scores = self.model(self.static)
            for _ in range(WARM_UP):
                self.graph()
        self.kinds = kinds
        self.pointers = driver_pointers.DriverPointers() if DIRECT in kinds else None
        if self.pointers:
            equality.name_thread(CHAIN)
            with torch.inference_mode():
                # Is no instance of the chain's: what_statistics_show() counts them.
                self.pointers.go(directly=True)
                self.eager()
                self.graph()

    def eager(self):
        self.static.copy_(self.picture, non_blocking=True)
        return self.model(self.static).cpu()

    def graph(self):
        self.static.copy_(self.picture, non_blocking=True)
        self.captured.replay()
        return self.scores.cpu()

    def one(self, infer):
        """@returns what an inference takes, in us"""
        begin = time.process_time_ns(), time.thread_time_ns(), time.perf_counter_ns()
        infer()
        end = time.perf_counter_ns(), time.thread_time_ns(), time.process_time_ns()
        return {name: (after - before) / 1000
                for name, before, after in zip(METRICS, reversed(begin), end)}

    def measure(self, program, count):
        """@returns times of `count` inferences of each kind, in turns"""
        infer, block = getattr(self, program), {kind: [] for kind in self.kinds}
        with self.torch.inference_mode():
            for kind, counts in self.turns(count):
                if self.pointers:
                    self.pointers.go(directly=kind == DIRECT)
                else:
                    equality.name_thread(kind)
                its = self.one(infer)
                if counts:
                    block[kind].append(its)
        return block

    def turns(self, count):
        """@returns the kinds of the inferences of a block, in turns, and whether each counts"""
        for i in range(NUM_SKIPPED + count):
            for kind in self.kinds:
                if self.pointers:
                    yield kind, False  # what it uses is in the caches, as far as it stays there
                yield kind, i >= NUM_SKIPPED


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


def percentile(values, share):
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def summary(processes, thread):
    """Of one row's inferences under that name in one round."""
    all_of = [one for blocks in processes for block in blocks[thread] for one in block]
    return {**{name: metric(all_of, name) for name in GOALS},
            "max_us": max(one["latency_us"] for one in all_of)}


def metric(block, name):
    if name == "p99_us":
        return percentile([one["latency_us"] for one in block], 0.99)
    return statistics.median(one[name] for one in block)


def interval(medians):
    """@param medians: of RESAMPLES draws
    @returns what 95 % of them lie between"""
    medians = sorted(medians)
    return {"low": medians[int(0.025 * RESAMPLES)], "high": medians[int(0.975 * RESAMPLES) - 1]}


def in_process(processes, thread, other, name):
    """@param processes: blocks by thread, turn by turn
    @returns the median of the ratios of turns, thread's to other's, and its 95 % interval"""
    of_turns = [[metric(its, name) / metric(others, name)
                 for its, others in zip(blocks[thread], blocks[other])] for blocks in processes]
    source, medians = random.Random(1), []
    for _ in range(RESAMPLES):
        drawn = [source.choice(turns) for turns in source.choices(of_turns, k=len(of_turns))
                 for _ in turns]
        medians.append(statistics.median(drawn))
    return {"ratio": statistics.median(r for turns in of_turns for r in turns),
            **interval(medians)}


def of_process(blocks, threads, name, share):
    """@returns that percentile of a process's inferences under these names"""
    its = [one for thread in threads for block in blocks[thread] for one in block]
    return metric(its, name) if name == "p99_us" else percentile([one[name] for one in its], share)


def of_row(blocks, row, program, threads, name, share):
    """@returns the mean over its processes"""
    return statistics.mean(of_process(its, threads, name, share) for its in blocks[row][program])


def to_native(rounds, row, program, threads, name, share=0.25):
    """@returns the median over rounds of a row's ratio to the native ones, and its 95 % interval.
    A native row is compared with the other one, so its interval is wider by 1.41 / 1.22."""
    others = [native for native in NATIVE_ROWS if native != row]
    ratios = [of_row(blocks, row, program, threads, name, share) /
              statistics.mean(of_row(blocks, native, program, (NOBODY, CHAIN), name, share)
                              for native in others)
              for blocks in rounds]
    source = random.Random(1)
    medians = [statistics.median(source.choices(ratios, k=len(ratios))) for _ in range(RESAMPLES)]
    return {"ratio": statistics.median(ratios), **interval(medians),
            "rounds": [round(one, 5) for one in ratios]}


def ratios_of(rounds, row, program, name):
    """@returns the chain's inferences to nobody's, and each to the native processes'; or one of
    them to those past UrgenGo"""
    processes = [its for blocks in rounds for its in blocks[row][program]]
    if DIRECT in processes[0]:
        kind = NOBODY if row == NOBODY else CHAIN
        which = "nobody_to_direct" if row == NOBODY else "chain_to_direct"
        return {which: in_process(processes, kind, DIRECT, name)}
    ratios = {"chain_to_nobody": in_process(processes, CHAIN, NOBODY, name)}
    if row in NATIVE_ROWS:
        ratios["nobody_to_native"] = to_native(rounds, row, program, (NOBODY, CHAIN), name)
    elif all(native in rounds[0] for native in NATIVE_ROWS):
        ratios["nobody_to_native"] = to_native(rounds, row, program, (NOBODY,), name)
        ratios["chain_to_native"] = to_native(rounds, row, program, (CHAIN,), name)
        if name != "p99_us":
            ratios["chain_to_native"]["of_medians"] = to_native(rounds, row, program, (CHAIN,), name,
                                                                0.5)
    return ratios


def print_table(rows, summaries, ratios, programs):
    """@returns what is above its goal"""
    above = []
    for program in programs:
        for name, goal in GOALS.items():
            print(f"\n{program}, {name}, by kind of inference"
                  f"{f'; the goal of chain to ...: {goal}' if goal else ''}")
            for row in rows:
                line = f"  {row:<14}"
                for kind in summaries[0][row][program]:
                    values = [one[row][program][kind][name] for one in summaries]
                    line += f"{statistics.median(values):>10.1f}"
                r = ratios[program][name][row]
                line += "".join(f"   {which.replace('_', ' ')} {one['ratio']:.4f} "
                                f"[{one['low']:.4f}, {one['high']:.4f}]"
                                for which, one in r.items())
                if goal and row in JUDGED_ROWS:
                    # Processes differ by as much as the goal: the interval judges them.
                    its = [f"{program} {name} {row} {which} {r[which][judged]:.4f}"
                           for which, judged in (("chain_to_nobody", "ratio"),
                                                 ("chain_to_direct", "ratio"),
                                                 ("chain_to_native", "low"))
                           if which in r and r[which][judged] > goal]
                    shown = list(r.values())[-1]["high"] <= goal
                    line += "  ABOVE" if its else "  within" if shown else "  within, or unclear"
                    above += its
                print(line)
    return above


def own_times(rows, rounds, all_own, all_statistics, programs):
    """@returns by row and program: our own time a launch, and its share of the latency"""
    times = {}
    for row, program in ((row, program) for row in rows for program in programs):
        its = [own for of_round in all_own for own in of_round[row].get(program, ()) if own]
        if not its:
            continue
        launches = statistics.median(counts["launches"] / counts["instances"]
                                     for s in all_statistics for counts in s[row][program])
        latency_us = statistics.median(one["latency_us"] for blocks in rounds
                                       for its_blocks in blocks[row][program]
                                       for block in next(iter(its_blocks.values()))
                                       for one in block)
        mean_ns = statistics.median(own["own_ns"]["mean"] for own in its)
        median_ns = statistics.median(own["own_ns"]["median"] for own in its)
        share = mean_ns * launches / 1000 / latency_us
        times.setdefault(row, {})[program] = {
            "median_ns": median_ns, "mean_ns": mean_ns, "launches_of_an_inference": launches,
            "share_of_latency": share, "rounds": its}
        print(f"\n{row}, {program}: own time a launch {median_ns:.0f} ns (median), {mean_ns:.0f} ns "
              f"(mean, with marks and what is done once); {launches:.0f} launches an inference, "
              f"{100 * share:.2f} % of its latency")
    return times


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
