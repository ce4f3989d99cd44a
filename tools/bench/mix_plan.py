# SPDX-License-Identifier: Apache-2.0
"""Mixes of networks: which, how often, by when, and what their runs add up to.

A mix is drawn by its seed: its networks' order, their shares of the load, which half is tight. A
period is what makes latency alone / period the network's share of the load; a tight deadline is 0.5
to 0.8 of the period, the others' the period. At another load the same mix has longer periods.
"""
import collections
import copy
import random
import statistics
import typing

TIGHT = (0.5, 0.8)
SHARES = (0.6, 1.4)
LEAST_DEADLINE = 1.5  # latencies alone: a deadline that can be met
NUM_SPARE = 2         # networks drawn beyond those needed: some may not build here
WORSE_POINTS = 0.2    # overall misses, per cent of frames, that count as a difference
TASK = "infer"
TIMES = ("gpu_time_ns", "latency_ns", "busy_ns", "sum_ns")  # of a profile, that are true or false together


class Mix(typing.NamedTuple):
    name: str
    count: int
    forms: tuple
    seed: int
    first: tuple = ()  # networks that are in it, whatever is drawn


MIXES = {mix.name: mix for mix in (
    Mix("A", 7, ("traced",), 11),
    Mix("B", 8, ("eager",), 12),
    Mix("C", 7, ("traced", "eager", "graph", "compiled", "traced", "eager", "graph"), 13,
        ("regnet_y_8gf", "resnext50")),
)}


def parse_mix(text):
    """@returns the mix of that name, or of "7:traced+eager:21" (count, forms, seed)
    @errors ValueError"""
    if text in MIXES:
        return MIXES[text]
    parts = text.split(":")
    if len(parts) != 3 or not parts[0].isdigit() or not parts[2].isdigit():
        raise ValueError(f"mix: found {text}, accepted: {', '.join(MIXES)}, or COUNT:FORM+FORM:SEED")
    return Mix(text, int(parts[0]), tuple(parts[1].split("+")), int(parts[2]))


def kind_of_mix(mix):
    return mix.forms[0] if len(set(mix.forms)) == 1 else "mixed"


def candidates(mix, names):
    """@returns (network, form) in the order in which they are taken, a few more than needed"""
    rest = sorted(set(names) - set(mix.first))
    random.Random(f"networks {mix.seed}").shuffle(rest)
    drawn = [*mix.first, *rest][:mix.count + NUM_SPARE]
    return [(name, mix.forms[i % len(mix.forms)]) for i, name in enumerate(drawn)]


def key(network, form):
    return f"{network}/{form}"


def networks_of(mix, load, names, calibration):
    """@param calibration  "network/form" -> {"latency_ms": ...}; what is not in it does not run here
    @returns the networks of a spec for network_threads.py
    @errors ValueError if too few run here"""
    usable = [one for one in candidates(mix, names) if key(*one) in calibration][:mix.count]
    if len(usable) < mix.count:
        raise ValueError(f"mix {mix.name}: found {len(usable)} networks that run here, accepted: "
                         f"{mix.count}")
    source = random.Random(f"periods {mix.seed}")
    shares = [source.uniform(*SHARES) for _ in usable]
    tight = set(source.sample(range(len(usable)), len(usable) // 2))
    parts = [source.uniform(*TIGHT) for _ in usable]
    its = []
    for i, (network, form) in enumerate(usable):
        latency_ms = calibration[key(network, form)]["latency_ms"]
        period_ms = latency_ms / (load * shares[i] / sum(shares))
        deadline_ms = period_ms * parts[i] if i in tight else period_ms
        deadline_ms = max(deadline_ms, min(period_ms, LEAST_DEADLINE * latency_ms))
        its.append({"name": f"n{i}_{network}"[:15], "network": network, "form": form,
                    "period_ms": round(period_ms, 2), "deadline_ms": round(deadline_ms, 2),
                    "latency_alone_ms": latency_ms, "tight": i in tight})
    return its


def config_text(its, scheduler="", more=""):
    """@returns chains.yaml: each network a chain of its thread's name"""
    lines = ["version: 1", "mode: enforce", "chains:"]
    for one in its:
        lines += [f"  - name: {one['name']}", f"    period_ms: {one['period_ms']}",
                  f"    deadline_ms: {one['deadline_ms']}",
                  f"    tasks: [{{name: {TASK}, thread: \"{one['name']}\"}}]"]
    lines += [f"scheduler: {{{scheduler}}}"] if scheduler else []
    lines += [more] if more else []
    return "\n".join(lines) + "\n"


def wrong_profile(profile, row, seed):
    """@param row  times_4, times_0.25: one chain's times; random_2: all chains', each by its own factor
    from a half to two
    @returns the profile with these times, and the factors by chain"""
    profile, source = copy.deepcopy(profile), random.Random(f"{row} {seed}")
    names = [chain["name"] for chain in profile["chains"]]
    how, factor = row.split("_")
    if how == "times":
        factors = {source.choice(names): float(factor)}
    else:
        factors = {name: float(factor) ** source.uniform(-1, 1) for name in names}

    def scale(part, by):
        for key_, value in part.items() if isinstance(part, dict) else ():
            if key_ in TIMES:
                part[key_] = round(value * by)
        for value in part.values() if isinstance(part, dict) else part:
            if isinstance(value, (dict, list)):
                scale(value, by)

    for chain in profile["chains"]:
        scale(chain, factors.get(chain["name"], 1))
    return profile, {name: round(by, 3) for name, by in factors.items()}


def in_turns(rows, turn):
    """@returns the rows in an order that begins with another one at each turn"""
    turn %= max(1, len(rows))
    return rows[turn:] + rows[:turn]


def cell_of(run):
    return run["mix"], run["load"], run["bystander"]


def cells(runs):
    """@returns by cell and row: misses of each run, their mean, by network the missed of all
    frames"""
    found = collections.defaultdict(lambda: collections.defaultdict(list))
    for run in runs:
        found[cell_of(run)][run["row"]].append(run)
    table = {}
    for cell, rows in found.items():
        table[cell] = {}
        for row, its in rows.items():
            missed, num_frames = collections.Counter(), collections.Counter()
            for run in its:
                for one in run["networks"]:
                    missed[one["name"]] += one["missed"]
                    num_frames[one["name"]] += one["frames"]
            overall = {run["seed"]: run["overall_miss_pct"] for run in its}
            table[cell][row] = {
                "by_seed": overall, "mean": statistics.fmean(overall.values()),
                "networks": {name: [missed[name], num_frames[name]] for name in num_frames}}
    return table


def common_mean(rows, row, other):
    """@returns the means of two rows over seeds that both have; None without any"""
    seeds = sorted(set(rows.get(row, {}).get("by_seed", {})) &
                   set(rows.get(other, {}).get("by_seed", {})))
    if not seeds:
        return None
    return tuple(statistics.fmean(rows[one]["by_seed"][seed] for seed in seeds)
                 for one in (row, other))


def ratio(one, other):
    """@returns one / other; None where that says nothing"""
    return round(one / other, 3) if other > 0 else None


def compare(table, kinds, others=("bare", "priorities")):
    """@param kinds  mix -> traced, eager ... as by kind_of_mix()
    @returns urgengo's misses to the others' in each cell, over all cells of a kind, and where it is
    worse"""
    per_cell, sums, worse = [], collections.defaultdict(list), []
    for cell, rows in sorted(table.items()):
        its = {"mix": cell[0], "load": cell[1], "bystander": cell[2]}
        for other in others:
            both = common_mean(rows, "urgengo", other)
            if both is None:
                continue
            its[f"urgengo/{other}"] = ratio(*both)
            sums[(kinds[cell[0]], other)].append(both)
            if both[0] > both[1] + WORSE_POINTS:
                worse.append({**{k: its[k] for k in ("mix", "load", "bystander")}, "than": other,
                              "urgengo_pct": round(both[0], 2), "other_pct": round(both[1], 2)})
        per_cell.append(its)
    per_kind = {}
    for (kind, other), pairs in sums.items():
        means = [statistics.fmean(pair[i] for pair in pairs) for i in (0, 1)]
        per_kind.setdefault(kind, {})[f"urgengo/{other}"] = {
            "urgengo_pct": round(means[0], 2), "other_pct": round(means[1], 2),
            "ratio": ratio(*means), "cells": len(pairs)}
    return {"cells": per_cell, "kinds": per_kind, "worse": worse}


def answers(runs):
    """@returns of the last frames' bits: of how many networks, how many frames were compared, and by
    row, each value numbered, of those that differ. Not of the row empty, which has other inputs."""
    found = collections.defaultdict(list)
    for run in runs:
        for one in run["networks"] if run["row"] != "empty" else []:
            if one.get("answer_sha256"):
                found[(run["mix"], one["name"])].append((run["row"], one["answer_sha256"]))
    different = []
    for (mix, name), its in sorted(found.items()):
        number = {bits: i for i, bits in enumerate(dict.fromkeys(bits for _, bits in its))}
        if len(number) > 1:
            rows = collections.defaultdict(list)
            for row, bits in its:
                rows[row].append(number[bits])
            different.append({"mix": mix, "network": name, "by_row": dict(rows)})
    return {"networks": len(found), "frames": sum(map(len, found.values())),
            "different": different}


def table_text(table, all_rows):
    lines = []
    for cell, rows in sorted(table.items()):
        lines.append(f"mix {cell[0]}, load {cell[1]}, {'beside a' if cell[2] else 'no'} bystander")
        for row in [one for one in all_rows if one in rows]:
            its = rows[row]
            names = "  ".join(f"{name} {missed}/{total}"
                              for name, (missed, total) in its["networks"].items())
            seeds = " ".join(f"{pct:.1f}" for _, pct in sorted(its["by_seed"].items()))
            lines.append(f"  {row:<11} {its['mean']:>5.1f} %  [{seeds}]  {names}")
    return "\n".join(lines)
