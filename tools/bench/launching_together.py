#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How much networks that share Python's lock get done together, bare and under UrgenGo.

The first of a mix's networks, each in its thread, frames back to back: no arrivals and no
deadlines decide, only how many launches the lock, the cores and UrgenGo let through. `work` is the
networks' time alone over the time that passed: 1 is what one network alone gets done. A program
at the lock's limit misses deadlines by what is missing there, so this is compared before misses are.
(Misses at that limit are a coin's toss: one build had 1 to 91 % in 21 phases of 5 s.)

Rows: bare; priorities (`admission: none`); urgengo, with --scheduler. All rows and counts of a round
run in turns, in processes of their own.

  tools/bench/launching_together.py --build build/release --mix B --counts 1,2,8 --rounds 5
"""
import json
import pathlib
import statistics
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import mix_plan  # noqa: E402
import network_mixes  # noqa: E402
import result_file  # noqa: E402

ROWS = ("bare", "priorities", "urgengo")


def parse():
    parser = network_mixes.parser_of(__doc__)
    parser.add_argument("--mix", default="B", help="one of network_mixes.py's [B]")
    parser.add_argument("--load", type=float, default=0.9, help="that periods are for [0.9]")
    parser.add_argument("--counts", default="1,2,8", help="networks together [1,2,8]")
    parser.add_argument("--rows", default=",".join(ROWS), help=f"of {','.join(ROWS)} [all]")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=2, help="of a run [2]")
    parser.add_argument("--scheduler", default="guard: off", metavar="KEYS",
                        help="of scheduler:, the row urgengo [guard: off]")
    args = parser.parse_args()
    try:
        most = mix_plan.parse_mix(args.mix).count
    except ValueError as error:
        parser.error(str(error))
    words = args.counts.split(",")
    if not all(word.isdigit() and 1 <= int(word) <= most for word in words):
        parser.error(f"--counts: found {args.counts}, accepted: 1 to {most} of mix {args.mix}, "
                     "with commas between them")
    args.counts = [int(word) for word in words]
    if args.rounds < 1:
        parser.error(f"--rounds: found {args.rounds}, accepted: 1 or more")
    args.rows = args.rows.split(",")
    if not set(args.rows) <= set(ROWS):
        parser.error(f"--rows: found {','.join(args.rows)}, accepted: {','.join(ROWS)}")
    return args


def run(experiment, args, row, count):
    """@returns what one process got done"""
    mix, out = experiment.mixes[0], experiment.folder / "together.json"
    its = experiment.its_networks(mix, args.load)[:count]
    out.unlink(missing_ok=True)
    command = experiment.program(experiment.spec(mix, args.load), "--back-to-back", "--seconds",
                                 args.seconds, "--out", out,
                                 *[word for one in its for word in ("--only", one["name"])])
    if row != "bare":
        command = [experiment.urgengo(), "run", "-c", str(experiment.config(mix, args.load, row)),
                   "--profile", str(experiment.profile(mix)), "--", *command]
    experiment.execute(f"{row}, {count} together", command, args.seconds)
    report = json.loads(out.read_text())["back_to_back"][0]
    alone_s = {one["name"]: one["latency_alone_ms"] / 1000 for one in its}
    work_s = sum(one["frames"] * alone_s[one["name"]] for one in report["networks"])
    return report | {"row": row, "count": count, "work": work_s / report["wall_s"]}


def print_table(args, runs):
    print(f"{'together':>8}" + "".join(f"{row:>22}" for row in args.rows))
    for count in args.counts:
        cells = []
        for row in args.rows:
            works = sorted(one["work"] for one in runs
                           if (one["row"], one["count"]) == (row, count))
            cells.append(f"{statistics.median(works):.2f} [{works[0]:.2f}, {works[-1]:.2f}]")
        print(f"{count:>8}" + "".join(f"{cell:>22}" for cell in cells))


def main():
    args = parse()
    try:
        experiment = network_mixes.experiment_of(args, "--priorities",
                                                 "admission: none, guard: off")
        experiment.calibrate()
        experiment.profile(experiment.mixes[0])
        runs = []
        for turn in range(args.rounds):
            rows = mix_plan.in_turns(args.rows, turn)
            runs += [run(experiment, args, row, count) | {"round": turn}
                     for count in args.counts for row in rows]
    except network_mixes.Failed as error:
        sys.exit(str(error))
    print_table(args, runs)
    if args.out:
        result_file.write(args.out, {
            **result_file.where_and_when("tools/bench/launching_together.py", args.build,
                                         args.commit), **experiment.facts,
            "simulated": args.simulated, "scheduler": args.scheduler, "load": args.load,
            "networks": experiment.its_networks(experiment.mixes[0], args.load), "runs": runs})


if __name__ == "__main__":
    main()
