# SPDX-License-Identifier: Apache-2.0
"""Does a program compute the same bits bare and under UrgenGo?

What the *_equality.py programs share. Each has one function that does a framework's usual work and
collects the bytes of every result; main() runs it in a thread named eq_chain, in processes of its
own: bare, twice, to show that it is deterministic at all; bare beside a second thread that keeps the
GPU busy, twice; under the preload without a config; and with a config that names both threads as
chains, the second as the more urgent one, in observe and in enforce mode, alone and beside. Every
digest must be equal, and in enforce mode launches must really have been marked and held: equality
of a program that nobody scheduled shows nothing.

Exit status 0 if so, 1 if not, 77 (skipped) without the package or a GPU.
"""
import argparse
import ctypes
import hashlib
import importlib.util
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import threading
import time

SKIPPED = 77
CHAIN_THREAD = "eq_chain"
OTHER_THREAD = "zz_other"

CONFIG = """version: 1
mode: {mode}
chains:
  - name: measured
    period_ms: 100
    deadline_ms: 500
    tasks: [{{name: all, thread: "{thread}"}}]
  - name: other
    period_ms: 20
    deadline_ms: 10
    tasks: [{{name: all, thread: "{other}"}}]
"""

# Spins for so many cycles of the SM's clock, which the compiler may not leave out.
SPIN_PTX = b"""
.version 7.5
.target sm_75
.address_size 64
.visible .entry eq_spin(.param .u64 cycles)
{
    .reg .u64 %limit, %begin, %now;
    .reg .pred %more;
    ld.param.u64 %limit, [cycles];
    mov.u64 %begin, %clock64;
AGAIN:
    mov.u64 %now, %clock64;
    sub.u64 %now, %now, %begin;
    setp.lt.u64 %more, %now, %limit;
    @%more bra AGAIN;
    ret;
}
"""


def name_thread(name):
    ctypes.CDLL(None).prctl(15, name.encode(), 0, 0, 0)  # PR_SET_NAME


class Driver:
    """The few driver calls that the busy thread needs; no framework, so the same for all of them."""

    def __init__(self):
        self.library = ctypes.CDLL("libcuda.so.1")
        self.must("cuInit", 0)

    def must(self, name, *arguments):
        result = getattr(self.library, name)(*arguments)
        if result != 0:
            raise OSError(f"{name} answers {result}")

    def num_gpus(self):
        count = ctypes.c_int()
        self.must("cuDeviceGetCount", ctypes.byref(count))
        return count.value

    def gpu_name(self):
        text = ctypes.create_string_buffer(256)
        self.must("cuDeviceGetName", text, 255, 0)
        return text.value.decode()


def keep_busy(stop, failures):
    """A second chain, on its own stream, that keeps the first one waiting."""
    name_thread(OTHER_THREAD)
    try:
        driver = Driver()
        context, module, kernel, stream = (ctypes.c_void_p() for _ in range(4))
        driver.must("cuDevicePrimaryCtxRetain", ctypes.byref(context), 0)
        driver.must("cuCtxSetCurrent", context)
        driver.must("cuModuleLoadData", ctypes.byref(module), SPIN_PTX)
        driver.must("cuModuleGetFunction", ctypes.byref(kernel), module, b"eq_spin")
        driver.must("cuStreamCreate", ctypes.byref(stream), 1)  # non-blocking
        cycles = ctypes.c_uint64(60_000)  # about 30 us
        parameters = (ctypes.c_void_p * 1)(ctypes.addressof(cycles))
        while not stop.is_set():
            for _ in range(20):
                driver.must("cuLaunchKernel", kernel, 1056, 1, 1, 256, 1, 1, 0, stream, parameters,
                            None)
            driver.must("cuStreamSynchronize", stream)
    except OSError as error:
        failures.append(f"the busy thread: {error}")


def work(packages, program, beside):
    """In a process of its own: prints digests and versions as one line of JSON."""
    stop, outputs, failures = threading.Event(), [], []

    def measured():
        name_thread(CHAIN_THREAD)
        try:
            program(outputs)
        except Exception as error:  # whatever a framework throws
            failures.append(f"the program: {error!r}")

    busy = threading.Thread(target=keep_busy, args=(stop, failures))
    if beside:
        busy.start()
    main_thread = threading.Thread(target=measured)
    main_thread.start()
    main_thread.join()
    stop.set()
    if beside:
        busy.join()
    if failures or not outputs:
        sys.exit("; ".join(failures) or "the program collected nothing")
    print(json.dumps({"sha256": [hashlib.sha256(output).hexdigest() for output in outputs],
                      "packages": {name: getattr(sys.modules.get(name), "__version__", "")
                                   for name in packages}}))


def run(command, environment):
    """@returns what the last line of the command's output says, as JSON"""
    done = subprocess.run(command, env={**os.environ, **environment}, text=True,
                          capture_output=True, timeout=600)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}: exit status {done.returncode}\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def first_line_of(command):
    try:
        return subprocess.run(command, text=True, capture_output=True).stdout.strip()
    except OSError:
        return ""


def why_not_here(packages):
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        return f"no {', '.join(missing)}"
    try:
        return "" if Driver().num_gpus() > 0 else "no GPU"
    except OSError as error:
        return str(error)


def compare(script, environment, thread, build, out):
    me = [sys.executable, script, "--work"]
    library = build / "lib/urgengo/libcuda.so.1"
    rows = {"bare": run(me, environment), "bare again": run(me, environment),
            "bare, beside": run(me + ["--beside"], environment),
            "bare, beside, again": run(me + ["--beside"], environment),
            "preload, no config": run(me, {**environment, "LD_PRELOAD": str(library)})}
    counts = {}
    with tempfile.TemporaryDirectory() as folder:
        for mode in ("observe", "enforce"):
            config = pathlib.Path(folder, f"{mode}.yaml")
            config.write_text(CONFIG.format(mode=mode, thread=thread, other=OTHER_THREAD))
            for beside in (False, True):
                row = f"{mode}{', beside' if beside else ''}"
                stats = pathlib.Path(folder, "stats.json")
                rows[row] = run([str(build / "bin/urgengo"), "run", "-c", str(config), "--quiet",
                                 "--stats", str(stats), "--"] + me + ["--beside"] * beside,
                                environment)
                # Written at exit if UrgenGo ever started, which it does at the first launch.
                if not stats.exists():
                    sys.exit(f"{row}: UrgenGo saw no launch")
                counts[row] = json.loads(stats.read_text())["chains"][0]
                stats.unlink()

    packages = rows["bare"]["packages"]
    rows = {row: result["sha256"] for row, result in rows.items()}
    for row, digests in rows.items():
        count = counts.get(row, {})
        print(f"{row:<24} {'equal' if digests == rows['bare'] else 'DIFFERENT':<10}"
              f" launches {count.get('launches', '-'):>6} marks {count.get('marks', '-'):>5}"
              f" holds {count.get('holds', '-'):>5}")
    if out:
        out.write_text(json.dumps({
            "format_version": 1, "program": "tests/gpu/" + pathlib.Path(script).name,
            "gpu": Driver().gpu_name(),
            "driver": first_line_of(["nvidia-smi", "--query-gpu=driver_version",
                                     "--format=csv,noheader"]),
            "packages": packages,
            "urgengo": first_line_of([str(build / "bin/urgengo"), "--version"]),
            "date_utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            "command_line": f"tests/gpu/{pathlib.Path(script).name} --build {build.name}",
            "environment": environment, "sha256": rows, "chain measured": counts},
            indent=1) + "\n")

    if any(digests != rows["bare"] for digests in rows.values()):
        return "not all equal"
    if counts["enforce"]["marks"] == 0 or counts["enforce, beside"]["holds"] == 0:
        return "equal, but nothing was scheduled: it shows nothing"
    return ""


def main(script, packages, program, environment=dict, thread=CHAIN_THREAD):
    """@param packages     modules that the program imports
    @param program      appends the bytes of every result to the list that it is given
    @param environment  -> dict: set for every run; where a framework is told to choose its kernels
                        by rule and not by timing
    @param thread       pattern on the names of the threads that launch for the program"""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", type=pathlib.Path, default="build/release",
                        help="build folder with bin/urgengo and lib/urgengo")
    parser.add_argument("--out", type=pathlib.Path, help="write the digests to this JSON file")
    parser.add_argument("--work", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--beside", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.work:
        work(packages, program, args.beside)
        return
    reason = why_not_here(packages)
    if reason:
        print(f"skipped: {reason}")
        sys.exit(SKIPPED)
    wrong = compare(script, environment(), thread, args.build.resolve(), args.out)
    if wrong:
        sys.exit(wrong)
