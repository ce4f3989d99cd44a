# SPDX-License-Identifier: Apache-2.0
"""What program_cost.py makes of its blocks: medians, ratios to native with intervals, and a table.

A block is what a process measured in one go: {metric: [per inference]}.
"""
import pathlib
import random
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests/gpu"))
import equality  # noqa: E402

GOALS = {"latency_us": 1.005, "p99_us": None, "thread_cpu_us": 1.02, "process_cpu_us": 1.02}
NATIVE_ROWS = ("native", "native_again")
JUDGED_ROWS = ("chain", "profiled")
NOBODY, CHAIN = "nobody", equality.CHAIN_THREAD
DIRECT = "direct"  # past UrgenGo, in the thread of the other kind
RESAMPLES = 2000


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
    """@returns the chain's inferences to the bystander's, and each to the native processes'; or one of
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
