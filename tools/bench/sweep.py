#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Random workloads, each bare, under UrgenGo with a profile of its own, and without one.

A workload is its number's: three to five chains at a load of 0.5 to 0.95, over one to four streams,
now and then two that share a mutex around their launches, one that waits for another one's frames, a
back-to-back thread of no chain beside them (urgengo_thread_mix, simulated GPU). Each chain alone
would meet its deadlines: what no scheduler can meet says nothing of one. So a chain's load counts
that a kernel of the back-to-back thread, which is never held, comes between two of its own, and
a chain that waits for another one's frame has a deadline in which both fit.

The profile is by a libcupti that tells of the simulated GPU's kernels (urgengo_fake_cupti), since
marks cannot time a task over several streams.

A chain is worse if it misses 2 frames and 2 % of its frames more than bare, and does so again when
both run again with the same seed (--again): then, and only then, both run again. Above a load of 1
(--most-load) only means count. Exit status 1 if a chain is worse, or the mean of misses is beyond
--goal times bare's.

--specs takes the workloads from a file instead: a list of specs with names. known_workloads.json has
those that earlier versions made worse: urgent chains that take a lock, or wait for an event, of a
looser one, tasks over several streams, a busy thread of no chain.

--side-by-side runs so many workloads at once, each on a simulated GPU of its own, which leaves most
of a core idle. What runs again runs alone: so no chain is worse because of another workload. The mean
is of the first runs: a few short workloads side by side need a --goal with room.

  tools/bench/sweep.py --count 100 --out sweep.json                    # outside CI
  tools/bench/sweep.py --count 10 --seconds 2 --side-by-side 3 --again 5 --goal 0.6   # in CI
  tools/bench/sweep.py --specs tools/bench/known_workloads.json --seconds 3 --more-pct 1
  for i in $(seq 100); do tools/bench/sweep.py --first $i --count 1 --folder F; done

--stall-ms stops all threads of the program for so long, every 0.6 s in the mean (stalls.py), in every
row at the same times: frames pile up, as on a machine whose cores are taken away now and then. Near
the limit more is late then than any scheduler can meet, so nothing runs again, and only means count.

--loops runs so many processes beside all of it that compute half of the time (busy_loops.py): the
cores are busy, and the simulated GPU, which is a thread, is late now and then as well.

--folder keeps what has run: the same command goes on after it was cut off.
"""
import argparse
import concurrent.futures
import hashlib
import itertools
import json
import os
import pathlib
import random
import statistics
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import busy_loops  # noqa: E402
import mix_plan  # noqa: E402
import result_file  # noqa: E402
import stalls  # noqa: E402

ROWS = ("bare", "profile", "none")
JUDGED_ROWS = ROWS[1:]
FEATURES = ("streams", "lock", "wait", "bystander")
PERIODS_MS = (15, 20, 25, 33, 40, 50, 66, 80, 100, 150)
KERNELS_US = (50, 100, 200, 400, 800)
DEADLINES = (0.6, 1.0)   # of the period
P_STREAMS, P_LOCK, P_WAIT, P_BYSTANDER = 0.5, 0.25, 0.35, 0.25
BOTH_FIT = 0.7           # of the deadline of the chain that waits, for its time alone and the other's
MORE_FRAMES, MORE_SHARE = 2, 0.02
LOCK_WORDS = {False: "", True: " lock", "wait": " lock until done"}
LAUNCH_OVERHEAD_US = 2   # of the simulated GPU, between two kernels of a stream
TIMEOUT_S = 60


def alone_us(chain, bystander):
    """@returns what a kernel of the chain takes of its frame's time, alone but for the bystander: a
    kernel of that comes in wherever the chain's streams leave a gap"""
    beside_us = bystander["kernel_us"] / chain["streams"] if bystander else 0
    return chain["kernel_us"] + LAUNCH_OVERHEAD_US + beside_us


def can_wait(waits, waited_for, bystander):
    """@returns whether both frames fit into the deadline of the one that waits"""
    both_us = sum(chain["kernels"] * alone_us(chain, bystander) for chain in (waits, waited_for))
    return both_us <= BOTH_FIT * 1000 * waits["deadline_ms"]


def draw(number, least_load=0.5, most_load=0.95):
    """@returns the workload of that number, a spec for urgengo_thread_mix, and its load"""
    source = random.Random(number)
    count, load = source.randint(3, 5), source.uniform(least_load, most_load)
    shares = [source.uniform(0.3, 1) for _ in range(count)]
    bystander = None
    if source.random() < P_BYSTANDER:
        bystander = {"kernels": source.randint(1, 4), "kernel_us": source.choice(KERNELS_US[:4])}
    chains = []
    for i, share in enumerate(shares):
        period_ms, kernel_us = source.choice(PERIODS_MS), source.choice(KERNELS_US)
        streams = source.randint(2, 4) if source.random() < P_STREAMS else 1
        chain = {"name": f"chain_{'abcde'[i]}", "period_ms": period_ms,
                 "deadline_ms": round(period_ms * source.uniform(*DEADLINES)), "offset_ms": i,
                 "kernels": 1, "kernel_us": kernel_us, "streams": streams}
        its_us = 1000 * period_ms * load * share / sum(shares)
        chain["kernels"] = max(1, round(its_us / alone_us(chain, bystander)))
        chains.append(chain)
    if source.random() < P_LOCK:
        for chain in source.sample(chains, 2):
            chain["locks"] = True
    pairs = [pair for pair in itertools.permutations(chains, 2) if can_wait(*pair, bystander)]
    if source.random() < P_WAIT and pairs:
        waits, waited_for = source.choice(pairs)
        waits["waits_for"] = waited_for["name"]
    return {"chains": chains, "bystander": bystander}, load


def read_specs(path):
    """@returns specs of a file, by number from 1, with what `draw` would have filled in"""
    specs = {}
    for number, spec in enumerate(json.loads(path.read_text()), 1):
        spec.setdefault("bystander", None)
        for chain in spec["chains"]:
            chain.setdefault("streams", 1)
        specs[number] = spec
    return specs


def load_of(spec):
    """@returns the GPU's load by chains, beside what is no chain's"""
    return sum(chain["kernels"] * alone_us(chain, spec["bystander"]) / (1000 * chain["period_ms"])
               for chain in spec["chains"])


def features(spec):
    """@returns what the workload has, of FEATURES"""
    chains = spec["chains"]
    return {name for name, has in {
        "streams": any(chain["streams"] > 1 for chain in chains),
        "lock": any(chain.get("locks") for chain in chains),
        "wait": any("waits_for" in chain for chain in chains),
        "bystander": spec["bystander"] is not None}.items() if has}


def title(spec):
    words = [spec["name"]] if "name" in spec else []
    for c in spec["chains"]:
        more = f" s={c['streams']}" * (c["streams"] > 1) + LOCK_WORDS[c.get("locks", False)]
        more += f" after {c['waits_for'][-1]}" if "waits_for" in c else ""
        words.append(f"{c['name'][-1]} {c['period_ms']}/{c['deadline_ms']} "
                     f"{c['kernels']}x{c['kernel_us']}us{more}")
    if spec["bystander"]:
        words.append(f"beside {spec['bystander']['kernels']}x{spec['bystander']['kernel_us']}us")
    return ", ".join(words)


def profile_factors(profile, spec):
    """@returns by chain: what the profile's kernels add up to, of what the chain's kernels take"""
    learned = {chain["name"]: sum(kernel["gpu_time_ns"] for task in chain["tasks"]
                                  for kernel in task["kernels"])
               for chain in profile["chains"]}
    return {chain["name"]: round(learned.get(chain["name"], 0) /
                                 (1000 * chain["kernels"] * chain["kernel_us"]), 2)
            for chain in spec["chains"]}


def worse_chains(report, bare, more_share=MORE_SHARE):
    """@returns the chains that missed more than bare, beyond what is allowed"""
    others = {chain["name"]: chain for chain in bare["chains"]}
    return {chain["name"] for chain in report["chains"]
            if chain["missed"] > others[chain["name"]]["missed"] + MORE_FRAMES +
            more_share * chain["frames"]}


def suspects(found, more_share=MORE_SHARE):
    """@returns the rows in which a chain of the workload missed more than bare the first time"""
    return [row for row in JUDGED_ROWS if row in found["first"] and
            worse_chains(found["first"][row], found["first"]["bare"], more_share)]


def summarise(workloads):
    """@returns mean misses of each row, their ratios to bare's, and who is worse than bare"""
    its = [one for one in workloads.values() if "bare" in one["first"]]
    means = {row: statistics.fmean(one["first"][row]["overall_miss_pct"] for one in its
                                   if row in one["first"])
             for row in ROWS if any(row in one["first"] for one in its)}
    bare = means.get("bare", 0)
    return {"workloads": len(its), "mean_miss_pct": {row: round(m, 3) for row, m in means.items()},
            "ratios": {row: round(means[row] / bare, 3) if bare else None
                       for row in JUDGED_ROWS if row in means},
            "worse": [{"workload": number, "row": row, "chains": chains}
                      for number, one in sorted(workloads.items(), key=lambda item: int(item[0]))
                      for row, chains in one["worse"].items() if chains],
            "failed": [number for number, one in workloads.items() if one.get("failed")]}


class Failed(Exception):
    pass


class Sweep:
    def __init__(self, args, folder):
        self.args, self.folder = args, folder
        self.environment = result_file.without_urgengo(os.environ)
        if not args.gpu:
            simulated = str((args.build / "lib/simgpu").resolve())
            self.environment |= {"LD_LIBRARY_PATH": simulated,
                                 "URGENGO_REAL_LIBCUDA": simulated + "/libcuda.so.1",
                                 "TWIN_SIMGPU": simulated + "/libcuda.so.1"}

    def timed_by(self):
        """@returns options of urgengo profile"""
        if self.args.gpu:
            return []
        library = (self.args.build / "tests/interposer/libfake_cupti.so").resolve()
        if not library.exists():
            sys.exit(f"{library}: not built; it times what runs on several streams")
        return ["--source", "cupti", "--cupti", str(library)]

    def execute(self, command, number=None):
        """@param number  of the workload, if the machine is to stall (--stall-ms) meanwhile"""
        stall_ms = 0 if number is None else self.args.stall_ms
        try:
            done = stalls.run(command, stall_ms, number, TIMEOUT_S, env=self.environment) \
                if stall_ms else subprocess.run(command, env=self.environment, text=True,
                                                capture_output=True, timeout=TIMEOUT_S)
        except subprocess.TimeoutExpired as error:
            raise Failed(f"it hung for {TIMEOUT_S} s") from error
        if done.returncode != 0:
            raise Failed(f"exit status {done.returncode}: {(done.stdout + done.stderr)[-800:]}")
        return done.stdout + done.stderr

    def program(self, spec, number, seconds, *more):
        return [str((self.args.build / "bin/urgengo_thread_mix").resolve()), "--spec", str(spec),
                "--seconds", str(seconds), "--seed", str(number),
                "--stack-kib", str(self.args.stack_kib), *more]

    def files(self, number):
        """@returns the spec, the config and the profile of a workload: in a folder of its own, since
        a profile that lies beside the config would be used in every row"""
        folder = self.folder / f"w{number}"
        folder.mkdir(exist_ok=True)
        return folder / "spec.json", folder / "chains.yaml", folder / "own.profile.json"

    def run(self, row, number):
        spec, config, profile = self.files(number)
        out, stats = spec.parent / "report.json", spec.parent / "stats.json"
        for path in (out, stats):
            path.unlink(missing_ok=True)
        command = self.program(spec, number, self.args.seconds, "--json", str(out))
        if row != "bare":
            command = [str((self.args.build / "bin/urgengo").resolve()), "run", "-c", str(config),
                       "--quiet", "--stats", str(stats),
                       *(["--profile", str(profile)] if row == "profile" else []), "--"] + command
        self.execute(command, number)
        report = json.loads(out.read_text())
        if stats.exists():
            report["scheduler_stats"] = json.loads(stats.read_text())
        return report

    def workload(self, number):
        """@returns its spec and its load"""
        if self.args.specs:
            spec = self.args.specs[number]
            return spec, load_of(spec)
        return draw(number, self.args.least_load, self.args.most_load)

    def first(self, number):
        """@returns the workload, and what its first run of every row gave"""
        spec, load = self.workload(number)
        paths = self.files(number)
        result_file.write(paths[0], spec)
        paths[1].write_text(mix_plan.config_text(spec["chains"], self.args.scheduler,
                                                 self.args.config))
        found = {"spec": spec, "load": round(load, 3), "first": {}, "again": {}, "worse": {}}
        try:
            found["profile_output"] = self.execute(
                [str((self.args.build / "bin/urgengo").resolve()), "profile", "-c", str(paths[1]),
                 "-o", str(paths[2]), *self.timed_by(), "--",
                 *self.program(paths[0], number + 1000, self.args.profile_seconds)])[-3000:]
            found["profile_factors"] = profile_factors(json.loads(paths[2].read_text()), spec)
            for row in ROWS:
                found["first"][row] = self.run(row, number)
        except Failed as error:
            found["failed"] = str(error)
        return found

    def again(self, number, found):
        """Runs what is suspect again, and says which chains were worse each time."""
        share = self.args.more_pct / 100
        rows = suspects(found, share)
        worse = {row: worse_chains(found["first"][row], found["first"]["bare"], share)
                 for row in rows}
        for _ in range(self.args.again):
            rows = [row for row in rows if worse[row]]
            if not rows:
                break
            try:
                found["again"] = {row: self.run(row, number) for row in ("bare", *rows)}
            except Failed as error:
                found["failed"] = str(error)
                return
            for row in rows:
                worse[row] &= worse_chains(found["again"][row], found["again"]["bare"], share)
        if found["load"] <= 1:
            found["worse"] = {row: sorted(chains) for row, chains in worse.items()}

    def run_all(self, numbers, done, keep):
        """Runs the workloads that `done` lacks into it; keep() after each."""
        missing = [number for number in numbers if number not in done]
        with concurrent.futures.ThreadPoolExecutor(self.args.side_by_side) as pool:
            for number, found in zip(missing, pool.map(self.first, map(int, missing))):
                done[number] = found
                keep()
                print_workload(number, found, "first")
        for number in numbers:
            found = done[number]
            if suspects(found, self.args.more_pct / 100) and not found["again"] and \
                    not found.get("failed") and not self.args.stall_ms:
                self.again(int(number), found)
                keep()
                print_workload(number, found, "again")


def print_workload(number, its, which):
    print(f"#{number} load {its['load']:.2f}: {title(its['spec'])}")
    factors = its.get("profile_factors", {})
    print("  profile, of the true time: " + "  ".join(f"{name[-1]} {factor:.2f}"
                                                      for name, factor in factors.items()))
    for row, report in its[which].items():
        chains = "  ".join(f"{c['name'][-1]} {c['missed']}/{c['frames']}" for c in report["chains"])
        worse = its["worse"].get(row, []) if which == "again" else []
        print(f"  {which:<5} {row:<8} {report['overall_miss_pct']:>5.1f} %  {chains}"
              f"{'  WORSE: ' + ' '.join(worse) if worse else ''}")
    if its.get("failed"):
        print(f"  FAILED: {its['failed']}")
    sys.stdout.flush()


def parse():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=pathlib.Path("build/release"),
                        help="folder with bin/urgengo and lib/simgpu [build/release]")
    parser.add_argument("--specs", type=pathlib.Path, metavar="FILE",
                        help="its workloads, not random ones")
    parser.add_argument("--more-pct", type=float, default=100 * MORE_SHARE, metavar="PCT",
                        help=f"of its frames, and {MORE_FRAMES} frames, that a chain may miss more "
                        f"than bare [{100 * MORE_SHARE:g}]")
    parser.add_argument("--first", type=int, default=1, help="workload [1]")
    parser.add_argument("--count", type=int, default=100, help="[100]")
    parser.add_argument("--seconds", type=float, default=4, help="of a run [4]")
    parser.add_argument("--profile-seconds", type=float, default=2.5)
    parser.add_argument("--least-load", type=float, default=0.5)
    parser.add_argument("--most-load", type=float, default=0.95)
    parser.add_argument("--again", type=int, default=1, metavar="N",
                        help="times that a suspect must be worse again, to count as worse [1]")
    parser.add_argument("--goal", type=float, default=0.3,
                        help="means of misses, of bare's, at most [0.3]")
    parser.add_argument("--no-goals", action="store_true",
                        help="the exit status says only whether everything ran")
    parser.add_argument("--scheduler", default="", metavar="KEYS", help="of scheduler:")
    parser.add_argument("--config", default="", metavar="LINE", help="one more line of chains.yaml")
    parser.add_argument("--only", default="", help="those of the workloads that have all of "
                        f"{','.join(FEATURES)}, as named here [all workloads]")
    parser.add_argument("--stack-kib", type=int, default=8192, help="of each chain's thread [8192]")
    parser.add_argument("--side-by-side", type=int, default=1, metavar="N",
                        help="workloads that run at once, the first time [1]")
    parser.add_argument("--stall-ms", type=float, default=0, metavar="MS",
                        help="the program stands still for so long, now and then [0: never]")
    parser.add_argument("--loops", type=int, default=0, metavar="N",
                        help="processes beside it that compute half of the time [0]")
    parser.add_argument("--gpu", action="store_true", help="on the GPU that is here")
    parser.add_argument("--folder", type=pathlib.Path, help="keep what has run, and go on from it")
    parser.add_argument("--out", type=pathlib.Path, help="write all numbers to this JSON file")
    parser.add_argument("--commit", default="", help="that was built, for the JSON file")
    args = parser.parse_args()
    if args.specs:
        try:
            args.specs = read_specs(args.specs)
        except (OSError, ValueError, KeyError) as error:
            parser.error(f"--specs: {args.specs}: {error!r}")
        args.count = min(args.count, len(args.specs) - args.first + 1)
    args.only = set(args.only.split(",")) - {""}
    if not args.only <= set(FEATURES):
        parser.error(f"--only: found {','.join(sorted(args.only))}, accepted: {','.join(FEATURES)}")
    if args.side_by_side < 1 or (args.gpu and args.side_by_side > 1):
        parser.error("accepted: --side-by-side from 1; with --gpu 1 alone, since there is one GPU")
    for option, found in (("--stall-ms", args.stall_ms), ("--loops", args.loops)):
        if found < 0:
            parser.error(f"{option}: found {found:g}, accepted: 0 or more")
    if args.first < 0 or args.count < 1 or not 0 < args.least_load <= args.most_load:
        parser.error("accepted: --first from 0, --count from 1, --least-load up to --most-load")
    return args


def main():
    args = parse()
    with tempfile.TemporaryDirectory() as temporary:
        folder = (args.folder or pathlib.Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        # What ran otherwise is another sweep.
        what = f"{args.least_load:g}_{args.most_load:g}"
        if args.specs:
            specs = json.dumps(args.specs, sort_keys=True).encode()
            what = hashlib.sha256(specs).hexdigest()[:12]
        if args.stall_ms:
            what += f"_stalls_{args.stall_ms:g}"
        if args.loops:
            what += f"_loops_{args.loops}"
        kept = folder / f"workloads_{args.seconds:g}_{what}.json"
        done = json.loads(kept.read_text()) if kept.exists() else {}
        sweep = Sweep(args, folder)
        wanted = [str(number) for number in range(args.first, args.first + args.count)
                  if args.only <= features(sweep.workload(number)[0])]
        with busy_loops.beside(args.loops):
            sweep.run_all(wanted, done, lambda: result_file.write(kept, done))
        found = summarise({number: done[number] for number in wanted})
        print(json.dumps(found))
        if args.out:
            result_file.write(args.out, {
                **result_file.where_and_when("tools/bench/sweep.py", args.build, args.commit),
                "seconds": args.seconds, "stall_ms": args.stall_ms,
                "loops": args.loops,
                "loads": [args.least_load, args.most_load],
                "summary": found, "workloads": {number: done[number] for number in wanted}})
    beyond = [row for row, ratio in found["ratios"].items() if ratio and ratio > args.goal]
    missed = found["worse"] or beyond
    if found["failed"] or (missed and not args.no_goals):
        sys.exit(f"worse than bare: {len(found['worse'])}; failed: {len(found['failed'])}; "
                 f"mean beyond {args.goal} of bare's: {', '.join(beyond) or 'none'}")


if __name__ == "__main__":
    main()
