#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Networks as threads of one process, each with its own period, deadline and CUDA stream.

An ordinary PyTorch program that knows nothing of any scheduler: each thread waits for its next
frame, infers, waits for its stream, and notes how late that was (frames.py). What the threads share
is what such programs share: the GPU and Python's lock.

  network_threads.py --spec mix.json --seconds 10 --out report.json
  network_threads.py --spec mix.json --phases 1,2,1b,2b     # seeds; b: beside the bystander
  network_threads.py --spec mix.json --alone                # one after the other
  network_threads.py --spec mix.json --back-to-back         # all together, no arrivals
  network_threads.py --spec mix.json --empty                # the smallest inputs: mere launching

mix.json: {"networks": [{"name": "n0_resnet50", "network": "resnet50", "form": "eager",
"period_ms": 30, "deadline_ms": 20, "batch": 8, "copy": false}, ...]}; names are the threads', 15
characters at most; batch and copy may be left out, with --alone the deadline and the period, too:
frames then come back to back.

A phase is a run of its own: all frames of the last one have ended, the arrivals are the seed's, and
nothing is built anew. --simulated takes kernels of the simulated GPU instead of networks.

Exit status 77 without PyTorch or a GPU, 1 if a network could not be built or run; with --keep-going
those are named in the report, and the others run.
"""
import argparse
import contextlib
import ctypes
import json
import os
import pathlib
import re
import resource
import subprocess
import sys
import threading
import time

import frames
import networks

SKIPPED = 77
PR_SET_NAME = 15
MOST_NAME_BYTES = 15
WARM_UP_FRAMES = 12
ALONE_LEAST_FRAMES = 20
START_DELAY_S = 0.2
BYSTANDERS = ("matmul", "train")
BYSTANDER_NAME = "background"
BYSTANDER_AHEAD = 8


def name_thread(name):
    ctypes.CDLL(None).prctl(PR_SET_NAME, name.encode(), 0, 0, 0)


def parse_phases(text):
    """@returns (seed, whether the bystander runs) of each of "1,2,1b"
    @errors ValueError if it is anything else"""
    phases = []
    for word in text.split(","):
        found = re.fullmatch(r"(\d+)(b?)", word.strip())
        if not found:
            raise ValueError(f"--phases: found {word}, accepted: a seed, or a seed and b, as in 1,1b")
        phases.append((int(found[1]), bool(found[2])))
    return phases


def what_is_wrong(spec, alone=False):
    """@returns the first thing that is wrong with a spec; empty if nothing is"""
    its = spec.get("networks", [])
    if not its:
        return "networks: found none, accepted: one or more"
    names = [one.get("name", "") for one in its]
    for one, name in zip(its, names):
        if not 0 < len(name.encode()) <= MOST_NAME_BYTES or names.count(name) > 1:
            return f"name: found {name!r}, accepted: 1 to {MOST_NAME_BYTES} bytes, each once"
        wrong = networks.known(one.get("network", ""), one.get("form", ""))
        if wrong:
            return wrong
        for key in () if alone else ("period_ms", "deadline_ms"):
            if not one.get(key, 0) > 0:
                return f"{name}: {key}: found {one.get(key)}, accepted: more than 0"
    return ""


class Chain:
    """A network's thread: what it is, and what became of its frames in each phase."""

    def __init__(self, spec, network):
        self.spec, self.network = spec, network
        self.name = spec["name"]
        self.dues, self.ends = [], []

    def plan(self, seed, seconds, start_s):
        self.ends = []
        self.dues = [start_s + due for due in
                     frames.arrivals_s(self.name, seed, self.spec["period_ms"], seconds)]

    def run(self):
        self.ends = frames.run_frames(self.dues, self.network.frame, time.monotonic, time.sleep)

    def run_alone(self, seconds):
        """@returns latencies of frames, ms: at its period, back to back if it has none"""
        period_s = self.spec.get("period_ms", 0) / 1000
        latencies, begin = [], time.monotonic()
        while len(latencies) < ALONE_LEAST_FRAMES or time.monotonic() - begin < seconds:
            due = time.monotonic()
            if period_s:
                due = max(begin + len(latencies) * period_s, due - period_s)
                time.sleep(max(0, due - time.monotonic()))
            self.network.frame()
            latencies.append((time.monotonic() - due) * 1000)
        return latencies

    def run_back_to_back(self, seconds):
        """@returns how many frames it got done"""
        until, count = time.monotonic() + seconds, 0
        while time.monotonic() < until:
            self.network.frame()
            count += 1
        return count

    def report(self, counted_from_s, with_frames=False):
        its = frames.of_frames(self.dues, self.ends, self.spec["deadline_ms"], counted_from_s)
        if with_frames:  # [arrival, latency or nothing], both ms
            its["each"] = [[round((due - counted_from_s) * 1000, 1),
                            end and round((end - due) * 1000, 1)]
                           for due, end in zip(self.dues, self.ends)]
        return {key: self.spec[key] for key in
                ("name", "network", "form", "period_ms", "deadline_ms")} | its | \
            {"answer_sha256": self.network.answer_sha256()}


class Bystander(threading.Thread):
    """Back to back on its own stream, at no chain's name: batches of one size, or training."""

    def __init__(self, kind, simulated_gpu=None):
        super().__init__(name=BYSTANDER_NAME, daemon=True)
        self.kind, self.gpu = kind, simulated_gpu
        self.ready, self.over = threading.Event(), threading.Event()
        self.turns, self.error = 0, None

    def simulated(self):
        from simulated_network import SimulatedNetwork

        self.gpu.enter()
        return SimulatedNetwork({"network": BYSTANDER_NAME}, gpu=self.gpu).frame

    def matmul(self, torch, stream):
        a = torch.rand(4096, 4096, device="cuda").half()

        def turn():
            for _ in range(BYSTANDER_AHEAD):
                torch.mm(a, a)
            stream.synchronize()

        return turn

    def train(self, torch, stream):
        from torchvision import models

        model = models.resnet18(weights=None).cuda().to(memory_format=torch.channels_last)
        optimizer = torch.optim.SGD(model.parameters(), lr=1e-3)
        images = torch.rand(64, 3, 224, 224, device="cuda").to(memory_format=torch.channels_last)
        labels = torch.randint(0, 1000, (64,), device="cuda")

        def turn():
            with torch.autocast("cuda", torch.float16):
                loss = torch.nn.functional.cross_entropy(model(images), labels)
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            optimizer.step()
            stream.synchronize()

        return turn

    def run(self):
        name_thread(BYSTANDER_NAME)
        try:
            with contextlib.ExitStack() as stack:
                if self.gpu:
                    turn = self.simulated()
                else:
                    import torch

                    stream = torch.cuda.Stream()
                    stack.enter_context(torch.cuda.stream(stream))
                    turn = getattr(self, self.kind)(torch, stream)
                turn()
                self.ready.set()
                while not self.over.is_set():
                    turn()
                    self.turns += 1
        except Exception as error:  # whatever a framework throws
            self.error = error
        self.ready.set()

    def start_and_wait(self):
        self.start()
        self.ready.wait()

    def end(self):
        """@returns how often it came round @errors RuntimeError if it failed"""
        self.over.set()
        self.join()
        if self.error:
            raise RuntimeError(f"the bystander: {self.error!r}")
        return self.turns


class Program:
    def __init__(self, spec, args):
        self.args, self.chains, self.broken, self.gpu = args, [], {}, None
        begin = time.monotonic()
        if args.simulated:
            from simulated_network import SimulatedGpu, SimulatedNetwork

            self.gpu = SimulatedGpu()
            self.software = {"gpu": self.gpu.name() + " (simulated)"}

            def make(one):
                return SimulatedNetwork(one, args.empty, self.gpu)
        else:
            self.software = networks.set_up_torch()
            if self.software is None:
                print("skipped: no GPU")
                sys.exit(SKIPPED)

            def make(one):
                return networks.TorchNetwork(one, args.empty)
        self.times_s = {"import": time.monotonic() - begin}
        for one in spec["networks"]:
            if args.only and one["name"] not in args.only:
                continue
            try:
                self.chains.append(Chain(one, make(one)))
            except Exception as error:  # whatever a framework throws
                self.fails(one["name"], error)
        self.times_s["build"] = time.monotonic() - begin - self.times_s["import"]
        self.one_at_a_time = threading.Lock()
        self.reports = []

    def fails(self, name, error):
        if not self.args.keep_going:
            raise error
        self.broken[name] = f"{type(error).__name__}: {error}"[:300]
        print(f"{name}: {self.broken[name]}", file=sys.stderr, flush=True)

    @contextlib.contextmanager
    def as_chain(self, chain):
        """The calling thread is the chain's: named, on its stream, and warmed up."""
        name_thread(chain.name)
        with contextlib.ExitStack() as stack:
            chain.network.enter(stack)
            with self.one_at_a_time:  # libraries load kernels and make handles for each thread
                for _ in range(WARM_UP_FRAMES):
                    chain.network.frame()
            yield

    def run_alone(self):
        for chain in self.chains:
            def work(chain=chain):
                try:
                    with self.as_chain(chain):
                        latencies = sorted(chain.run_alone(self.args.seconds))
                except Exception as error:
                    failures.append(error)
                    return
                its = {key: chain.spec[key] for key in
                       ("name", "network", "form", "period_ms", "deadline_ms")
                       if key in chain.spec}
                deadline_ms = chain.spec.get("deadline_ms", float("inf"))
                its |= {"frames": len(latencies), "latency_ms": {
                    "p50": frames.at(latencies, 0.5), "p90": frames.at(latencies, 0.9),
                    "p99": frames.at(latencies, 0.99), "max": latencies[-1]},
                    "missed": sum(latency > deadline_ms for latency in latencies)}
                self.reports.append(its)

            failures = []
            thread = threading.Thread(target=work)
            thread.start()
            thread.join()
            if failures:
                self.fails(chain.name, failures[0])

    def run_in_threads(self, work, lead):
        """Each chain in a thread of its own, warmed up: work(chain, gate). Meanwhile lead(gate).
        The gate is passed by all chains and the caller together.
        @errors the first of a chain"""
        gate, failures = threading.Barrier(len(self.chains) + 1), []

        def run(chain):
            try:
                with self.as_chain(chain):
                    gate.wait()  # everybody has warmed up
                    work(chain, gate)
            except threading.BrokenBarrierError:
                pass
            except Exception as error:
                failures.append(error)
                gate.abort()

        threads = [threading.Thread(target=run, args=(chain,), name=chain.name)
                   for chain in self.chains]
        for thread in threads:
            thread.start()
        try:
            gate.wait()
            lead(gate)
        except threading.BrokenBarrierError:
            pass
        finally:
            gate.abort()  # the other threads do not wait for one that has failed
            for thread in threads:
                thread.join()
        if failures:
            raise failures[0]

    def run_back_to_back(self):
        """How much they get done together: frames of each in --seconds, and what that took."""
        done = {}

        def work(chain, gate):
            done[chain.name] = chain.run_back_to_back(self.args.seconds)
            gate.wait()  # everybody is done

        def lead(gate):
            begin, before = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF)
            gate.wait()
            wall_s, after = time.monotonic() - begin, resource.getrusage(resource.RUSAGE_SELF)
            cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            self.reports.append({
                "wall_s": wall_s, "cores": cpu_s / wall_s,
                "voluntary_switches": after.ru_nvcsw - before.ru_nvcsw,
                "networks": [{"name": chain.name, "frames": done[chain.name]}
                             for chain in self.chains]})

        self.run_in_threads(work, lead)

    def run_phases(self, phases):
        begin = time.monotonic()

        def work(chain, gate):
            for _ in phases:
                gate.wait()  # the arrivals are known
                chain.run()
                gate.wait()  # everybody is done

        def lead(gate):
            self.times_s["warm_up"] = time.monotonic() - begin
            for number, (seed, has_bystander) in enumerate(phases):
                if self.args.before_phase:
                    subprocess.run(self.args.before_phase, shell=True, check=True,
                                   env=os.environ | {"PHASE": str(number)})
                self.reports.append(self.run_phase(gate, seed, has_bystander))

        self.run_in_threads(work, lead)

    def run_phase(self, gate, seed, has_bystander):
        bystander = Bystander(self.args.bystander_kind, self.gpu) if has_bystander else None
        if bystander:
            bystander.start_and_wait()
        start_s, warmup_s = time.monotonic() + START_DELAY_S, self.args.warmup
        for chain in self.chains:
            chain.plan(seed, warmup_s + self.args.seconds, start_s)
        gate.wait()
        gate.wait()
        turns = bystander.end() if bystander else 0
        its = [chain.report(start_s + warmup_s, self.args.frames) for chain in self.chains]
        return {"seed": seed, "bystander": has_bystander, "bystander_turns": turns,
                "overall_miss_pct": frames.overall_miss_pct(its), "networks": its}


def print_reports(reports):
    for report in reports:
        print(f"seed {report['seed']}{', bystander' if report['bystander'] else ''}: "
              f"{report['overall_miss_pct']:.1f} % missed (mean over networks)")
        for n in report["networks"]:
            latency = n["latency_ms"]
            p50, p99, most = (f"{latency[key]:>8.2f}" if latency[key] is not None else "       -"
                              for key in ("p50", "p99", "max"))
            print(f"  {n['name']:<15} {n['form']:<8} frames {n['frames']:>5} missed {n['missed']:>5}"
                  f" (skipped {n['skipped']})  D {n['deadline_ms']:>6.1f}  p50 {p50} p99 {p99} "
                  f"max {most} ms")


def parse():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spec", type=pathlib.Path, required=True, help="the networks, as above")
    parser.add_argument("--seconds", type=float, default=10, help="of a phase; of each alone [10]")
    parser.add_argument("--warmup", type=float, default=1,
                        help="seconds before them in each phase, whose frames do not count [1]")
    parser.add_argument("--phases", default="1", help="seeds, with b beside the bystander [1]")
    parser.add_argument("--before-phase", metavar="COMMAND",
                        help="for the shell, before each phase; $PHASE is its number, from 0")
    parser.add_argument("--bystander-kind", choices=BYSTANDERS, default=BYSTANDERS[0])
    parser.add_argument("--alone", action="store_true",
                        help="each network alone, one after the other")
    parser.add_argument("--back-to-back", action="store_true",
                        help="all networks together, each frame after the last, for --seconds")
    parser.add_argument("--only", action="append", metavar="NAME", help="build and run no others")
    parser.add_argument("--empty", action="store_true", help="the smallest input of each network")
    parser.add_argument("--keep-going", action="store_true",
                        help="leave out networks that cannot be built or run, and say so")
    parser.add_argument("--simulated", action="store_true",
                        help="kernels of the simulated GPU instead of networks")
    parser.add_argument("--frames", action="store_true", help="report each frame, too")
    parser.add_argument("--out", type=pathlib.Path, help="write the report to this JSON file")
    args = parser.parse_args()
    try:
        phases = parse_phases(args.phases)
    except ValueError as error:
        parser.error(str(error))
    return args, phases


def main():
    args, phases = parse()
    spec = json.loads(args.spec.read_text())
    wrong = what_is_wrong(spec, args.alone)
    if wrong:
        sys.exit(f"{args.spec.name}: {wrong}")
    if not args.simulated:
        try:
            import torch  # noqa: F401
        except ImportError as error:
            print(f"skipped: {error}")
            sys.exit(SKIPPED)
    program = Program(spec, args)
    if args.alone:
        program.run_alone()
        for n in program.reports:
            print(f"{n['name']:<15} {n['form']:<8} alone p50 {n['latency_ms']['p50']:>8.3f} "
                  f"p99 {n['latency_ms']['p99']:>8.3f} ms, {n['frames']} frames")
    elif args.back_to_back:
        program.run_back_to_back()
    else:
        program.run_phases(phases)
        print_reports(program.reports)
    print("  ".join(f"{name} {seconds:.1f} s" for name, seconds in program.times_s.items()))
    key = "alone" if args.alone else "back_to_back" if args.back_to_back else "phases"
    if args.out:
        content = {**program.software, "seconds": args.seconds, "warmup_s": args.warmup,
                   "empty": args.empty, "broken": program.broken, "times_s": program.times_s,
                   key: program.reports}
        temporary = args.out.with_name(args.out.name + ".part")
        temporary.write_text(json.dumps(content, indent=1) + "\n")
        temporary.replace(args.out)


if __name__ == "__main__":
    main()
