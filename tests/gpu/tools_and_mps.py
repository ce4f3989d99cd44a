#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""UrgenGo with others around the program: compute-sanitizer, ncu, CUDA_LAUNCH_BLOCKING=1, MPS.

The program is math_libraries.cu. Four cases:

  memcheck  compute-sanitizer started by UrgenGo, and UrgenGo by compute-sanitizer: no error found,
            launches seen by UrgenGo, and the digests of the program alone
  gates     dispatch: {where: device, device: armed} under compute-sanitizer and Nsight Compute:
            equal digests, no gate closed, and a line that names the tool; without a tool gates are
            closed
  blocking  CUDA_LAUNCH_BLOCKING=1: equal digests
  mps       as a client of a daemon of our own, which is stopped at the end: equal digests

  tests/gpu/tools_and_mps.py --build build/release --only memcheck,mps --out result.json

Exit status 0 if all is well, 1 if not, 77 if no case could run.
"""
import argparse
import contextlib
import glob
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import build_math_libraries
import equality
from equality import Row

ENVIRONMENT = {"CUBLAS_WORKSPACE_CONFIG": ":4096:8"}
MPS_CONTROL = "nvidia-cuda-mps-control"
STOP_TIMEOUT_S = 20


class Skip(Exception):
    pass


def installed(name, elsewhere):
    """@param elsewhere  where else it may be, as a pattern
    @returns where the tool is"""
    places = [shutil.which(name), *sorted(glob.glob(f"/usr/local/cuda*/bin/{name}") +
                                          glob.glob(elsewhere))]
    for place in places:
        if place and os.path.exists(place):
            return place
    raise Skip(f"no {name}")


def compute_sanitizer():
    return installed("compute-sanitizer", "/usr/local/cuda*/compute-sanitizer/compute-sanitizer")


def ncu():
    return installed("ncu", "/opt/nvidia/nsight-compute/*/ncu")


def errors_found(log):
    """@returns what memcheck's summary says, None if it has none"""
    text = log.read_text() if log.exists() else ""
    found = re.findall(r"ERROR SUMMARY: (\d+) error", text)
    return sum(int(count) for count in found) if found else None


def memcheck(program, args, folder):
    """@returns results by row, and what is wrong"""
    command, log = [program, "--small"], folder / "memcheck.log"
    tool = [compute_sanitizer(), "--tool", "memcheck", "--log-file", str(log)]
    all_processes = tool + ["--target-processes", "all"]
    # name and role, what UrgenGo starts, what starts UrgenGo
    rows = [(Row("bare", "bare"), command, ()),
            (Row("memcheck alone", "bare"), tool + command, ()),
            (Row("preload of no config", "preload"), tool + command, ()),
            (Row("urgengo starts it", "enforce", beside=True), tool + command, ()),
            (Row("it starts urgengo", "enforce", beside=True), command, all_processes),
            (Row("bystander", "enforce", beside=True, bystander=True), tool + command, ())]
    results, wrong = {}, []
    for row, started, before in rows:
        log.unlink(missing_ok=True)
        result = equality.run_row(row, started, ENVIRONMENT, equality.CHAIN_THREAD, args.build,
                                  folder, before, args.dispatch)
        results[row.name] = result
        equality.print_row(row, result, results["bare"])
        if result["digests"] != results["bare"]["digests"]:
            wrong.append(f"{row.name}: different")
        if row.name != "bare":
            result["memcheck_errors"] = errors_found(log)
            if result["memcheck_errors"] != 0:
                wrong.append(f"{row.name}: memcheck's summary: found "
                             f"{result['memcheck_errors']} errors, accepted: 0\n"
                             f"{log.read_text()[:3000] if log.exists() else ''}")
        chain = "other" if row.bystander else "measured"
        if row.runs == "enforce" and not equality.counts_of(result, chain)["launches"]:
            wrong.append(f"{row.name}: UrgenGo saw no launch")
    return results, "; ".join(wrong)


def serialising_tools(log):
    """@returns the tools that are here: name, command, and what says in its log that it worked"""
    tools = []
    for name, found, options, worked in (
            ("compute-sanitizer", compute_sanitizer, ["--tool", "memcheck"], "ERROR SUMMARY: 0"),
            ("Nsight Compute", ncu, ["--metrics", "gpu__time_duration.sum", "--launch-count", "3"],
             "gpu__time_duration.sum")):
        try:
            tools.append((name, [found(), *options, "--log-file", str(log)], worked))
        except Skip as skip:
            print(skip)
    if not tools:
        raise Skip("neither of the tools")
    return tools


def gates(program, args, folder):
    """@returns results by row, and what is wrong"""
    command, log = [program, "--small"], folder / "tool.log"
    rows = [(Row("bare", "bare"), command, (), None, None),
            (Row("no tool", "enforce", beside=True), command, (), None, None)]
    for name, tool, worked in serialising_tools(log):
        rows += [(Row(f"starts {name}", "enforce", beside=True), tool + command, (), name, worked),
                 (Row(f"by {name}", "enforce", beside=True), command,
                  tool + ["--target-processes", "all"], name, worked)]
    results, wrong = {}, []
    for row, started, before, tool, worked in rows:
        log.unlink(missing_ok=True)
        result = equality.run_row(row, started, ENVIRONMENT, equality.CHAIN_THREAD, args.build,
                                  folder, before, "armed")
        results[row.name] = result
        equality.print_row(row, result, results["bare"])
        if result["digests"] != results["bare"]["digests"]:
            wrong.append(f"{row.name}: different")
        if row.runs == "bare":
            continue
        statistics = result["statistics"]
        if statistics["tripped"]:
            wrong.append(f"{row.name}: UrgenGo gave up: {statistics['tripped']}")
        if (statistics["gates"]["closed"] > 0) != (tool is None):
            wrong.append(f"{row.name}: {statistics['gates']['closed']} gates were closed")
        if not equality.counts_of(result, "measured")["scheduled"]:
            wrong.append(f"{row.name}: nothing was scheduled")
        if not tool:
            continue
        if f"dispatch: {tool} is there" not in result["errors"]:
            wrong.append(f"{row.name}: no line says that {tool} is there")
        said = log.read_text() if log.exists() else ""
        if "ERR_NVGPUCTRPERM" in said:
            print(f"  {tool} may not read counters here: it replayed no kernel")
        elif worked not in said:
            wrong.append(f"{row.name}: the tool's log has no {worked}:\n{said[-2000:]}")
    return results, "; ".join(wrong)


def blocking(program, args, _folder):
    # Such a program waits for every launch: whether one is held is UrgenGo's choice.
    return equality.compare(equality.chosen_rows(args.rows), [program],
                            {**ENVIRONMENT, "CUDA_LAUNCH_BLOCKING": "1"}, equality.CHAIN_THREAD,
                            args.build, must_schedule=False, dispatch=args.dispatch)


def ask_mps(environment, question, timeout=STOP_TIMEOUT_S):
    return subprocess.run([MPS_CONTROL], input=question + "\n", text=True, capture_output=True,
                          env=environment, timeout=timeout).stdout.strip()


def is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    # A daemon whose parent does not wait for it stays as a zombie, which is over, too.
    with contextlib.suppress(OSError):
        return pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    return False


def stop_mps(environment, pid_file):
    """The daemon that was started here, and no other; by force if it does not listen."""
    found = re.search(r"\d+", pid_file.read_text()) if pid_file.exists() else None
    pid, servers = int(found.group()) if found else 0, []
    with contextlib.suppress(subprocess.TimeoutExpired):
        servers = [int(number) for number in
                   re.findall(r"\d+", ask_mps(environment, "get_server_list"))]
    with contextlib.suppress(subprocess.TimeoutExpired):
        ask_mps(environment, "quit")
    end = time.monotonic() + STOP_TIMEOUT_S
    for process in [*servers, pid]:
        while process and is_running(process) and time.monotonic() < end:
            time.sleep(0.1)
        if process and is_running(process):
            print(f"MPS process {process} does not end: killed")
            os.kill(process, signal.SIGKILL)


@contextlib.contextmanager
def mps_daemon():
    """-> environment of a client of a daemon that lives as long"""
    if not shutil.which(MPS_CONTROL):
        raise Skip(f"no {MPS_CONTROL}")
    with tempfile.TemporaryDirectory(prefix="mps") as folder:
        ours = {"CUDA_MPS_PIPE_DIRECTORY": folder + "/pipe", "CUDA_MPS_LOG_DIRECTORY":
                folder + "/log"}
        for path in ours.values():
            os.mkdir(path)
        environment = {**equality.clean_environment(), **ours}
        done = subprocess.run([MPS_CONTROL, "-d"], env=environment, text=True,
                              stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                              timeout=STOP_TIMEOUT_S)
        try:
            if done.returncode != 0:
                raise Skip(f"{MPS_CONTROL} does not start: {done.stderr.strip()}")
            # Until it listens, programs run without it.
            end = time.monotonic() + STOP_TIMEOUT_S
            while not ask_mps(environment, "get_default_active_thread_percentage"):
                if time.monotonic() > end:
                    raise Skip(f"{MPS_CONTROL} does not listen")
                time.sleep(0.2)
            yield ours, environment
        finally:
            stop_mps(environment, pathlib.Path(folder, "pipe", MPS_CONTROL + ".pid"))


def mps(program, args, _folder):
    with mps_daemon() as (ours, environment):
        results, wrong = equality.compare(equality.chosen_rows(args.rows), [program],
                                          {**ENVIRONMENT, **ours}, equality.CHAIN_THREAD,
                                          args.build, dispatch=args.dispatch)
        if not wrong and not re.search(r"\d", ask_mps(environment, "get_server_list")):
            wrong = "equal, but no client came to the daemon: it shows nothing"
        return results, wrong


CASES = {"memcheck": memcheck, "gates": gates, "blocking": blocking, "mps": mps}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    equality.add_options(parser)
    parser.set_defaults(rows="few")
    parser.add_argument("--only", default=",".join(CASES), help="cases, by commas [all]")
    args = parser.parse_args()
    names = args.only.split(",")
    if not set(names) <= set(CASES):
        parser.error(f"--only: found {args.only}, accepted: some of {', '.join(CASES)}")
    equality.skip_if(equality.why_not_here([]) or ("" if build_math_libraries.nvcc() else "no nvcc"))
    args.build = equality.check_build(args.build)

    reports, failures = {}, []
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        program, missing = build_math_libraries.build(folder, "static")
        for name in names:
            print(f"-- {name}" + (f"; not here: {', '.join(missing)}" if missing else ""))
            try:
                results, wrong = CASES[name](str(program), args, folder)
            except Skip as skip:
                print(f"skipped: {skip}")
                reports[name] = {"skipped": str(skip)}
                continue
            except SystemExit as failed:  # the program's exit status
                print(failed)
                reports[name] = {"wrong": str(failed)}
                failures.append(f"{name}: did not run")
                continue
            errors = {row: result["memcheck_errors"] for row, result in results.items()
                      if "memcheck_errors" in result}
            reports[name] = {"not_here": missing, **equality.report(results, wrong),
                             **({"memcheck_errors": errors} if errors else {})}
            if wrong:
                failures.append(f"{name}: {wrong}")
    if args.out:
        equality.write_json(args.out, {
            **equality.where_and_when("tests/gpu/tools_and_mps.py", args.build, args.commit),
            "environment": ENVIRONMENT, "cases": reports})
    if all("skipped" in report for report in reports.values()):
        sys.exit(equality.SKIPPED)
    sys.exit("\n".join(failures) or 0)


if __name__ == "__main__":
    main()
