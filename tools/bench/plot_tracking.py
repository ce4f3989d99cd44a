#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Plots what tracking and wrong estimates do to misses, from the JSON of `urgengo bench smoke`.

Two figures, as far as the rows are there: OUT_intervals.svg, the miss ratio against the evaluation
interval for rows such as urgengo+batched@100, with ways of tracking that have none as lines beside
the preset itself, which is a band; OUT_noise.svg, against the noise of estimates, for rows such as
urgengo+noise=30 and urgengo+noise=30+learn. Bars and bands are the 95 % intervals of the JSON.

  tools/bench/plot_tracking.py result.json --out effect
"""
import argparse
import collections
import json
import pathlib
import re
import sys

INTERVAL = re.compile(r"^\+(\w+)@(\d+)$")
NOISE = re.compile(r"^(?:\+noise=(\d+))?(\+learn)?$")


def rows_of(results, preset, f_a):
    """@returns by what follows the preset in the row's name: value, low and high"""
    return {row["row"][len(preset):]: row["overall_miss_pct"] for row in results["effects"]["rows"]
            if row["f_a"] == f_a and re.fullmatch(re.escape(preset) + r"(\+.*)?", row["row"])}


def interval_curves(rows):
    """@returns by way of tracking, points (ms, interval) in order; and ways without an interval"""
    curves, flat = collections.defaultdict(list), {}
    for name, interval in rows.items():
        if match := INTERVAL.match(name):
            curves[match[1]].append((int(match[2]) / 1000, interval))
        elif re.fullmatch(r"\+(async|sync)", name):
            flat[name[1:]] = interval
    return {mode: sorted(points, key=lambda p: p[0]) for mode, points in curves.items()}, flat


def noise_curves(rows):
    """@returns by whether it learns, points (per cent, interval) in order"""
    curves = collections.defaultdict(list)
    for name, interval in rows.items():
        if match := NOISE.match(name):
            curves["learning" if match[2] else "profile"].append((int(match[1] or 0), interval))
    return {mode: sorted(points, key=lambda p: p[0]) for mode, points in curves.items()}


def draw_points(axes, label, points):
    values = [interval["value"] for _, interval in points]
    # A percentile interval need not hold the mean.
    below = [max(0, interval["value"] - interval["low"]) for _, interval in points]
    above = [max(0, interval["high"] - interval["value"]) for _, interval in points]
    axes.errorbar([x for x, _ in points], values, yerr=[below, above], marker="o", capsize=3,
                  label=label)


def draw_intervals(axes, rows, preset):
    curves, flat = interval_curves(rows)
    for mode, points in sorted(curves.items()):
        draw_points(axes, mode, points)
    for mode, interval in sorted(flat.items()):
        axes.axhline(interval["value"], linestyle=":", color="gray")
        axes.annotate(mode, (1, interval["value"]), xycoords=("axes fraction", "data"),
                      ha="right", va="bottom", color="gray")
    if "" in rows:
        axes.axhspan(rows[""]["low"], rows[""]["high"], alpha=0.25, color="tab:green")
        axes.axhline(rows[""]["value"], color="tab:green", label=f"{preset} (95 %)")
    axes.set_xscale("log")
    ticks = sorted({x for points in curves.values() for x, _ in points})
    axes.set_xticks(ticks, [f"{x:g}" for x in ticks])
    axes.minorticks_off()
    axes.set_xlabel("evaluation interval, ms")
    return bool(curves)


def draw_noise(axes, rows, _):
    curves = noise_curves(rows)
    for mode, points in sorted(curves.items(), reverse=True):
        draw_points(axes, mode, points)
    axes.set_xlabel("noise of estimates, ± %")
    return any(x for points in curves.values() for x, _ in points)


def plot(results, preset, draw, path):
    """@returns whether there was something to draw"""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "urgengo"  # the same bytes for the same results
    matplotlib.rcParams["svg.fonttype"] = "none"
    import matplotlib.pyplot as plt

    levels = sorted({row["f_a"] for row in results["effects"]["rows"]})
    figure, all_axes = plt.subplots(1, len(levels), figsize=(5 * len(levels), 3.6), squeeze=False)
    drawn = [draw(axes, rows_of(results, preset, f_a), preset)
             for axes, f_a in zip(all_axes[0], levels)]
    for axes, f_a in zip(all_axes[0], levels):
        axes.set_title(f"f_a {f_a:g}")
        axes.set_ylabel("deadline miss ratio, %")
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize="small")
    if results["simulated_gpu"]:
        figure.suptitle("simulated GPU")
    figure.tight_layout()
    if any(drawn):
        figure.savefig(path, metadata={"Date": None})
        print(f"wrote {path}", file=sys.stderr)
    plt.close(figure)
    return any(drawn)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=pathlib.Path, help="JSON of `urgengo bench smoke`")
    parser.add_argument("--preset", default="urgengo", help="that rows change [urgengo]")
    parser.add_argument("--out", required=True, help="begin of the files' names")
    args = parser.parse_args()
    results = json.loads(args.results.read_text())
    if not results.get("effects", {}).get("rows"):
        sys.exit(f"{args.results}: found no intervals, accepted: JSON of this version")
    figures = [plot(results, args.preset, draw_intervals, f"{args.out}_intervals.svg"),
               plot(results, args.preset, draw_noise, f"{args.out}_noise.svg")]
    if not any(figures):
        sys.exit(f"{args.results}: found no row to plot, accepted: {args.preset}+batched@100, "
                 f"{args.preset}+noise=30, ...")


if __name__ == "__main__":
    main()
