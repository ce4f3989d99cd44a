#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs every *_equality.py program here, several at a time, and writes one result.

Digests do not depend on who else uses the GPU, so the programs may run side by side.

  tests/gpu/run_all.py --build build/release --rows few --jobs 4 --out result.json

Exit status 0 if all are equal, 1 if one is not, 77 if none could run.
"""
import argparse
import concurrent.futures
import json
import pathlib
import subprocess
import sys
import tempfile
import time

import equality

HERE = pathlib.Path(__file__).resolve().parent
SUFFIX = "_equality"
OTHERS = {"dispatch"}  # host and GPU, not a program


def names_of_programs():
    names = {path.stem.removesuffix(SUFFIX) for path in HERE.glob(f"*{SUFFIX}.py")}
    return sorted(names - OTHERS)


def run_one(name, args, folder):
    """@returns the program's report, with what it printed"""
    out, begin = pathlib.Path(folder, f"{name}.json"), time.monotonic()
    command = [sys.executable, str(HERE / f"{name}{SUFFIX}.py"), "--build", str(args.build),
               "--rows", args.rows, "--dispatch", args.dispatch, "--out", str(out)]
    try:
        done = subprocess.run(command, text=True, capture_output=True, timeout=args.timeout)
        status, printed = done.returncode, done.stdout + done.stderr
    except subprocess.TimeoutExpired as error:
        printed = (error.stdout or b"").decode() + f"not done after {args.timeout} s"
        status = 1
    report = json.loads(out.read_text()) if out.exists() else {}
    return {"status": status, "seconds_in_all": round(time.monotonic() - begin, 1), **report,
            "printed": printed}


def verdict(report):
    if report["status"] == equality.SKIPPED:
        return report["printed"].strip()
    return "equal" if report["status"] == 0 else "FAILED"


def digests_and_rows(report):
    parts = list(report.get("variants", {}).values()) or [report]
    return (sum(len(part.get("digests", {}).get("bare", [])) for part in parts),
            sum(len(part.get("digests", {})) for part in parts))


def totals(report, chain, count):
    parts = list(report.get("variants", {}).values()) or [report]
    return sum(counts[count] for part in parts for row in part.get("statistics", {}).values()
               for counts in row if counts["name"] == chain)


def write(args, reports):
    """After every program: what is cut off has lost no more than those that were running."""
    if not args.out:
        return
    about = equality.where_and_when("tests/gpu/run_all.py", args.build, args.commit)
    shared = {"format_version", "program", "gpu", "driver", "urgengo", "command_line", "printed"}
    equality.write_json(args.out, {**about, "programs": {
        name: {key: value for key, value in reports[name].items() if key not in shared}
        for name in sorted(reports)}})


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    equality.add_options(parser)
    parser.add_argument("--jobs", type=int, default=4, help="programs at a time [4]")
    parser.add_argument("--only", default="", help="these, by commas: " +
                        ", ".join(names_of_programs()))
    parser.add_argument("--timeout", type=float, default=600, help="seconds for a program [600]")
    args = parser.parse_args()
    names = [name for name in args.only.split(",") if name] or names_of_programs()
    unknown = sorted(set(names) - set(names_of_programs()))
    if unknown:
        parser.error(f"--only: found {', '.join(unknown)}, accepted: "
                     f"{', '.join(names_of_programs())}")
    equality.skip_if(equality.why_not_here([]))
    args.build = equality.check_build(args.build)

    reports = {}
    with tempfile.TemporaryDirectory() as folder, \
            concurrent.futures.ThreadPoolExecutor(args.jobs) as pool:
        running = {pool.submit(run_one, name, args, folder): name for name in names}
        for done in concurrent.futures.as_completed(running):
            name, report = running[done], done.result()
            reports[name] = report
            print(f"== {name}: {verdict(report)}, {report['seconds_in_all']} s\n"
                  f"{report['printed'].rstrip()}", flush=True)
            write(args, reports)

    print(f"\n{'program':<24}{'rows':>6}{'digests':>9}{'marks':>9}{'holds':>9}{'s':>8}")
    for name in names:
        report = reports[name]
        digests, rows = digests_and_rows(report)
        print(f"{name:<24}{rows:>6}{digests:>9}{totals(report, 'measured', 'marks'):>9}"
              f"{totals(report, 'measured', 'holds'):>9}{report['seconds_in_all']:>8}"
              f"  {verdict(report)}")
    statuses = {report["status"] for report in reports.values()}
    if statuses == {equality.SKIPPED}:
        sys.exit(equality.SKIPPED)
    sys.exit(0 if statuses <= {0, equality.SKIPPED} else 1)


if __name__ == "__main__":
    main()
