#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the tables of results into the pages that show them.

A table stands in a page between `<!-- table NAME -->` and `<!-- end -->`. It is made of the files in
tools/bench/results alone: a figure there is never typed. Add a table: a function below with
@table, named as the marker.

  tools/bench/tables.py            # writes docs/measurements.md and README.md anew, whole or not at all
  tools/bench/tables.py --check    # exit status 1, and what differs, if a table is not current
"""
import argparse
import collections
import difflib
import functools
import json
import pathlib
import re
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from table_text import listed, microseconds, percent, text_of  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parents[2]
RESULTS = ROOT / "tools/bench/results"
PAGES = ("docs/measurements.md", "README.md")
BLOCK = re.compile(r"(<!-- table ([\w-]+) -->\n)(.*?)(<!-- end -->)", re.S)
TABLES = {}


class Failed(Exception):
    """What was found, and what is accepted."""


def table(make):
    TABLES[make.__name__] = make
    return make


@functools.lru_cache(maxsize=None)
def result(name):
    return json.loads((RESULTS / name).read_text())


def parts(name, starting=""):
    """@returns the results that stand together in one file and are named so, oldest first"""
    return [part for its, part in result(name)["parts"].items() if its.startswith(starting)]


def part(name, its):
    """@returns one of the results that stand together in one file"""
    return result(name)["parts"][its]


# --- the ten chains

H200_22 = "2026-11-22_h200_presets_seeds_4_5_6.json"  # before the guard
H200_29 = "2026-11-29_h200.json"
H200_29_CHAINS = "2026-11-29_h200_ten_chains.json"
H100_CHAINS = "2026-11-25_h100_smoke.json"
H200_CHAINS = "2026-11-23_h200_smoke.json"
H200_28 = "2026-11-28_h200.json"
EFFECT = "2026-11-22_h200_tracking_effect.json"


def misses(runs):
    """@returns {(row, f_a): [overall misses in %, in the order of the runs]}"""
    found = collections.defaultdict(list)
    for run in runs:
        found[run["row"], run["f_a"]].append(run["overall_miss_pct"])
    return found


def median_and_range(values):
    return f"{statistics.median(values):.1f} % ({min(values):.1f}..{max(values):.1f})"


@table
def baselines():
    runs = result(H200_29_CHAINS)["runs"]
    found, loads = misses(runs), (0.7, 0.9, 1.1, 1.3)
    rows = []
    for row in ("urgengo", "paper", "paam", "bare"):
        cores = statistics.median(run["cpu_cores"] for run in runs
                                  if run["row"] == row and run["f_a"] == 0.9)
        name = "**urgengo**" if row == "urgengo" else f"`{row}`" if row != "bare" else row
        rows.append([name, *(median_and_range(found[row, load]) for load in loads), f"{cores:.1f}"])
    return text_of(["misses", "f_a 0.7", "0.9", "1.1", "1.3", "cores at 0.9"], rows)


@table
def chains_since():
    rows = []
    for commit, its in (("8a44410, H200, 10 s", [result(H200_22)]),
                        ("7eb71ba, H100", parts(H100_CHAINS, "chains_7eb71ba")),
                        ("c8a5d77, H200, 10 s", [result(H200_29_CHAINS)])):
        found = misses(sorted((run for one in its for run in one["runs"]),
                              key=lambda run: run["seed"]))
        rows += [[f"{row}, {commit}", *(listed(found[row, load]) if found[row, load] else ""
                                        for load in (0.7, 0.9, 1.1, 1.3))]
                 for row in ("urgengo", "bare")]
    return text_of(["misses, seeds 4, 5 and 6", "f_a 0.7", "0.9", "1.1", "1.3"], rows)


@table
def other_presets():
    found = misses(result(EFFECT)["runs"])
    older = misses(part(H200_CHAINS, "presets_f8e8407")["runs"])
    rows = []
    for row in ("edf", "urgency", "hrrn", "static", "paper_binding", "paper_delay", "dcuda", "vanilla"):
        source = found if (row, 0.9) in found else older
        rows.append([f"`{row}`" + ", with all else as urgengo" * (row in ("edf", "urgency")),
                     *(listed(source[row, load]) if source[row, load] else "" for load in (0.9, 1.1))])
    return text_of(["preset", "f_a 0.9", "1.1"], rows)


def tracking_name(row):
    """@returns urgengo+batched@500 as a reader knows it"""
    what = row.partition("+")[2]
    if what.startswith("noise="):
        share = what.removeprefix("noise=").removesuffix("+learn")
        return f"marks, estimates off by up to {share} %" + ", `learn: on`" * what.endswith("+learn")
    how, _, interval_us = what.partition("@")
    return f"`{how}`" + (f", {float(interval_us) / 1000:g} ms" if interval_us else "")


@table
def tracking_effect():
    runs = result(EFFECT)["runs"]
    found = misses(runs)
    effects = {(one["row"], one["f_a"]): one["overall_miss_pct"]
               for one in result(EFFECT)["effects"]["rows"]}
    rows = []
    for row in dict.fromkeys(run["row"] for run in runs):
        if row != "bare" and not row.startswith("urgengo"):
            continue
        its = [f"{found[row, load][0]:.1f} % ({effects[row, load]['low']:.1f}.."
               f"{effects[row, load]['high']:.1f})" if found[row, load] else ""
               for load in (0.9, 1.1)]
        cores = next(run["report"]["cpu_cores"] for run in runs if run["row"] == row)
        name = {"bare": "bare", "urgengo": "**urgengo**, marks"}.get(row, tracking_name(row))
        rows.append([name, *its, f"{cores:.1f}"])
    return text_of(["misses", "f_a 0.9", "f_a 1.1", "cores at 0.9"], rows)


@table
def own_times():
    its = [one for one in parts("2026-11-26_calls.json") if "conditions" in one]
    rows = []
    for words, kind, conditions in (
            ("forwarded", "pass_through", ("no config", "armed, of no chain")),
            ("wrapped, nothing to do", "nothing_to_do", ("no config", "armed, of no chain")),
            ("scheduled launch, alone on the GPU", "scheduled", ("1 chain",)),
            ("the same, 10 chains on the GPU and none to wait for", "scheduled", ("10 chains",)),
            ("the same, 40 chains", "scheduled", ("40 chains",)),
            ("2 chains, a mark behind every launch", "scheduled", ("2 chains, mark every launch",)),
            ("the same, no flight recorder", "scheduled",
             ("2 chains, mark every launch, no records",)),
            ("the same, with a trace", "scheduled", ("2 chains, mark every launch, trace",)),
            ("the same, with an NVTX tool", "scheduled",
             ("2 chains, mark every launch, NVTX tool",)),
            ("10 chains, with an NVTX tool", "scheduled", ("10 chains, NVTX tool",))):
        cells = []
        for one in its:
            found = [call["own_ns"] for condition in one["conditions"]
                     if condition["condition"] in conditions
                     for name, call in condition["calls"].items() if name.startswith(kind + "/")]
            if not found:
                cells.append("")
                continue
            low, high = (f"{value:.1f}" if value < 10 else f"{value:.0f}"
                         for value in (min(found), max(found)))
            cells.append(low if low == high else f"{low} to {high}")
        if any(cells):
            rows.append([words, *cells])
    return text_of(["call, ns", *(f"{one['commit'][:7]}, {one['cpu'].split('(')[0]}" for one in its)],
                   rows)


@table
def deciding():
    points = result("2026-11-22_h200_overhead.json")["points"]
    its = [point["deciding_median_us"] for point in points]
    return text_of(["chains", *(str(point["chains"]) for point in points)],
                   [["CPU time of decisions, an instance",
                     *(f"{one['median']:.1f} us ({one['min']:.1f}..{one['max']:.1f})" for one in its)]])


# --- gates

GATES = "2026-11-26_gates.json"
WAYS = {"bare": "bare", "urgengo": "thread", "urgengo+dispatch=host": "host",
        "urgengo+dispatch=piggyback": "piggyback",
        "urgengo+dispatch=leased": "leased", "urgengo+dispatch=armed": "armed",
        "urgengo+dispatch=auto": "auto", "urgengo+nice=-15": "thread, nice",
        "urgengo+dispatch=leased+nice=-15": "leased, nice",
        "urgengo+dispatch=armed+nice=-15": "armed, nice"}


@table
def gates():
    rows = []
    for name, where in (("before_27e1e60", "H100, before"), ("quiet33_c1988b6", "H100"),
                        ("quiet34_c1988b6", "H100"), ("quiet34_547a835", "H200"),
                        ("quiet4_fcca02c", "H200"), ("quiet5_fbb74e2", "H200"),
                        ("loops8_35_72e53b4", "H100, 8 loops"),
                        ("loops16_35_72e53b4", "H100, 16 loops"),
                        ("loops16_34_547a835", "H200, 16 loops"),
                        ("loops16_5_fbb74e2", "H200, 16 loops"),
                        ("loops32_34_547a835", "H200, 32 loops"),
                        ("loops32_5_fbb74e2", "H200, 32 loops"),
                        ("loops32_33_c1988b6", "H100, 32 loops")):
        runs = part(GATES, name)["runs"]
        for seed, f_a in dict.fromkeys((run["seed"], run["f_a"]) for run in runs):
            its = {run["row"]: f"{run['overall_miss_pct']:.1f} %" for run in runs
                   if (run["seed"], run["f_a"]) == (seed, f_a)}
            rows.append([f"{where}, seed {seed}, f_a {f_a}", *(its.get(way, "") for way in WAYS)])
    return text_of(["misses", *WAYS.values()], rows)


@table
def gates_beside_loops():
    ways = [way for way in WAYS if "nice" not in way]
    rows = []
    for f_a, gpu, of_loops in ((0.9, "H100", {0: "795b214", 16: "795b214", 32: "795b214"}),
                               (0.9, "H200", {8: "feeeeca"}),
                               (1.1, "H200", dict.fromkeys((0, 8, 16, 32), "feeeeca"))):
        for loops, commit in of_loops.items():
            runs = [run for run in part(GATES, f"loops{loops}_4_5_6_{commit}")["runs"]
                    if run["f_a"] == f_a]
            its = [[run["overall_miss_pct"] for run in runs if run["row"] == way] for way in ways]
            rows.append([f"{f_a}, {loops} loops, {gpu}",
                         *(f"{statistics.fmean(one):.1f} [{min(one):.1f}, {max(one):.1f}]"
                           for one in its)])
    return text_of(["% missed at f_a", *(WAYS[way] for way in ways)], rows)


RELEASES = ("thread", "host", "piggyback", "leased", "armed")
BLOCKING = ("alone", "alone_thread", "bare", *RELEASES)


@table
def release_latency():
    rows = []
    for name, what in (("release_latency_547a835", "547a835"),
                       ("release_latency_fbb74e2", "fbb74e2")):
        its = part(GATES, name)["rows"]
        rows += [[f"{key.removesuffix('_us')}, {what}",
                  *(f"{its[way][key]:.1f} us" if way in its else "" for way in RELEASES)]
                 for key in ("p50_us", "p99_us")]
    return text_of(["release latency", *RELEASES], rows)


@table
def blocking():
    rows = []
    for machine, name in (("H100", "blocking_7eb71ba"), ("H200", "blocking_36951e3")):
        its = part(GATES, name)["rows"]
        rows.append([machine, *(f"{its[row]['p50_us']:.0f}, {its[row]['p99_us']:.0f}" if row in its
                                else "" for row in BLOCKING), f"`{name}`"])
    return text_of(["p50, p99, us", *BLOCKING, "part"], rows)


@table
def mark_room():
    its = part(GATES, "mark_room_547a835")["rows"]
    return text_of(["beside, on all multiprocessors", *(name.strip() for name in its[0]["us"])],
                   [[f"{row['blocks']} blocks of {row['threads']}, {row['shared_kb']} KB",
                     *(f"{us:.0f} us" for us in row["us"].values())] for row in its])


@table
def residency():
    its = part(GATES, "residency_c1988b6")["works"]
    rows = ("leased", "marks", "piggyback", "armed")
    return text_of(["slower by", *rows], [[name, *(f"{one['rows'][row]['slower_pct']:.1f} %"
                                                   for row in rows)] for name, one in its.items()])


# --- networks

MIXES = "2026-11-25_h100_network_mixes.json"
TOGETHER = "2026-11-26_simgpu_launching_together.json"
TRACED = "2026-11-25_h100_network_mixes_traced_676df17.json"  # urgengo sim --compare reads it too
H200_MIXES = "2026-11-26_h200_scheduling.json"
IN_TURNS = "2026-11-28_h200_modes_in_turns.json"


def cell_misses(source, mix, load, beside, row):
    """@param source  a result of network_mixes.py
    @returns misses by seed, as a text; with the seeds if urgengo ran with others"""
    for cell in source["cells"]:
        if (cell["mix"], cell["load"], cell["bystander"]) == (mix, load, beside):
            by_seed = cell["rows"].get(row, {}).get("by_seed", {})
            seeds = ", ".join(sorted(by_seed, key=int))
            others = by_seed and row != "alone" and seeds != seeds_of(source, mix, load, beside)
            return listed([by_seed[seed] for seed in sorted(by_seed, key=int)]) + \
                f" (seeds {seeds})" * bool(others)
    return "not run"


def seeds_of(source, mix, load, beside):
    for cell in source["cells"]:
        if (cell["mix"], cell["load"], cell["bystander"]) == (mix, load, beside):
            return ", ".join(sorted(cell["rows"]["urgengo"]["by_seed"], key=int))
    return ""


@table
def mixes():
    shown = (("mix_a", "A", 0.5), ("mix_a", "A", 0.9), ("mix_a_beside", "A", 0.9),
             ("mix_a_quiet", "A", 0.9), ("mix_a_presets", "A", 0.9), ("mix_a_c8a5d77", "A", 0.9),
             ("traced_d61ed3c", "A", 0.9), ("traced_4b62d17", "A", 0.9),
             ("eager_5c64724", "B", 0.5), ("eager_0e00e54", "B", 0.5),
             ("mix_b_half_load", "B", 0.5), ("mix_b", "B", 0.9), ("eager_d61ed3c", "B", 0.9),
             ("mix_b_at_the_limit", "B", 0.9), ("mix_b_2", "B", 0.9), ("mix_b_c8a5d77", "B", 0.9),
             ("eager_ce239cf", "B", 0.9), ("mixed_5c64724", "C", 0.5), ("mixed_0e00e54", "C", 0.5),
             ("mix_c", "C", 0.5), ("mix_c_c8a5d77", "C", 0.5), ("mix_c", "C", 0.9),
             ("mix_c_beside", "C", 0.9), ("mix_c_c8a5d77", "C", 0.9), ("mix_c_d61ed3c", "C", 0.9),
             ("mix_c_795b214", "C", 0.9))
    rows = []
    for name, mix, load in shown:
        source = next(part(file, name) for file in (H200_29, H200_28, H200_MIXES, MIXES)
                      if name in result(file)["parts"])
        for beside in (False, True):
            seeds = seeds_of(source, mix, load, beside)
            if not seeds:
                continue
            its = [cell_misses(source, mix, load, beside, row)
                   for row in ("bare", "priorities", "urgengo", "edf", "paam")]
            rows.append([mix, str(load), "yes" if beside else "no", seeds, *its[:2],
                         f"**{its[2]}**", *its[3:], source["gpu"].split()[1],
                         source["commit"].split(";")[0], f"`{name}`"])
    return text_of(["mix", "load", "beside", "seeds", "bare", "priorities", "urgengo", "edf", "paam",
                    "GPU", "commit", "part"], rows)


def spread_of_seeds(missed, digits=0):
    """@returns mean [least, most], number of seeds; empty without any"""
    if not missed:
        return ""
    return (f"{statistics.mean(missed):.{digits}f} [{min(missed):.{digits}f}, "
            f"{max(missed):.{digits}f}], {len(missed)}")


def spreads_by(keys, rows, digits=1):
    """@returns by these of a row's values, in order of the rows: spread_of_seeds() of each kind of row.
    Rows of the same kind are taken together"""
    found = {}
    for row in rows:
        cell = found.setdefault(tuple(row[key] for key in keys), collections.defaultdict(list))
        cell[row["row"]] += row["missed_pct"]
    return {values: {name: spread_of_seeds(missed, digits) for name, missed in cell.items()}
            for values, cell in found.items()}


@table
def simulated_overload():
    found = spreads_by(("workload", "f_a", "stall_ms"),
                       result("2026-11-27_simgpu_overload.json")["rows"])
    columns = ("bare", "before", "urgengo")
    return text_of(["networks", "times the rates", "stalls", "bare", "before", "since e163fe6"],
                   [["H100" if "h100" in workload else "H200", f"{f_a:g}",
                     "15 ms" if stall else "no", *(cell.get(name, "") for name in columns)]
                    for (workload, f_a, stall), cell in found.items() if f_a >= 2.7])


@table
def simulated_beside():
    found = spreads_by(("networks", "f_a"),
                       part("2026-11-28_simgpu_bystanders.json", "order")["rows"])
    columns = ("bare", "paam", "edf", "urgency", "priorities before", "urgengo before", "urgengo")
    return text_of(["networks", "times the rates", *columns],
                   [[networks.upper(), f"{f_a:g}", *(cell[column] for column in columns)]
                    for (networks, f_a), cell in found.items()])


@table
def simulated_launch_capacity():
    found = spreads_by(("workload", "launch_capacity", "f_a"),
                       result("2026-11-27_simgpu_overload.json")["launch_capacity"]["rows"])
    return text_of(["networks", "launch capacity", "times the rates", "bare", "c19d33d", "now"],
                   [["H100" if "h100" in workload else "H200", f"{capacity:g}", f"{f_a:g}",
                     cell["bare"], cell["c19d33d"], cell["urgengo"]]
                    for (workload, capacity, f_a), cell in found.items()])


@table
def launch_turns():
    found = spreads_by(("launch_capacity", "f_a", "stall_ms"),
                       part("2026-11-28_sim_launch_turns.json", "virtual_time")["rows"], 0)
    return text_of(["C", "times the rates", "stalls", "bare", "before", "urgengo"],
                   [[f"{capacity:g}", f"{f_a:g}", "15 ms" if stall else "no",
                     *(cell[name] for name in ("bare", "before", "urgengo"))]
                    for (capacity, f_a, stall), cell in sorted(found.items()) if f_a in (1, 1.2)])


@table
def launch_turns_of_threads():
    found = spreads_by(("load",), part("2026-11-28_sim_launch_turns.json", "threads")["rows"], 0)
    return text_of(["load", "bare", "before", "urgengo"],
                   [[f"{load:g}", *(cell[name] for name in ("bare", "before", "urgengo"))]
                    for (load,), cell in sorted(found.items())])


@table
def modes_in_turns():
    lines = []
    for name, one in result(IN_TURNS)["parts"].items():
        missed = collections.defaultdict(dict)
        for run in one["runs"]:
            missed[run["mode"]][run["cycle"]] = run["overall_miss_pct"]
        harm = [missed["on"][cycle] - off for cycle, off in missed["off"].items()]
        lines.append([one["commit"] + ", guard on" * (one["scheduler"] == ""), f"`{name}`",
                      f"{len(harm)} of {one['seconds']:g} s",
                      *(f"{statistics.fmean(missed[mode].values()):.1f}" if mode in missed else ""
                        for mode in ("off", "observe", "on, never aside", "on")),
                      f"{statistics.fmean(harm):+.1f} [{min(harm):+.1f}, {max(harm):+.1f}]"])
    return text_of(["commit", "part", "cycles", "off", "observe", "on, never aside", "on",
                    "on less off"], lines)


@table
def own_times_in_turns():
    lines = []
    for name in ("own_times", "aside_or_not"):
        for mode, calls in part(IN_TURNS, name)["own_times_ns"].items():
            launch = calls["launch"]
            lines.append([f"`{name}`", mode, *(f"{launch[key]:,.0f} ns" for key in
                                               ("added_ns", "deciding_ns", "driver_ns"))])
    return text_of(["part", "mode", "added to a launch", "of that: decisions", "driver's call"], lines)


@table
def connections():
    rows = []
    for number in (8, 32):
        runs = part(H200_MIXES, f"connections_{number}_feeeeca")["runs"]
        rows.append([str(number), *(", ".join(
            f"{run['overall_miss_pct']:.1f}" for run in runs
            if (run["row"], run["f_a"]) == (row, f_a)) + " %"
            for row in ("bare", "urgengo") for f_a in (0.9, 1.1))])
    return text_of(["connections", "bare, f_a 0.9", "1.1", "urgengo, 0.9", "1.1"], rows)


@table
def eager_at_the_limit():
    rows = ("bare", "priorities", "urgengo", "one at a time", "woken", "woken, one at a time",
            "looks every 2 ms")
    lines = []
    for machine in (1, 2, 3):
        [cell] = part(MIXES, f"eager_72e53b4_{machine}")["cells"]
        seeds = cell["rows"]["urgengo"]["by_seed"]
        later = cell["rows"]["bare"]["by_seed"].keys() - seeds.keys()
        for name, its_seeds in ((str(machine), seeds), (f"{machine}, later", later)):
            found = [[missed for seed, missed in cell["rows"].get(row, {}).get("by_seed", {}).items()
                      if seed in its_seeds] for row in rows]
            if any(found):
                lines.append([name, *(spread_of_seeds(its) for its in found)])
    return text_of(["machine", *rows], lines)


@table
def launching_together():
    rows = []
    for name, words in (("looks_as_in_the_queue_370235a", "before (370235a)"),
                        ("looks_for_turns_fa7c4d5", "every 0.5 ms (fa7c4d5)")):
        cells = []
        for row in ("bare", "urgengo"):
            works = [run["work"] for run in part(TOGETHER, name)["runs"] if run["row"] == row]
            low, middle, high = statistics.quantiles(works, n=4)
            cells.append(f"{middle:.2f} [{low:.2f}, {high:.2f}]")
        rows.append([words, *cells])
    return text_of(["looks for a turn", "bare", "urgengo"], rows)


@table
def misses_at_the_limit():
    runs = part(TOGETHER, "misses_at_the_limit")["runs"]
    rows = []
    for first, last, load in ((71, 79, 0.6), (91, 102, 0.6), (81, 86, 0.6), (81, 86, 0.7)):
        cells = []
        for build, guard in (("bare", ""), ("370235a", "off"), ("fa7c4d5", "off"), ("370235a", "on"),
                             ("fa7c4d5", "on")):
            its = [run["overall_miss_pct"] for run in runs
                   if first <= run["seed"] <= last and run["load"] == load
                   and (run["build"], run["guard"]) == (build, guard)]
            cells.append(f"{statistics.fmean(its):.0f} [{min(its):.0f}, {max(its):.0f}]"
                         if its else "not run")
        rows.append([f"{first} to {last}", str(load), *cells])
    return text_of(["seeds", "load", "bare", "before, guard off", "now, guard off", "before", "now"],
                   rows)


@table
def many_chains():
    rows = []
    for name, arrivals in (("spread", "spread"), ("at_once", "all at once")):
        for cell in part("2026-11-26_simgpu_many_chains.json", name)["cells"]:
            rows.append([str(cell["chains"]), arrivals,
                         *(f"{cell[row]['missed_pct']:.1f} %, {cell[row]['cores']:.2f}"
                           for row in ("bare", "urgengo"))])
    return text_of(["chains", "arrivals", "bare: missed, cores", "urgengo"], rows)


@table
def wrong_profiles():
    rows = []
    for row, words in (("times_4", "one chain's times 4"), ("times_0.25", "one chain's times 0.25"),
                       ("random_2", "all chains', each by up to 2"),
                       ("urgengo", "nothing"), ("priorities", "(priorities alone)"),
                       ("alone", "(each network alone: the floor)")):
        rows.append([words, *(cell_misses(source, "A", 0.9, False, row)
                              for source in (result(TRACED), part(H200_28, "mix_a")))])
    return text_of(["mix A, load 0.9, profile wrong by", "676df17, H100", "b71d78a, H200"], rows)


def error_text(one, source):
    """@returns by how much a profile's busy time is off, or that there was none"""
    found = one["errors"].get(source, {})
    if found.get("verdict") == "refused":
        return "refused"
    return f"{found['error_pct']:+.1f} %" if "error_pct" in found else ""


@table
def profiles():
    rows = []
    for its in parts("2026-11-26_h200_profile_accuracy.json"):
        for one in sorted(its["networks"], key=lambda one: (one["form"], one["network"])):
            truth = one["truth"]
            batch = re.search(r"--batch (\d+)", its["command_line"])
            more = (f", batch {batch[1]}" if batch else "") + (
                f", {truth['streams']} streams" if truth["streams"] > 1 else "")
            rows.append([f"{one['network']}, {one['form']}{more}", f"{truth['latency_ms']:.3f} ms",
                         f"{truth['busy_ms']:.3f} ms", error_text(one, "cupti"),
                         f"{one['errors']['cupti']['of_latency_pct']:+.1f} %"
                         if "of_latency_pct" in one["errors"]["cupti"] else "",
                         error_text(one, "marks")])
    return text_of(["network", "latency", "truth", "`--source cupti`", "of the latency, if GPU-bound",
                    "`--source marks`"], rows)


def ratio_text(one):
    its = next(iter(one.values()))
    return f"{its['ratio']:.4f} ({its['low']:.4f}..{its['high']:.4f})"


@table
def program_cost_direct():
    sources = parts("2026-11-25_program_cost.json", "direct_")
    return text_of(["to inferences past UrgenGo, latency", "a bystander's", "the chain's, without a profile",
                    "with one"],
                   [[f"batch {one['batch']}, {one['commit']}, {one['gpu'].split()[1]}",
                     *(ratio_text(one["ratios"]["eager"]["latency_us"][row])
                       for row in ("nobody", "chain", "profiled"))] for one in sources])


# --- random workloads, places in the work

@table
def sweep():
    rows = []
    for name in ("500_to_599_4fbfae22", "1000_to_1099_4fbfae22"):
        source = part("2026-11-27_sweep.json", name)
        summary, numbers = source["summary"], sorted(source["workloads"], key=int)
        means = summary["mean_miss_pct"]
        worse = sorted({one["workload"] for one in summary["worse"]}, key=int)
        rows.append([f"{numbers[0]} to {numbers[-1]}, {source['seconds']:g} s", percent(means["bare"], 2),
                     *(f"{means[row]:.2f} ({means[row] / means['bare']:.2f})"
                       for row in ("profile", "none")),
                     ", ".join(worse), source["commit"]])
    return text_of(["workloads", "bare", "with a profile", "without one", "a chain is worse than bare by "
                    "more than 2 frames and 2 %, twice", "commit"], rows)


@table
def sweep_beside_loops():
    """The same workloads on busy cores, of two versions."""
    rows = []
    for commit in ("f05fe5a", "9f4a8bf"):
        means = part("2026-11-27_sweep.json", f"loops_500_to_523_{commit}")["summary"]["mean_miss_pct"]
        rows.append([commit, *(percent(means[row], 1) for row in ("bare", "profile", "none"))])
    return text_of(["commit", "bare", "with a profile", "without one"], rows)


@table
def forks():
    """The same workloads over several streams, of two versions in one call."""
    before, after = (part("2026-11-27_sweep.json", f"streams_600_{c}")["workloads"]
                     for c in ("77ba79a", "795b214"))
    rows = []
    for number in sorted(after, key=int):
        its = [before[number]["first"][row] for row in ("bare", "profile", "none")] + \
              [after[number]["first"][row] for row in ("profile", "none")]
        rows.append([number, *(f"{one['overall_miss_pct']:.1f} %" for one in its)])
    return text_of(["workload", "bare", "before, with a profile", "without", "since, with a profile",
                    "without"], rows)


@table
def positions():
    name = "2026-11-23_h200_position_accuracy.json"
    its, older = parts(name, "b3af03f"), part(name, "8a44410")
    rows = []

    def add(how, cells):
        rows.append([how, ", ".join(f"{100 * one['exact']:.1f}" for one in cells) + " %",
                     ", ".join(f"{100 * one['within_one']:.1f}" for one in cells) + " %",
                     "; ".join(", ".join(microseconds(one['remaining_us'][p]) for p in ("p50", "p95", "p99"))
                               for one in cells) + " us",
                     ", ".join(f"{100 * one['miss_ratio']:.1f}" for one in cells) + " %"])

    words = (("progress", "**marks every 100 us** (default)"),
             ("progress/event", "`source: event`, every 50 us"),
             ("progress/kernel every kernel", "a mark behind every kernel (`every_us: 0`)"),
             ("progress/event every kernel", "the same, `source: event`"),
             ("async", "`tracking: async`"), ("batched@500", "`batched`, 0.5 ms"),
             ("overlapped@500", "`overlapped`, 0.5 ms (the paper's)"))
    for kind, where in (("rows", ""), ("bystander_rows", ", beside a bystander")):
        for key, how in words:
            found = [one for one in its if key in one.get(kind, {})]
            seeds = ", ".join(str(one["conditions"]["seed"]) for one in found)
            if found:
                add(f"{how}{where}, seed{'s' * (len(found) > 1)} {seeds}",
                    [one[kind][key] for one in found])
    for key, how in (("progress/memop", "* `source: memop`"), ("sync", "* `tracking: sync`")):
        add(how, [older["rows"][key]])
    return text_of(["how", "exact", "within one kernel", "remaining work, off by (median, 95 %, 99 %)",
                    "misses"], rows)


# --- pages

def with_tables(text, page):
    """@returns the page with each of its tables made anew
    @errors Failed"""
    def anew(match):
        if match[2] not in TABLES:
            raise Failed(f"{page}: found table {match[2]}, accepted: {', '.join(sorted(TABLES))}")
        return match[1] + TABLES[match[2]]() + match[4]
    return BLOCK.sub(anew, text)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing, say what is not current")
    args = parser.parse_args()
    stale = False
    try:
        for page in PAGES:
            path = ROOT / page
            old = path.read_text()
            new = with_tables(old, page)
            if new == old:
                continue
            stale = True
            if args.check:
                sys.stdout.writelines(difflib.unified_diff(
                    old.splitlines(True), new.splitlines(True), page, "of the results"))
                continue
            temporary = path.with_name(path.name + ".part")
            temporary.write_text(new)
            temporary.replace(path)
    except (Failed, OSError, KeyError, ValueError) as problem:
        sys.exit(f"tables.py: {problem!r}" if isinstance(problem, KeyError) else f"tables.py: {problem}")
    if args.check and stale:
        sys.exit("tables.py: tables are not current: run tools/bench/tables.py")


if __name__ == "__main__":
    main()
