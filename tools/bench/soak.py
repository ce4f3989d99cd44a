#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Do the ten chains go on when another thread makes each call that might wait for UrgenGo's own work?

The ten chains (tools/chains) run in parts, quiet and disturbed in turn: in the disturbed ones a
thread of the same process allocates and frees memory, loads modules, uploads graphs, launches
cooperatively and synchronises the context, at random (urgengo-chains run --disturb). From outside
`urgengo top` is asked whether the program gets on; one that does not is killed, and told is which
call is under way. Every second disturbed part is without cooperative launches: after the first one
no leased dispatcher is resident any more.

  tools/bench/soak.py --build build/release --dispatch armed --out soak.json        # 8 minutes
  tools/bench/soak.py --build build/release --dispatch armed --parts 4 --part-seconds 20
  tools/bench/soak.py --simulated --parts 2 --part-seconds 3 --no-goals

Exit status 0 if nothing hung, no gate opened late, all results were right, and the disturbed parts
missed at most 1.3 times what the quiet ones did (--no-goals: whatever they missed); else 1.
"""
import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import dispatch_ways  # noqa: E402
import result_file  # noqa: E402
from kill_switch import CHAINS, Bench, Failed  # noqa: E402

DISPATCH = {"bare": None, "auto": "auto", **dispatch_ways.DISPATCH}
PROFILE_SECONDS, START_UP_S = 6, 60
LOOK_EVERY_S = 2.0
GOAL_MISSES = 1.3
# Later than its bound a gate opens where the thread that sees to it has to wait for a core.
MOST_PAST_US = 5000
# Misses are counted in the noise of one frame in a hundred.
NOISE = 0.01


def scaled(text, f_a, dispatch):
    """@returns the config for that factor on arrival rates, which divides periods, so dispatched"""
    lines = []
    for line in text.splitlines():
        key, colon, value = line.partition("period_ms:")
        lines.append(f"{key}{colon} {float(value) / f_a:.6f}" if colon and
                     not key.strip(" -") else line)
    if dispatch:
        lines.append(f"scheduler: {{dispatch: {{where: {dispatch}}}}}")
    return "\n".join(lines) + "\n"


def parts(number):
    """@returns names of parts in turn, each with what its disturber leaves out; None: none"""
    rounds = (("quiet", None), ("disturbed", ""), ("quiet", None), ("disturbed", "cooperative"))
    return [rounds[i % len(rounds)] for i in range(number)]


def under_way(path):
    """@returns the disturber's call that has not returned, and since when; or ''"""
    try:
        line = path.read_text()
    except OSError:
        return ""
    name, since = line[:40].strip(), line[40:].strip()
    if not since or name in ("", "-"):
        return ""
    return f"{name}, for {time.monotonic() - float(since):.1f} s"


class Soak(Bench):
    def __init__(self, options, folder):
        super().__init__(options, folder)
        self.of_workload = ["--f-a", str(options.f_a), "--cpu", options.cpu]

    def must(self, what, command):
        done = self.call(command, timeout=START_UP_S + 4 * self.options.part_seconds)
        if done.returncode != 0:
            raise Failed(f"{what}: exit status {done.returncode}: {done.stderr.strip()}")

    def prepare(self):
        scale = ["--gpu-scale", str(self.options.gpu_scale)]
        self.must("calibrate", [self.chains, "calibrate", *scale])
        if self.options.dispatch == "bare":
            return
        config = self.folder / "chains.yaml"
        config.write_text(scaled(CHAINS.read_text(), self.options.f_a, None))
        seconds = str(min(PROFILE_SECONDS, 2 * self.options.part_seconds))
        self.must("profile", [self.urgengo, "profile", *self.driver, "-c", "chains.yaml", "-o",
                              "profile.json", "--", self.chains, "run", *self.of_workload,
                              "--seconds", seconds, "--quiet"])
        config.write_text(scaled(CHAINS.read_text(), self.options.f_a,
                                 DISPATCH[self.options.dispatch]))

    def start(self, number, without):
        (self.folder / "state").unlink(missing_ok=True)
        command = [self.chains, "run", *self.of_workload, "--seconds",
                   str(self.options.part_seconds), "--seed", str(self.options.seed + number // 2),
                   "--verify", "--quiet", "--json", "report.json"]
        if without is not None:
            command += ["--disturb", str(self.options.seed + number), "--disturb-state", "state"]
            command += ["--disturb-without", without] if without else []
        if self.options.dispatch != "bare":
            command = [self.urgengo, "run", "-q", *self.driver, "-c", "chains.yaml", "--profile",
                       "profile.json", "--stats", "stats.json", "--", *command]
        return subprocess.Popen(command, env=self.environment, cwd=self.folder, text=True,
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def frames_of(self, pid):
        """@returns how many frames the program has ended, as seen from outside; None: unknown"""
        try:
            done = self.call([self.urgengo, "top", "--once", "--json", "--pid", str(pid)],
                             timeout=START_UP_S)
            processes = json.loads(done.stdout)["processes"]
            return sum(chain["frames"] for chain in processes[0]["chains"])
        except (ValueError, KeyError, IndexError, subprocess.TimeoutExpired):
            return None

    def watch(self, program):
        """Kills what ends no frame, or does not end at all. @returns how, or ''"""
        begin = last = time.monotonic()
        known = None
        while program.poll() is None:
            try:
                program.wait(timeout=LOOK_EVERY_S)
                break
            except subprocess.TimeoutExpired:
                pass
            now, frames = time.monotonic(), None
            if self.options.dispatch != "bare":
                frames = self.frames_of(program.pid)
            # The time it takes to start counts, too; to look at a page that is gone does not.
            if frames is not None and frames != known:
                known, last = frames, now
            is_stuck = (self.options.dispatch != "bare" and known is not None and
                        now - last > self.options.hang_seconds)
            too_long = now - begin > START_UP_S + 2 * self.options.part_seconds
            if is_stuck or too_long:
                call = under_way(self.folder / "state") or "no call of the disturber"
                program.kill()
                program.communicate()
                return f"hung after {now - begin:.0f} s, {known} frames: under way was {call}"
        return ""

    def run_part(self, number, name, without):
        for file in ("report.json", "stats.json"):
            (self.folder / file).unlink(missing_ok=True)
        program = self.start(number, without)
        try:
            hung = self.watch(program)
            if hung:
                raise Failed(f"part {number} ({name}): {hung}")
            out, err = program.communicate()
        finally:
            if program.poll() is None:
                program.kill()
                program.communicate()
        if program.returncode != 0 or "EXIT" in err:
            raise Failed(f"part {number} ({name}): exit status {program.returncode}: "
                         f"{out.strip()[-300:]} {err.strip()[-1000:]}")
        report = json.loads((self.folder / "report.json").read_text())
        stats = self.folder / "stats.json"
        known = json.loads(stats.read_text()) if stats.exists() else {}
        return {"part": name, "without": without, "misses": report["overall_miss_ratio"],
                "instances": sum(chain["instances"] for chain in report["chains"]),
                "missed": {chain["name"]: chain["missed"] for chain in report["chains"]},
                "results": report["results"], "cpu_cores": report["cpu_cores"],
                "gates": known.get("gates"), "tripped": known.get("tripped", ""),
                "holds": sum(chain["holds"] for chain in known.get("chains", [])),
                "calls": report.get("disturber", [])}


def mean(values):
    return sum(values) / len(values) if values else 0.0


def summary(found):
    quiet = mean([part["misses"] for part in found if part["part"] == "quiet"])
    disturbed = mean([part["misses"] for part in found if part["part"] == "disturbed"])
    worst = {}
    for part in found:
        for call in part["calls"]:
            its = worst.setdefault(call["call"], {"count": 0, "p50_us": [], "p99_us": 0,
                                                  "max_us": 0})
            its["count"] += call["count"]
            its["p50_us"].append(call["p50_us"])
            its["p99_us"] = max(its["p99_us"], call["p99_us"])
            its["max_us"] = max(its["max_us"], call["max_us"])
    for its in worst.values():
        its["p50_us"] = round(mean(its["p50_us"]), 1)
    gates = [part["gates"] for part in found if part["gates"]]
    return {"quiet_misses": quiet, "disturbed_misses": disturbed,
            "ratio": disturbed / quiet if quiet > 0 else None,
            "gates": sum(its["closed"] for its in gates),
            "parks": sum(its["parks"] for its in gates),
            "most_park_us": max((its["most_park_us"] for its in gates), default=0),
            "past_bound": sum(its["past_bound"] for its in gates),
            "most_past_us": max((its["most_past_us"] for its in gates), default=0),
            "calls": worst}


def what_is_wrong(found, total, with_goals):
    wrong = [f"part {i}: UrgenGo gave up: {part['tripped']}"
             for i, part in enumerate(found) if part["tripped"]]
    wrong += [f"part {i}: results {part['results']}" for i, part in enumerate(found)
              if part["results"] == "BAD"]
    if total["most_past_us"] > MOST_PAST_US and with_goals:
        wrong.append(f"{total['past_bound']} gates opened past their bound, by "
                     f"{total['most_past_us']:.0f} us at most")
    if with_goals and total["disturbed_misses"] > GOAL_MISSES * total["quiet_misses"] + NOISE:
        wrong.append(f"misses {100 * total['disturbed_misses']:.1f} % disturbed, "
                     f"{100 * total['quiet_misses']:.1f} % quiet")
    return wrong


def tell(number, part):
    gates = part["gates"] or {}
    calls = sum(call["count"] for call in part["calls"])
    print(f"{number:3} {part['part']:10} misses {100 * part['misses']:6.2f} %  frames "
          f"{part['instances']:6}  holds {part['holds']:7}  gates {gates.get('closed', 0):7}  parks "
          f"{gates.get('parks', 0):5} of {gates.get('park_us', 0):5.1f} us  past bound "
          f"{gates.get('past_bound', 0):3}  calls {calls:6}"
          f"{'  no cooperative launches' if part['without'] else ''}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", default="build/release")
    parser.add_argument("--dispatch", default="armed", choices=DISPATCH)
    parser.add_argument("--parts", type=int, default=8, help="quiet and disturbed in turn [8]")
    parser.add_argument("--part-seconds", type=float, default=56, help="of frames [56]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--f-a", type=float, default=0.9)
    parser.add_argument("--gpu-scale", type=float, default=1.0, help="factor on kernels' times [1]")
    parser.add_argument("--cpu", default="auto", choices=("auto", "spin", "sleep"))
    parser.add_argument("--hang-seconds", type=float, default=15,
                        help="without a frame's end, and the program hangs [15]")
    parser.add_argument("--limit-s", type=float, default=1800, help="no part begins after that")
    parser.add_argument("--no-goals", action="store_true", help="whatever is missed or late")
    parser.add_argument("--simulated", action="store_true", help="on the simulated GPU")
    parser.add_argument("--commit", default="")
    parser.add_argument("--out", type=pathlib.Path)
    options = parser.parse_args()
    found, wrong, begin = [], [], time.monotonic()
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        soak = Soak(options, pathlib.Path(folder))
        try:
            soak.prepare()
            for number, (name, without) in enumerate(parts(options.parts)):
                if time.monotonic() - begin > options.limit_s:
                    break
                found.append(soak.run_part(number, name, without))
                tell(number, found[-1])
        except (Failed, OSError, subprocess.SubprocessError) as error:
            wrong.append(str(error))
    total = summary(found)
    wrong += what_is_wrong(found, total, not options.no_goals)
    for name, call in sorted(total["calls"].items()):
        print(f"{name:28} {call['count']:6} times, us: p50 {call['p50_us']:8.0f}, p99 "
              f"{call['p99_us']:8.0f}, max {call['max_us']:8.0f}")
    print(json.dumps({key: total[key] for key in total if key != "calls"}))
    for line in wrong:
        print(f"FAILURE: {line}")
    if options.out:
        result_file.write(options.out, {
            **result_file.where_and_when("soak.py", options.build, options.commit),
            "simulated": options.simulated, "cores": os.cpu_count(), "dispatch": options.dispatch,
            "f_a": options.f_a, "part_seconds": options.part_seconds, "wrong": wrong,
            "summary": total, "parts": found})
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
