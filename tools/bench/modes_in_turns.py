#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What a mix of networks misses in each of UrgenGo's modes, in turns within one process.

Two processes differ by how a machine is just then, by as much as rows of network_mixes.py do. Here
`urgengo ctl` switches the mode of one process before each phase: off (calls pass through), observe
(frames are counted), shadow (launches are decided on and marked, and go as the program made them),
on (as configured). So `observe` - `off` is what counting costs, `shadow` - `observe` what marks and
decisions cost, and `on` - `shadow` what priorities and holds are good for.

A cycle has each mode once, in another order than the last one, with the same arrivals. Printed are
the mean over cycles, and of each mode less the first: the mean, the least and the most of a cycle.

  tools/bench/modes_in_turns.py --build build/release --mix A --load 2.16 --cycles 4
  tools/bench/modes_in_turns.py --mix A --load 2.16 --scheduler "admission: none, guard: off"
"""
import json
import pathlib
import shlex
import statistics
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import mix_plan  # noqa: E402
import network_mixes  # noqa: E402
import result_file  # noqa: E402

MODES = ("off", "observe", "shadow", "on")


def parse():
    parser = network_mixes.parser_of(__doc__)
    parser.add_argument("--mix", default="A", help="one of network_mixes.py's [A]")
    parser.add_argument("--load", type=float, default=0.9, help="[0.9]")
    parser.add_argument("--modes", default=",".join(MODES), help=f"of {','.join(MODES)} [all]")
    parser.add_argument("--cycles", type=int, default=4, help="[4]")
    parser.add_argument("--seed", type=int, default=1, help="of the first cycle's arrivals [1]")
    parser.add_argument("--seconds", type=float, default=5, help="of a phase that count [5]")
    parser.add_argument("--warmup", type=float, default=1, help="of a phase before them [1]")
    parser.add_argument("--bystander", action="store_true", help="all of it beside one")
    parser.add_argument("--scheduler", default="guard: off", metavar="KEYS",
                        help="of scheduler: [guard: off]")
    args = parser.parse_args()
    args.modes = args.modes.split(",")
    if len(set(args.modes)) != len(args.modes) or not set(args.modes) <= set(MODES):
        parser.error(f"--modes: found {','.join(args.modes)}, accepted: {','.join(MODES)}, each once")
    if args.cycles < 1:
        parser.error(f"--cycles: found {args.cycles}, accepted: 1 or more")
    try:
        mix_plan.parse_mix(args.mix)
    except ValueError as error:
        parser.error(str(error))
    return args


def plan(modes, cycles, seed):
    """@returns (cycle, mode, seed) of each phase"""
    return [(cycle, mode, seed + cycle) for cycle in range(cycles)
            for mode in mix_plan.in_turns(modes, cycle)]


def differences(runs, mode, base):
    """@returns by how much the mode missed more than the base, per cent, in each cycle"""
    of = {(run["cycle"], run["mode"]): run["overall_miss_pct"] for run in runs}
    return [missed - of[cycle, base] for (cycle, its), missed in of.items() if its == mode]


def run(experiment, args):
    """@returns what each phase gave"""
    mix, phases = experiment.mixes[0], plan(args.modes, args.cycles, args.seed)
    out, stats = experiment.folder / "in_turns.json", experiment.folder / "in_turns_stats.json"
    out.unlink(missing_ok=True)
    switch = f"set -- {' '.join(mode for _, mode, _ in phases)}; shift $PHASE; " \
        f"exec {shlex.quote(experiment.urgengo())} ctl $1 --quiet --pid $PPID"
    command = [experiment.urgengo(), "run", "-c",
               str(experiment.config(mix, args.load, "urgengo")), "--profile",
               str(experiment.profile(mix)), "--stats", str(stats), "--",
               *experiment.program(experiment.spec(mix, args.load), "--out", out, "--seconds",
                                   args.seconds, "--warmup", args.warmup, "--before-phase", switch,
                                   "--phases", ",".join(f"{seed}{'b' * args.bystander}"
                                                        for _, _, seed in phases))]
    experiment.execute(f"{len(phases)} phases", command,
                       len(phases) * (args.seconds + args.warmup + 1))
    reports = json.loads(out.read_text())["phases"]
    return [{"cycle": cycle, "mode": mode, **report}
            for (cycle, mode, _), report in zip(phases, reports)], json.loads(stats.read_text())


def print_table(args, runs):
    base = args.modes[0]
    print(f"{'mode':<8} {'missed':>8}   less {base}, mean [least, most] of a cycle")
    for mode in args.modes:
        missed = statistics.fmean(one["overall_miss_pct"] for one in runs if one["mode"] == mode)
        more = differences(runs, mode, base)
        text = f"{statistics.fmean(more):+.1f} [{min(more):+.1f}, {max(more):+.1f}]"
        print(f"{mode:<8} {missed:>6.1f} %   {text if mode != base else ''}")


def main():
    args = parse()
    experiment = network_mixes.experiment_of(args)
    try:
        experiment.calibrate()
        runs, scheduler = run(experiment, args)
    except network_mixes.Failed as error:
        sys.exit(str(error))
    print_table(args, runs)
    if args.out:
        result_file.write(args.out, {
            **result_file.where_and_when("tools/bench/modes_in_turns.py", args.build, args.commit),
            **experiment.facts, "simulated": args.simulated, "scheduler": args.scheduler,
            "load": args.load, "mix": args.mix, "bystander": args.bystander,
            "seconds": args.seconds, "warmup_s": args.warmup,
            "networks": experiment.its_networks(experiment.mixes[0], args.load), "runs": runs,
            "scheduler_stats": scheduler})


if __name__ == "__main__":
    main()
