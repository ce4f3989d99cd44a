#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Puts the cells of several results of `urgengo bench smoke` into one table.

For every f_a (and f_d) and row: the median of the runs' overall miss ratios, their range and their
number; and by how much it is less than a named row's. That is 1 - mean / mean over the seeds that
both rows have, with the 95 % interval of a bootstrap that draws seeds (of several runs of a seed,
one) and in each of them seconds, the same ones of both rows, as they have the same arrivals. A run
of other length counts as another seed. Without misses to be less than there is no number (draws
without any are left out), and without frames by second there is no interval.

  tools/bench/summary.py a.json b.json --less-than paper,paam --json summary.json
"""
import argparse
import collections
import functools
import json
import pathlib
import random
import statistics
import sys

DRAWS = 2000
FREE = {"f_a", "f_d", "rows", "repeats", "seed", "seconds", "workload", "merged"}
Run = collections.namedtuple("Run", "seed miss_pct chains")  # chains: (frames, missed) by second


class Refused(Exception):
    """What was found, and what is accepted."""


def conditions(results):
    same = {key: results[key] for key in ("gpu", "driver", "version", "commit", "workload_hash")}
    return same | {k: v for k, v in results["parameters"].items() if k not in FREE}


def read(paths, mixed=False):
    """@returns cells: {(f_a, f_d): {row: [Run]}}, rows in the order found; and the conditions"""
    cells, found, wanted = {}, set(), None
    for path in paths:
        try:
            results = json.loads(pathlib.Path(path).read_text())
            if results["program"] not in ("urgengo bench smoke", "urgengo sim"):
                raise Refused(f"{path}: found results of {results['program']}, "
                              "accepted: of urgengo bench smoke or urgengo sim")
            here = conditions(results)
            wanted = wanted or here
            for key in sorted(set(here) | set(wanted)):
                if here.get(key) != wanted.get(key) and not mixed:
                    raise Refused(f"{path}: {key}: found {here.get(key)}, accepted: "
                                  f"{wanted.get(key)}, as in {paths[0]} (or --mixed)")
            f_d = float(results["parameters"].get("f_d", 1))
            seconds = results["parameters"]["seconds"]
            for run in results["runs"]:
                whole = json.dumps(run, sort_keys=True)
                if whole in found:
                    raise Refused(f"{path}: found {run['row']} at f_a {run['f_a']}, seed "
                                  f"{run['seed']} of another file again, accepted: each run once")
                found.add(whole)
                chains = tuple((tuple(c["frames"]), tuple(c["missed"]))
                               for c in run["blocks_of_chains"])
                rows = cells.setdefault((run["f_a"], f_d), {})
                rows.setdefault(run["row"], []).append(
                    Run((run["seed"], seconds), run["overall_miss_pct"], chains))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise Refused(f"{path}: found no results of urgengo bench smoke ({error!r})") from error
    return dict(sorted(cells.items())), wanted


def miss_pct(chains, seconds):
    """The mean over chains that have a frame in these seconds, which may come several times."""
    ratios = []
    for frames, missed in chains:
        inside = [s for s in seconds if s < len(frames)]
        if number := sum(frames[s] for s in inside):
            ratios.append(sum(missed[s] for s in inside) / number)
    return 100 * sum(ratios) / len(ratios) if ratios else 0


class Cell:
    """All rows at one f_a and f_d."""

    def __init__(self, rows):
        self.rows = rows
        self.by_seed = {row: collections.defaultdict(list) for row in rows}
        self.seconds = collections.defaultdict(int)  # of each seed, the most that a chain has
        self.has_seconds = {row: True for row in rows}
        for row, runs in rows.items():
            for run in runs:
                self.by_seed[row][run.seed].append(run)
                most = max((len(frames) for frames, _ in run.chains), default=0)
                self.seconds[run.seed] = max(self.seconds[run.seed], most)
                self.has_seconds[row] &= most > 0

    @functools.lru_cache(maxsize=None)
    def plan(self, seeds):
        """What each draw takes: seeds, and of each which of its runs (0 to 1) and which seconds."""
        rng = random.Random(1)
        return [[(seed, rng.random(), rng.choices(range(self.seconds[seed]), k=self.seconds[seed]))
                 for seed in rng.choices(seeds, k=len(seeds))] for _ in range(DRAWS)]

    @functools.lru_cache(maxsize=None)
    def draws(self, row, seeds):
        runs = self.by_seed[row]
        return [statistics.fmean(miss_pct(runs[seed][int(which * len(runs[seed]))].chains, seconds)
                                 for seed, which, seconds in draw) for draw in self.plan(seeds)]

    def mean(self, row, seeds):
        return statistics.fmean(statistics.fmean(run.miss_pct for run in self.by_seed[row][seed])
                                for seed in seeds)

    def reduction(self, row, other):
        """@returns value, low, high in per cent, and the number of seeds; None: there is none"""
        seeds = tuple(sorted(set(self.by_seed[row]) & set(self.by_seed.get(other, ()))))
        if row == other or not seeds or self.mean(other, seeds) == 0:
            return None
        less = {"value": 100 * (1 - self.mean(row, seeds) / self.mean(other, seeds)),
                "low": None, "high": None, "seeds": len(seeds)}
        if self.has_seconds[row] and self.has_seconds[other]:
            pairs = zip(self.draws(row, seeds), self.draws(other, seeds))
            drawn = sorted(100 * (1 - a / b) for a, b in pairs if b > 0)
            if drawn:
                less["low"], less["high"] = (drawn[round(q * (len(drawn) - 1))]
                                             for q in (0.025, 0.975))
        return less

    def summary(self, row, others):
        values = [run.miss_pct for run in self.rows[row]]
        return {"row": row, "runs": len(values), "median": statistics.median(values),
                "min": min(values), "max": max(values),
                "less_than": {other: self.reduction(row, other) for other in others}}


def less_text(less):
    if less is None:
        return ""
    text = f"{less['value']:.1f} %"
    return text if less["low"] is None else text + f" ({less['low']:.1f}..{less['high']:.1f})"


def table(summaries, others):
    lines = []
    for (f_a, f_d), rows in summaries.items():
        head = [f"f_a {f_a:g}, f_d {f_d:g}", "miss %", "range", "runs"]
        cells = [head + [f"less than {other}" for other in others]]
        for row in rows:
            cells.append([row["row"], f"{row['median']:.1f}", f"{row['min']:.1f}..{row['max']:.1f}",
                          str(row["runs"])] + [less_text(row["less_than"][o]) for o in others])
        widths = [max(map(len, column)) for column in zip(*cells)]
        for line in cells:
            lines.append("  ".join(text.ljust(width) if i == 0 else text.rjust(width)
                                   for i, (text, width) in enumerate(zip(line, widths))).rstrip())
        lines.append("")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+")
    parser.add_argument("--less-than", default="paper,paam", help="rows to compare with")
    parser.add_argument("--mixed", action="store_true",
                        help="take files of different versions, GPUs or parameters")
    parser.add_argument("--json", metavar="OUT", help="write it there, too")
    options = parser.parse_args()
    try:
        cells, same = read(options.files, options.mixed)
    except Refused as error:
        sys.exit(f"summary.py: {error}")
    found = {row for rows in cells.values() for row in rows}
    others = [row for row in options.less_than.split(",") if row in found]
    summaries = {level: [cell.summary(row, others) for row in rows]
                 for level, rows in cells.items() for cell in [Cell(rows)]}
    print(table(summaries, others), end="")
    if options.json:
        document = {"format_version": 1, "program": "tools/bench/summary.py", "draws": DRAWS,
                    "files": [pathlib.Path(file).name for file in options.files],
                    "conditions": "mixed" if options.mixed else same,
                    "cells": [{"f_a": f_a, "f_d": f_d, "rows": rows}
                              for (f_a, f_d), rows in summaries.items()]}
        pathlib.Path(options.json).write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
