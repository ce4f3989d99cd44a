# SPDX-License-Identifier: Apache-2.0
"""Does a program compute the same bits bare and under UrgenGo?

What the *_equality.py programs share. Each has one function that does a framework's usual work and
collects the bytes of every result; main() runs it in a thread named eq_chain, in processes of its
own, one for each row of ROWS below: bare, twice, to show that it is deterministic at all; bare
beside a second thread that keeps the GPU busy, twice; under the preload without a config; as a
chain, beside a more urgent one, in observe and in enforce mode, alone and with that other chain
busy; and as a bystander of a config that names the other thread only. Every digest must be equal,
and in enforce mode launches must really have been marked and held: equality of a program that
nobody scheduled shows nothing.

Exit status 0 if so, 1 if not, 77 (skipped) without the package or a GPU.
"""
import argparse
import contextlib
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
import typing

sys.path.append(str(pathlib.Path(__file__).resolve().parents[2] / "tools/bench"))
import result_file  # noqa: E402
from dispatch_ways import DISPATCH, dispatch_key  # noqa: E402
from result_file import write as write_json  # noqa: E402, F401

SKIPPED = 77
CHAIN_THREAD = "eq_chain"
OTHER_THREAD = "zz_other"
TIMEOUT_S = 300


class Row(typing.NamedTuple):
    name: str
    runs: str  # bare | preload (no config) | observe | enforce
    beside: bool = False
    bystander: bool = False
    in_few: bool = False  # of --rows few


ROWS = (Row("bare", "bare", in_few=True),
        Row("bare again", "bare", in_few=True),
        Row("bare, beside", "bare", beside=True),
        Row("bare, beside, again", "bare", beside=True),
        Row("preload, no config", "preload"),
        Row("observe", "observe"),
        Row("observe, beside", "observe", beside=True),
        Row("enforce", "enforce"),
        Row("enforce, beside", "enforce", beside=True, in_few=True),
        Row("bystander", "enforce", bystander=True),
        Row("bystander, beside", "enforce", beside=True, bystander=True, in_few=True))

# Nobody shares the GPU with the other chain: the smallest kernels of the program are held, too.
CONFIG = """version: 1
mode: {mode}
scheduler: {{pack_limit: 0.1, share_limit: 0.1{dispatch}}}
chains:
"""
MEASURED_CHAIN = """  - name: measured
    period_ms: 100
    deadline_ms: 500
    tasks: [{{name: all, thread: "{thread}"}}]
"""
# As often as keep_busy() turns, or so: a frame that comes early is as urgent as the one that was due.
# Its deadline has room for several programs that share the GPU (run_all.py --jobs): a frame that is
# late holds nobody up, and the program would be equal because nobody was held.
OTHER_CHAIN = f"""  - name: other
    period_ms: 2
    deadline_ms: 20
    tasks: [{{name: all, thread: "{OTHER_THREAD}"}}]
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
    """The few driver calls that the busy thread needs; no framework: the same for all."""

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


def keep_busy(stop, failures, blocks=1056, priority=0):
    """A second chain, on its own stream, that keeps the first one waiting.

    @param blocks  of 256 threads each in a kernel; all that an H200 has room for, if not given"""
    name_thread(OTHER_THREAD)
    try:
        driver = Driver()
        context, module, kernel, stream = (ctypes.c_void_p() for _ in range(4))
        driver.must("cuDevicePrimaryCtxRetain", ctypes.byref(context), 0)
        driver.must("cuCtxSetCurrent", context)
        driver.must("cuModuleLoadData", ctypes.byref(module), SPIN_PTX)
        driver.must("cuModuleGetFunction", ctypes.byref(kernel), module, b"eq_spin")
        driver.must("cuStreamCreateWithPriority", ctypes.byref(stream), 1, priority)
        cycles = ctypes.c_uint64(60_000)  # about 30 us
        parameters = (ctypes.c_void_p * 1)(ctypes.addressof(cycles))
        while not stop.is_set():
            for _ in range(20):
                driver.must("cuLaunchKernel", kernel, blocks, 1, 1, 256, 1, 1, 0, stream,
                            parameters, None)
            driver.must("cuStreamSynchronize", stream)
    except OSError as error:
        failures.append(f"the busy thread: {error}")


def run_as_chain(program, beside=False, **other):
    """Calls program() in a thread of the chain's name. Ends this process if it throws.

    @param beside  while a second thread does keep_busy(..., **other), which must not fail either"""
    stop, failures = threading.Event(), []

    def measured():
        name_thread(CHAIN_THREAD)
        try:
            program()
        except Exception as error:  # whatever a framework throws
            failures.append(f"the program: {error!r}")

    busy = threading.Thread(target=keep_busy, args=(stop, failures), kwargs=other)
    if beside:
        busy.start()
    thread = threading.Thread(target=measured)
    thread.start()
    thread.join()
    stop.set()
    if beside:
        busy.join()
    if failures:
        sys.exit("; ".join(failures))


def work(packages, program, beside):
    """In a process of its own: prints digests and versions as one line of JSON."""
    outputs = []
    run_as_chain(lambda: program(outputs), beside)
    if not outputs:
        sys.exit("the program collected nothing")
    print(json.dumps({"digests": [hashlib.sha256(output).hexdigest() for output in outputs],
                      "packages": {name: getattr(sys.modules.get(name), "__version__", "")
                                   for name in packages}}))


def clean_environment():
    """The program's environment as it is without UrgenGo."""
    return {name: value for name, value in os.environ.items() if not name.startswith("URGENGO_")}


def run(command, environment):
    """@returns what the last line of the command's output says, as JSON, and its errors"""
    done = subprocess.run(command, env={**clean_environment(), **environment}, text=True,
                          capture_output=True, timeout=TIMEOUT_S)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}: exit status {done.returncode}\n"
                 f"{done.stdout[-2000:]}{done.stderr[-4000:]}")
    return {**json.loads(done.stdout.splitlines()[-1]), "errors": done.stderr}


def run_row(row, command, environment, thread, build, folder, before=(), dispatch="thread"):
    """@param command  a program that names its threads as work() does, knows --beside, and prints
                    what work() prints
    @param before   a tool that starts `urgengo run`, where there is a config
    @param dispatch  one of DISPATCH
    @returns that, with `seconds`, and with UrgenGo's statistics where it has a config"""
    command = command + ["--beside"] * row.beside
    begin, stats = time.monotonic(), None
    if row.runs == "bare":
        result = run(command, environment)
    elif row.runs == "preload":
        library = str(build / "lib/urgengo/libcuda.so.1")
        others = os.environ.get("LD_PRELOAD", "")
        result = run(command, {**environment, "LD_PRELOAD": f"{library}:{others}".strip(":")})
    else:
        config, stats = pathlib.Path(folder, "chains.yaml"), pathlib.Path(folder, "stats.json")
        measured = "" if row.bystander else MEASURED_CHAIN.format(thread=thread)
        config.write_text(CONFIG.format(mode=row.runs, dispatch=dispatch_key(dispatch)) + measured +
                          OTHER_CHAIN)
        result = run([*before, str(build / "bin/urgengo"), "run", "-c", str(config), "--quiet",
                      "--stats", str(stats), "--"] + command, environment)
        # Written at exit if UrgenGo ever started, which it does at the first launch.
        if not stats.exists():
            sys.exit(f"{row.name}: UrgenGo saw no launch")
        result["statistics"] = json.loads(stats.read_text())
        stats.unlink()
    result["seconds"] = round(time.monotonic() - begin, 1)
    return result


def counts_of(result, chain):
    for counts in result.get("statistics", {}).get("chains", []):
        if counts["name"] == chain:
            return counts
    return {}


def what_is_wrong(rows, results, must_schedule=True, dispatch="thread"):
    """@param must_schedule  also that launches were marked and held
    @param dispatch  another one than thread: also that launches of either chain stood behind gates
    @returns what the rows show against UrgenGo, or why they show nothing; empty: all is well"""
    expected = results["bare"]["digests"]
    different = [row for row in rows if results[row.name]["digests"] != expected]
    if any(row.runs == "bare" for row in different):
        return "different from run to run bare: the others show nothing"
    if different:
        return "different: " + "; ".join(row.name for row in different)
    for row in rows:
        result = results[row.name]
        if row.runs in ("bare", "preload"):
            continue
        if result["statistics"]["tripped"]:
            return f"{row.name}: UrgenGo gave up: {result['statistics']['tripped']}"
        measured, other = counts_of(result, "measured"), counts_of(result, "other")
        if row.runs == "observe":
            if measured["marks"] or measured["holds"]:
                return f"{row.name}: marked or held"
            continue
        if row.bystander and not row.beside and other["launches"]:
            return f"{row.name}: its launches were taken for the other's"
        if not must_schedule:
            continue
        if row.beside and not other["scheduled"]:
            return f"{row.name}: equal, but the other was not scheduled: it shows nothing"
        if not row.bystander and (measured["holds"] if row.beside else measured["marks"]) == 0:
            return f"{row.name}: equal, but nothing was scheduled: it shows nothing"
    gated = [row for row in rows if results[row.name].get("statistics", {}).get("gates", {})
             .get("closed", 0)]
    if must_schedule and dispatch != "thread" and not gated:
        return "equal, but no launch stood behind a gate: it shows nothing"
    return ""


def print_row(row, result, bare):
    counts = counts_of(result, "other" if row.bystander else "measured")
    equal = "equal" if result["digests"] == bare["digests"] else "DIFFERENT"
    gates = result.get("statistics", {}).get("gates", {}).get("closed", 0)
    print(f"{row.name:<24} {equal:<10} launches {counts.get('launches', '-'):>6}"
          f" marks {counts.get('marks', '-'):>5} holds {counts.get('holds', '-'):>5}"
          f" gates {gates:>5} {result['seconds']:>6} s", flush=True)


def compare(rows, command, environment, thread, build, must_schedule=True, dispatch="thread"):
    """Runs the rows and prints them. @returns results by row, and what is wrong"""
    results = {}
    with tempfile.TemporaryDirectory() as folder:
        for row in rows:
            result = run_row(row, command, environment, thread, build, folder, dispatch=dispatch)
            results[row.name] = result
            print_row(row, result, results["bare"])
    return results, what_is_wrong(rows, results, must_schedule, dispatch)


def where_and_when(script, build, commit=""):
    """What every result says about the machine and the command; the GPU is the one it ran on."""
    about = {**result_file.where_and_when(script, build, commit), "format_version": 2,
             "gpu": Driver().gpu_name()}
    return about if commit else {key: about[key] for key in about if key != "commit"}


def report(results, wrong):
    """The part of a result file that is about one program."""
    return {"packages": results["bare"]["packages"], "wrong": wrong,
            "digests": {name: result["digests"] for name, result in results.items()},
            "seconds": {name: result["seconds"] for name, result in results.items()},
            "gates": {name: result["statistics"]["gates"]["closed"]
                      for name, result in results.items() if "statistics" in result},
            "statistics": {name: result["statistics"]["chains"]
                           for name, result in results.items() if "statistics" in result}}


def why_not_here(packages):
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        return f"no {', '.join(missing)}"
    try:
        return "" if Driver().num_gpus() > 0 else "no GPU"
    except OSError as error:
        return str(error)


def skip_if(reason):
    """Ends this program, as skipped, if there is a reason."""
    if reason:
        print(f"skipped: {reason}")
        sys.exit(SKIPPED)


def add_options(parser, with_rows=True):
    parser.add_argument("--build", type=pathlib.Path, default="build/release",
                        help="build folder with bin/urgengo and lib/urgengo [build/release]")
    if with_rows:
        parser.add_argument("--rows", choices=("all", "few"), default="all",
                            help="few: bare, twice; as a chain and as a bystander, beside [all]")
        parser.add_argument("--dispatch", default="thread", choices=DISPATCH,
                            help="who lets launches go that have to wait [thread]")
    parser.add_argument("--out", type=pathlib.Path, help="write the results to this JSON file")
    parser.add_argument("--commit", default="", help="that was built, for the JSON file")


def check_build(build):
    """@returns the folder's absolute path. Ends this program if it is none of ours."""
    build = build.resolve()
    for file in ("bin/urgengo", "lib/urgengo/libcuda.so.1"):
        if not (build / file).exists():
            sys.exit(f"--build: found no {file} in {build.name}, accepted: a build folder")
    return build


def chosen_rows(rows):
    return [row for row in ROWS if rows == "all" or row.in_few]


@contextlib.contextmanager
def kernel_caches():
    """-> environment: what is compiled at run time, all rows take from the same folders."""
    with tempfile.TemporaryDirectory() as folder:
        yield {"TORCHINDUCTOR_CACHE_DIR": folder + "/inductor", "TRITON_CACHE_DIR":
               folder + "/triton"}


def main(script, packages, program, environment=dict, thread=CHAIN_THREAD, compiles=False):
    """@param packages     modules that the program imports
    @param program      appends the bytes of every result to the list that it is given
    @param environment  -> dict: set for every run; where a framework is told to choose its kernels
                        by rule and not by timing
    @param thread       pattern on the names of the threads that launch for the program
    @param compiles     runs once before the rows, so that they find all kernels compiled"""
    parser = argparse.ArgumentParser(description=sys.modules["__main__"].__doc__.splitlines()[0])
    add_options(parser)
    parser.add_argument("--work", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--beside", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.work:
        work(packages, program, args.beside)
        return
    skip_if(why_not_here(packages))
    build = check_build(args.build)
    command = [sys.executable, script, "--work"]
    with kernel_caches() if compiles else contextlib.nullcontext({}) as caches:
        environment = {**environment(), **caches}
        if compiles:
            seconds = run_row(ROWS[0], command, environment, thread, build, "")["seconds"]
            print(f"{'compiling':<24} {seconds} s", flush=True)
        results, wrong = compare(chosen_rows(args.rows), command, environment, thread, build,
                                 dispatch=args.dispatch)
    if args.out:
        name = "tests/gpu/" + pathlib.Path(script).name
        kept = {key: value for key, value in environment.items() if key not in caches}
        write_json(args.out, {**where_and_when(name, build, args.commit), "environment": kept,
                              **report(results, wrong)})
    sys.exit(wrong or 0)
