#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How long does the kill switch take, at random moments of a program under load?

The ten chains (tools/chains) run under UrgenGo with --verify; `urgengo ctl off` or `observe` comes
at random moments, to the running program or to one that is stopped and then continued, and `on`
after it. In every second round the program is killed in the middle of it. A switch has taken the
time until the program has said that its holds are over: from the word on, or from SIGCONT on.

  tools/bench/kill_switch.py --build build/release --times 100 --out result.json
  tools/bench/kill_switch.py --build build/release --times 1000 --simulated --out result.json

Exit status 0 if each switch was answered, no hold was left, and all results were right; else 1.
"""
import argparse
import json
import os
import pathlib
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import result_file  # noqa: E402

CHAINS = HERE.parent / "chains/chains.yaml"
ROUND_S, ON_FOR_MS, KILL_EVERY = 15, 60, 2
LONGEST_S = 5
GOAL_MS = 10


class Failed(Exception):
    pass


class Bench:
    def __init__(self, options, folder):
        self.options, self.folder = options, folder
        build = pathlib.Path(options.build).resolve()
        self.urgengo, self.chains = str(build / "bin/urgengo"), str(build / "bin/urgengo-chains")
        self.environment = result_file.without_urgengo(dict(os.environ))
        self.environment["URGENGO_SHARE"] = str(folder)
        self.driver = []
        if options.simulated:
            library = build / "lib/simgpu"
            self.environment["LD_LIBRARY_PATH"] = str(library)
            self.driver = ["--real-libcuda", str(library / "libcuda.so.1")]

    def call(self, command, **more):
        return subprocess.run(command, env=self.environment, cwd=self.folder, text=True,
                              capture_output=True, **more)

    def prepare(self):
        done = self.call([self.chains, "calibrate"])
        if done.returncode != 0:
            raise Failed("calibrate: " + done.stderr.strip())
        (self.folder / "chains.yaml").write_text(CHAINS.read_text())

    def start(self, seed):
        return subprocess.Popen(
            [self.urgengo, "run", "-q", *self.driver, "-c", "chains.yaml", "--", self.chains,
             "run", "--f-a", str(self.options.f_a), "--seconds", str(ROUND_S), "--seed", str(seed),
             "--verify", "--quiet", "--cpu", self.options.cpu],
            env=self.environment, cwd=self.folder, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def ctl(self, word, pid=None):
        command = [self.urgengo, "ctl", word, "--json", "--timeout", str(LONGEST_S)]
        done = self.call(command + (["--pid", str(pid)] if pid else []))
        try:
            return json.loads(done.stdout)["processes"]
        except (ValueError, KeyError):
            return []

    def find(self, pid):
        """@returns the process that runs the chains: urgengo run becomes it"""
        end = time.monotonic() + LONGEST_S
        while time.monotonic() < end:
            if [p for p in self.ctl("status") if p["pid"] == pid and p["listens"]]:
                return
            time.sleep(0.05)
        raise Failed("the program does not show up in `urgengo ctl status`")

    def switch(self, pid, word, is_stopped):
        """@returns ms that it took, and how many holds were left"""
        if not is_stopped:
            process = self.ctl(word, pid)[0]
            if process["result"] != "done":
                raise Failed(f"{word}: {process['result']}")
            return process["took_ms"], process["holds_left"]
        os.kill(pid, signal.SIGSTOP)
        before = self.ctl(word, pid)[0]
        begin = time.monotonic_ns()
        os.kill(pid, signal.SIGCONT)
        end = time.monotonic() + LONGEST_S
        while time.monotonic() < end:
            process = self.ctl("status", pid)[0]
            if process["answered_ns"] > max(begin, before["answered_ns"]):
                return (process["answered_ns"] - begin) / 1e6, process["holds_left"]
        raise Failed(f"{word}: a program that was continued has not answered in {LONGEST_S} s")


def run_round(bench, number, draw, samples):
    program = bench.start(number)
    try:
        bench.find(program.pid)
        time.sleep(0.5)
        kill_at = time.monotonic() + 0.2 * ROUND_S if number % KILL_EVERY == KILL_EVERY - 1 else None
        end = time.monotonic() + ROUND_S - 4
        while time.monotonic() < end and len(samples) < bench.options.times:
            time.sleep(draw.random() * ON_FOR_MS / 1e3)
            word = draw.choice(("off", "off", "off", "observe"))
            if kill_at and time.monotonic() > kill_at:
                sender = subprocess.Popen([bench.urgengo, "ctl", word, "-q"], env=bench.environment,
                                          stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                time.sleep(draw.random() * 0.01)
                program.kill()
                program.communicate()
                sender.wait(timeout=2 * LONGEST_S)
                if bench.ctl("status"):
                    raise Failed("a killed program is still shown")
                return "killed"
            is_stopped = draw.random() < 0.25
            took, left = bench.switch(program.pid, word, is_stopped)
            samples.append({"word": word, "stopped": is_stopped, "ms": round(took, 3),
                            "holds_left": left})
            bench.ctl("on", program.pid)
            print(f"\r{len(samples)} of {bench.options.times}", end="", file=sys.stderr)
        out, err = program.communicate(timeout=4 * ROUND_S)
        if program.returncode != 0:
            raise Failed(f"the program ended with {program.returncode}: {out.strip()} {err.strip()}")
        if "EXIT" in err:
            raise Failed(err.strip())
        return "right"
    finally:
        if program.poll() is None:
            program.kill()
            program.communicate()


def summary(samples):
    if not samples:
        return {}
    times = sorted(sample["ms"] for sample in samples)
    return {"count": len(times), "median_ms": statistics.median(times),
            "p99_ms": times[min(len(times) - 1, int(0.99 * len(times)))], "max_ms": times[-1],
            "within_10_ms": sum(ms <= GOAL_MS for ms in times),
            "holds_left": sum(sample["holds_left"] > 0 for sample in samples)}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", default="build/release")
    parser.add_argument("--times", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--f-a", type=float, default=0.9)
    parser.add_argument("--cpu", default="auto", choices=("auto", "spin", "sleep"))
    parser.add_argument("--simulated", action="store_true", help="on the simulated GPU")
    parser.add_argument("--limit-s", type=float, default=1800, help="no round begins after that")
    parser.add_argument("--commit", default="")
    parser.add_argument("--out", type=pathlib.Path)
    options = parser.parse_args()
    draw = random.Random(options.seed)
    samples, rounds, wrong, begin = [], {"right": 0, "killed": 0}, "", time.monotonic()
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        bench = Bench(options, pathlib.Path(folder))
        try:
            bench.prepare()
            while len(samples) < options.times and time.monotonic() - begin < options.limit_s:
                rounds[run_round(bench, sum(rounds.values()), draw, samples)] += 1
        except (Failed, OSError, subprocess.SubprocessError) as error:
            wrong = str(error)
    print(file=sys.stderr)
    result = {**result_file.where_and_when("kill_switch.py", options.build, options.commit),
              "simulated": options.simulated, "cores": os.cpu_count(), "rounds": rounds,
              "wrong": wrong, "all": summary(samples),
              "running": summary([s for s in samples if not s["stopped"]]),
              "stopped": summary([s for s in samples if s["stopped"]]),
              "running_ms": [s["ms"] for s in samples if not s["stopped"]],
              "stopped_ms": [s["ms"] for s in samples if s["stopped"]]}
    print(json.dumps({key: result[key] for key in ("rounds", "wrong", "all", "running", "stopped")},
                     indent=1))
    if options.out:
        result_file.write(options.out, result)
    return 1 if wrong or any(sample["holds_left"] for sample in samples) else 0


if __name__ == "__main__":
    sys.exit(main())
