#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""From a program that was not written for UrgenGo to its misses, bare and under UrgenGo.

  discover -> deadlines -> profile -> run bare, run --observe, run, in turns

The only thing that a person adds to what `urgengo discover` drafts is each chain's deadline, which
is set here from the program's own report: the network with that period. No source is read. Writes
one JSON result with every run and every file on the way.

  tools/bench/unknown_program.py --build build/release --repeats 3 --out result.json
"""
import argparse
import json
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile

from result_file import first_line_of, utc_now

PROGRAM = pathlib.Path(__file__).parent / "programs/torchvision_threads.py"
SKIPPED = 77
ROWS = ("bare", "observe", "enforce")


def run(command):
    """Shows the command and what it prints. Ends this program if it fails."""
    print("$ " + " ".join(pathlib.Path(c).name if c.startswith("/") else c for c in command),
          flush=True)
    done = subprocess.run(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    print(done.stdout, flush=True)
    if done.returncode != 0:
        sys.exit(SKIPPED if done.returncode == SKIPPED else f"exit status {done.returncode}")
    return done.stdout


def set_deadlines(draft, networks):
    """@returns the draft with the deadlines that the networks have, by period, and which chain is
    which network"""
    lines, matches, chain, period_ms = [], {}, "", 0.0
    for line in draft.splitlines():
        if found := re.match(r"\s*-\s*name:\s*([^\s#]+)", line):
            chain = found.group(1)
        elif found := re.match(r"\s*period_ms:\s*([\d.]+)", line):
            period_ms = float(found.group(1))
        elif found := re.match(r"(\s*)deadline_ms:\s*[\d.]+", line):
            nearest = min(networks, key=lambda n: abs(n["period_ms"] - period_ms))
            if abs(nearest["period_ms"] - period_ms) <= 0.2 * nearest["period_ms"]:
                line = f"{found.group(1)}deadline_ms: {nearest['deadline_ms']}"
                matches[chain] = nearest["name"]
        lines.append(line)
    return "\n".join(lines) + "\n", matches


def without_urgengo(environment):
    return {name: value for name, value in environment.items()
            if not name.startswith("URGENGO_")}


def print_table(runs):
    print(f"{'':<10} {'overall':>9}  " + "  ".join(f"{n['name']:>18}"
                                                   for n in runs[0]["report"]["networks"]))
    for row in ROWS:
        reports = [r["report"] for r in runs if r["row"] == row]
        cells = []
        for i in range(len(reports[0]["networks"])):
            missed = sum(r["networks"][i]["missed"] for r in reports)
            frames = sum(r["networks"][i]["frames"] for r in reports)
            cells.append(f"{missed} of {frames}".rjust(18))
        overall = statistics.median(r["overall_miss_pct"] for r in reports)
        print(f"{row:<10} {overall:>7.1f} %  " + "  ".join(cells))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", type=pathlib.Path, default="build/release",
                        help="folder with bin/urgengo and lib/urgengo")
    parser.add_argument("--program", type=pathlib.Path, default=PROGRAM)
    parser.add_argument("--seconds", type=float, default=20, help="length of a run")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--load", type=float, default=0.85)
    parser.add_argument("--batches", type=pathlib.Path, help="of an earlier --calibrate")
    parser.add_argument("--networks", type=int, default=2)
    parser.add_argument("--name-threads", action="store_true")
    parser.add_argument("--isolated", action="store_true", help="urgengo profile --isolated")
    parser.add_argument("--folder", type=pathlib.Path,
                        help="keep chains.yaml, the profile and the reports here")
    parser.add_argument("--out", type=pathlib.Path)
    args = parser.parse_args()

    urgengo = str((args.build / "bin/urgengo").resolve())
    temporary = tempfile.TemporaryDirectory()
    folder = (args.folder or pathlib.Path(temporary.name)).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    clean = without_urgengo(os.environ)
    os.environ.clear()
    os.environ.update(clean)

    program = [sys.executable, str(args.program.resolve()), "--networks", str(args.networks)]
    program += ["--name-threads"] * args.name_threads
    batches = args.batches
    if not batches:
        batches = folder / "batches.json"
        run(program + ["--load", str(args.load), "--calibrate", str(batches)])
    report, chains = folder / "report.json", folder / "chains.yaml"

    def command(seed):
        return program + ["--batches", str(batches), "--seconds", str(args.seconds), "--seed",
                          str(seed), "--json", str(report)]

    # The deadlines are the program's; this run also shows that it works at all.
    run(command(1))
    networks = json.loads(report.read_text())["networks"]
    run([urgengo, "discover", "--force", "-o", str(chains), "--"] + command(1))
    draft = chains.read_text()
    config, matches = set_deadlines(draft, networks)
    chains.write_text(config)
    print(f"chains: {matches}")
    unfound = {n["name"] for n in networks} - set(matches.values())
    if unfound:
        sys.exit(f"discover found no chain for {', '.join(sorted(unfound))}; its draft:\n{draft}")
    run([urgengo, "profile", "-c", str(chains)] + ["--isolated"] * args.isolated + ["--"] +
        command(1))

    runs = []
    for seed in range(1, args.repeats + 1):
        for row in ROWS:
            stats = folder / "stats.json"
            wrapper = [urgengo, "run", "-c", str(chains), "--mode", row, "--stats", str(stats),
                       "--"] if row != "bare" else []
            printed = run(wrapper + command(seed))
            runs.append({"row": row, "seed": seed, "report": json.loads(report.read_text()),
                         "scheduler_stats": json.loads(stats.read_text()) if wrapper else None,
                         "printed": printed})

    print_table(runs)
    # What the networks computed, for each picture, in whatever run: the same.
    sums = {json.dumps([n["checksums"] for n in r["report"]["networks"]]) for r in runs}
    print("results: " + ("equal in all runs" if len(sums) == 1 else "DIFFERENT between runs"))
    if args.out:
        profile = folder / "chains.profile.json"
        # Results are kept: they name no place of this machine.
        places = [str(folder) + "/", str(pathlib.Path.cwd()) + "/", str(PROGRAM.parent) + "/",
                  str(pathlib.Path(sys.executable).parent) + "/"]
        text = json.dumps({
            "format_version": 1, "program": "tools/bench/unknown_program.py",
            "gpu": runs[0]["report"]["gpu"], "torch": runs[0]["report"]["torch"],
            "driver": first_line_of(["nvidia-smi", "--query-gpu=driver_version",
                                     "--format=csv,noheader"]),
            "urgengo": first_line_of([urgengo, "--version"]),
            "date_utc": utc_now(),
            "command_line": " ".join(["tools/bench/unknown_program.py"] +
                                     [pathlib.Path(a).name if a.startswith("/") else a
                                      for a in sys.argv[1:]]),
            "batches": json.loads(batches.read_text()), "draft": draft, "config": config,
            "profile": json.loads(profile.read_text()), "chains": matches,
            "results_equal": len(sums) == 1, "runs": runs}, indent=1)
        for place in places:
            text = text.replace(place, "")
        args.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
