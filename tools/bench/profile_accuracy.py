#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Is what `urgengo profile` says true? Busy time of networks beside CUPTI's, by a script of its own.

  programs/kernel_truth.py: latency without any tool, then CUPTI's records of the kernels
  urgengo profile --source cupti, and --source marks, of network_threads.py --alone

Each network in one form, unless --forms names those of all: eager, traced, compiled and graph in
turns. The true busy time of an inference is the union of its kernels' intervals. From a graph's first
kernel to its last CUPTI makes it longer than it is without a tool, so that is reported, and no
truth. A GPU-bound network's busy time is also compared with its latency: it is GPU-bound if the union
is within the same 5 % of that.

Goals, in per cent: cupti 5, and of GPU-bound ones 5 of the latency; marks 10 on one stream, on
several 25, or refused: no kernels in the profile, or the command says so.

  tools/bench/profile_accuracy.py --build build/release --part 1/3 --out a1.json

Exit status 0 if all are within their goals, 1 if not, 77 without PyTorch or a GPU.
"""
import argparse
import contextlib
import io
import json
import os
import pathlib
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

SKIPPED = 77
SOURCES = ("cupti", "marks", "auto", "default")
GOALS = {"cupti": 5, "auto": 5, "default": 5, "marks": 10}
FORKED_GOAL_OF_MARKS = 25
GOAL_TO_LATENCY = 5
GPU_BOUND = 1 - GOAL_TO_LATENCY / 100  # busy / latency from which on a network is GPU-bound
PERIOD = 1.5           # latencies alone, and 2 ms: frames do not meet
TIMEOUT_S = 280
# In which form a network is that was asked for; the others take turns.
FORM_OF = {"regnet_y_8gf": "traced", "resnext50": "eager", "effnet_b0": "graph",
           "resnet50": "compiled"}


def assigned(names, forms):
    """@returns (network, form), each network in one form; in all of `forms` if any are given"""
    if forms:
        return [(name, form) for name in names for form in forms]
    return [(name, FORM_OF.get(name, networks.FORMS[i % len(networks.FORMS)]))
            for i, name in enumerate(names)]


def part_of(its, part):
    """@param part  "2/3" @returns every third one, from the second on @errors ValueError"""
    number, _, count = part.partition("/")
    if not number.isdigit() or not count.isdigit() or not 1 <= int(number) <= int(count):
        raise ValueError(f"--part: found {part}, accepted: 1/3, 2/3, 3/3")
    return its[int(number) - 1::int(count)]


def of_profile(profile):
    """@returns chain -> what its only task's profile says, kernels added up"""
    found = {}
    for chain in profile.get("chains", []):
        for task in chain["tasks"]:
            its = {key: value for key, value in task.items()
                   if not isinstance(value, (list, dict))}
            its["num_kernels"] = len(task["kernels"])
            its["sum_of_kernels_ms"] = sum(k["gpu_time_ns"] for k in task["kernels"]) / 1e6
            its["busy_ms"] = its["busy_ns"] / 1e6 if "busy_ns" in its else its["sum_of_kernels_ms"]
            its["latency_ms"] = sum(s.get("latency_ns", 0) for s in task.get("segments", [])) / 1e6
            found[chain["name"]] = its
    return found


def error_pct(found, true):
    return round(100 * (found / true - 1), 2)


def judge(truth, its, source):
    """@param its  of_profile() of the chain, None if it has none
    @returns errors in per cent, and the verdict: within, refused, or what is beyond its goal"""
    forked = truth["streams"] > 1
    if its is None or its["num_kernels"] == 0:
        refused = source == "marks" and forked
        return {"verdict": "refused" if refused else "not learned"}
    goal = FORKED_GOAL_OF_MARKS if source == "marks" and forked else GOALS[source]
    found = {"busy_ms": round(its["busy_ms"], 4), "error_pct": error_pct(its["busy_ms"], truth["busy_ms"]),
             "goal_pct": goal}
    beyond = [] if abs(found["error_pct"]) <= goal else ["busy"]
    if truth["busy_ms"] >= GPU_BOUND * truth["latency_ms"]:
        found["of_latency_pct"] = error_pct(its["busy_ms"], truth["latency_ms"])
        if source != "marks" and abs(found["of_latency_pct"]) > GOAL_TO_LATENCY:
            beyond.append("latency")
    found["verdict"] = ", ".join(beyond) or "within"
    return found


def simulated_truth(specs):
    """@returns what kernel_truth.py would, of kernels of the simulated GPU, from what they are"""
    from simulated_network import kernels_of

    found = {}
    for one in specs:
        count, us = kernels_of(one)
        busy_ms = count * us / 1000
        found[one["name"]] = {"latency_ms": busy_ms + 0.1, "busy_ms": busy_ms, "sum_ms": busy_ms,
                              "span_ms": busy_ms, "streams": 1, "kernels": count}
    return {"networks": found, "broken": {}, "gpu": "simulated"}


class Accuracy:
    def __init__(self, args, folder):
        self.args, self.folder, self.rows, self.broken, self.software = args, folder, [], {}, {}
        self.printed = {}

    def execute(self, command):
        """@returns the exit status, and the end of what was printed"""
        environment = result_file.without_urgengo(os.environ)
        environment |= {"TORCHINDUCTOR_CACHE_DIR": str(self.folder / "inductor"),
                        "TRITON_CACHE_DIR": str(self.folder / "triton")}
        begin = time.monotonic()
        with tempfile.TemporaryFile("w+") as output:
            try:
                code = subprocess.run(command, env=environment, stdout=output,
                                      stderr=subprocess.STDOUT, timeout=TIMEOUT_S).returncode
            except subprocess.TimeoutExpired:
                code = -1
            output.seek(0)
            text = output.read()[-12000:]
        print(f"  {pathlib.Path(command[1]).name}: {time.monotonic() - begin:.1f} s, "
              f"exit status {code}", file=sys.stderr, flush=True)
        if code == SKIPPED:
            print(text)
            sys.exit(SKIPPED)
        return code, text

    def truth(self, spec):
        if self.args.simulated:
            return simulated_truth(json.loads(spec.read_text())["networks"])
        out = self.folder / "truth.json"
        out.unlink(missing_ok=True)
        code, text = self.execute([sys.executable, str(HERE / "programs/kernel_truth.py"), "--spec",
                                   str(spec), "--out", str(out)])
        if code != 0:
            sys.exit(f"kernel_truth.py: exit status {code}\n{text}")
        return json.loads(out.read_text())

    def profile(self, source, spec, its, number):
        """@returns of_profile(), and what the command printed"""
        config, out = self.folder / "chains.yaml", self.folder / "profile.json"
        out.unlink(missing_ok=True)
        config.write_text(mix_plan.config_text(its))
        options = [] if source == "default" else ["--source", source]
        code, text = self.execute(
            [str((self.args.build / "bin/urgengo").resolve()), "profile", "-c", str(config), "-o",
             str(out), *options, "--", sys.executable, str(HERE / "programs/network_threads.py"),
             "--spec", str(spec), "--alone", "--seconds", str(self.args.seconds), "--keep-going",
             *["--simulated"] * self.args.simulated])
        self.printed[f"{source} {number}"] = text[-5000:]
        if code != 0 or not out.exists():
            print(text[-3000:], file=sys.stderr)
            return {}
        return of_profile(json.loads(out.read_text()))

    def group(self, number, its):
        """Measures networks of one form, in one process for each way."""
        spec = self.folder / "spec.json"
        specs = [{"name": f"p{i}_{network}"[:15], "network": network, "form": form,
                  "batch": self.args.batch} for i, (network, form) in enumerate(its)]
        result_file.write(spec, {"networks": specs})
        truth = self.truth(spec)
        self.software = {key: value for key, value in truth.items() if isinstance(value, str)}
        self.broken |= {f"{one['network']}/{one['form']}": truth["broken"][one["name"]]
                        for one in specs if one["name"] in truth["broken"]}
        specs = [one for one in specs if one["name"] in truth["networks"]]
        if not specs:
            return
        for one in specs:
            one["period_ms"] = round(PERIOD * truth["networks"][one["name"]]["latency_ms"] + 2, 2)
            one["deadline_ms"] = one["period_ms"]
        result_file.write(spec, {"networks": specs})
        found = {source: self.profile(source, spec, specs, number)
                 for source in self.args.sources}
        for one in specs:
            its = truth["networks"][one["name"]]
            self.rows.append({"network": one["network"], "form": one["form"], "truth": its,
                              "profiles": {source: found[source].get(one["name"])
                                           for source in found},
                              "errors": {source: judge(its, found[source].get(one["name"]), source)
                                         for source in found}})

    def report(self):
        """Prints the table. @returns what is beyond its goal"""
        beyond = []
        print(f"{'network':<15} {'form':<9} {'streams':>7} {'latency':>9} {'busy':>9} {'sum':>9}" +
              "".join(f"  {source:>9} {'error %':>8} {'of lat.':>8} {'':<12}"
                      for source in self.args.sources))
        for row in sorted(self.rows, key=lambda row: (row["form"], row["network"])):
            t = row["truth"]
            line = (f"{row['network']:<15} {row['form']:<9} {t['streams']:>7} "
                    f"{t['latency_ms']:>9.3f} {t['busy_ms']:>9.3f} {t['sum_ms']:>9.3f}")
            for source, e in row["errors"].items():
                line += (f"  {e.get('busy_ms', '-'):>9} {e.get('error_pct', '-'):>8} "
                         f"{e.get('of_latency_pct', '-'):>8} {e['verdict']:<12}")
                if e["verdict"] not in ("within", "refused"):
                    beyond.append(f"{row['network']} {row['form']} {source}: {e['verdict']}")
            print(line)
        for name, why in self.broken.items():
            print(f"{name}: left out: {why}")
        for source in self.args.sources:
            verdicts = [row["errors"][source]["verdict"] for row in self.rows]
            bound = [row for row in self.rows if "of_latency_pct" in row["errors"][source]]
            print(f"{source}: {sum(v in ('within', 'refused') for v in verdicts)} of "
                  f"{len(verdicts)} within; {len(bound)} GPU-bound")
        if self.args.out:
            result_file.write(self.args.out, {
                **result_file.where_and_when("tools/bench/profile_accuracy.py", self.args.build,
                                             self.args.commit), **self.software,
                "goals_pct": {**GOALS, "marks_forked": FORKED_GOAL_OF_MARKS,
                              "gpu_bound_of_latency": GOAL_TO_LATENCY},
                "networks": self.rows, "broken": self.broken, "beyond": beyond,
                "printed": self.printed})
        return beyond


def parse():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=pathlib.Path("build/release"),
                        help="folder with bin/urgengo and lib/urgengo [build/release]")
    parser.add_argument("--networks", default="", help="names, comma between [all]")
    parser.add_argument("--forms", default="", help="all networks in each of these [each in one]")
    parser.add_argument("--batch", type=int, default=0, help="of every network [each its own]")
    parser.add_argument("--sources", default="cupti,marks", help=f"of {','.join(SOURCES)} "
                        "[cupti,marks]; default: without the option")
    parser.add_argument("--part", default="1/1", help="which of how many parts [1/1]")
    parser.add_argument("--per-process", type=int, default=8, help="networks in a process [8]")
    parser.add_argument("--seconds", type=float, default=1, help="each is profiled for [1]")
    parser.add_argument("--plan", action="store_true", help="say what would run, and run nothing")
    parser.add_argument("--simulated", action="store_true",
                        help="kernels of the simulated GPU instead of networks, to try this program")
    parser.add_argument("--folder", type=pathlib.Path, help="keep specs and caches here")
    parser.add_argument("--out", type=pathlib.Path, help="write all numbers to this JSON file")
    parser.add_argument("--commit", default="", help="that was built, for the JSON file")
    args = parser.parse_args()
    names = args.networks.split(",") if args.networks else list(networks.KINDS)
    forms = args.forms.split(",") if args.forms else []
    args.sources = args.sources.split(",")
    try:
        for wrong in [networks.known(name, form) for name in names for form in forms or ("eager",)]:
            if wrong:
                raise ValueError(wrong)
        if not set(args.sources) <= set(SOURCES):
            raise ValueError(f"--sources: found {','.join(args.sources)}, accepted: "
                             f"{','.join(SOURCES)}")
        return args, part_of(assigned(names, forms), args.part)
    except ValueError as error:
        parser.error(str(error))


def groups_of(its, most):
    """@returns lists of networks of one form, so many at most"""
    groups = []
    for form in networks.FORMS:
        same = [one for one in its if one[1] == form]
        groups += [same[i:i + most] for i in range(0, len(same), most)]
    return groups


def main():
    args, its = parse()
    groups = groups_of(its, args.per_process)
    if args.plan:
        for group in groups:
            print(", ".join(f"{network}/{form}" for network, form in group))
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or pathlib.Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        accuracy = Accuracy(args, folder.resolve())
        for number, group in enumerate(groups, 1):
            print(f"group {number} of {len(groups)}: {len(group)} networks", file=sys.stderr,
                  flush=True)
            accuracy.group(number, group)
            # What is cut off has lost its last group, no more.
            with contextlib.redirect_stdout(io.StringIO()):
                accuracy.report()
        beyond = accuracy.report()
    if beyond and not args.simulated:  # which is to try the program, not to measure
        sys.exit("beyond their goals:\n  " + "\n  ".join(beyond))


if __name__ == "__main__":
    main()
