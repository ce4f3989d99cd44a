#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Are the kernels' stamps the truth? Compares them with CUPTI's records of the same run.

The ten chains run once, without UrgenGo, with stamps and with CUPTI's concurrent-kernel records
(cupti_kernels.cpp). Launch by launch of each stream, by the one and by the
other: how long after the launch before it ended, which is what tells how many are done. The
differences must be small against what position_accuracy.py tells: kernels of tens of microseconds.
Begins and durations are reported, too, but not judged: with stamps a launch begins with its first
block, with CUPTI when the GPU takes it up, which is earlier where others fill the GPU.

  tools/bench/stamps_check.py --build build/release --out result.json

Exit status 0 if the median differences are below 2 us and the p99 below 10, 1 if not, 77 (skipped)
without a GPU or CUPTI.
"""
import argparse
import os
import pathlib
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
sys.path.insert(0, str(HERE.parents[1] / "tests/gpu"))
import cupti_library  # noqa: E402
import equality  # noqa: E402
import stamps_file  # noqa: E402

MEDIAN_US, P99_US = 2, 10


def read_records(path):
    """@returns begins and ends of the chains' kernels by stream, in order"""
    streams = {}
    for kernel in cupti_library.read_records(path).kernels:
        if kernel.name in cupti_library.CHAINS_KERNELS:
            streams.setdefault(kernel.stream, []).append((kernel.begin_ns, kernel.end_ns))
    return [sorted(records) for records in streams.values()]


def durations(pairs):
    return [end - begin for begin, end in pairs]


def between_begins(pairs):
    return [after[0] - before[0] for before, after in zip(pairs, pairs[1:])]


def between_ends(pairs):
    return [after[1] - before[1] for before, after in zip(pairs, pairs[1:])]


WHAT = {"duration": durations, "between begins": between_begins, "between ends": between_ends}
JUDGED = "between ends"


def differences(of, stamps, records):
    return [(a - b) / 1000 for a, b in zip(of(stamps), of(records))]


def median(values):
    return sorted(values)[len(values) // 2]


def summary(values):
    sizes = sorted(map(abs, values))
    return {"median_us": median(values), "median_size_us": median(sizes),
            "p99_size_us": sizes[min(len(sizes) - 1, int(0.99 * len(sizes)))],
            "max_size_us": sizes[-1], "count": len(sizes)}


def compare(file, records):
    """Streams have other numbers in CUPTI's eyes: of those with as many launches, the one that
    fits best.
    @returns differences of each of WHAT; and names of streams that were not found"""
    found, missing, left = {what: [] for what in WHAT}, [], list(records)
    for stream in file.streams:
        same = [its for its in left if len(its) == len(stream.stamps) > 1]
        if not same:
            missing.append(f"{stream.chain} ({len(stream.stamps)} launches)")
            continue
        best = min(same, key=lambda its: median(
            [abs(d) for d in differences(between_ends, stream.stamps, its)]))
        left.remove(best)
        for what, of in WHAT.items():
            found[what] += differences(of, stream.stamps, best)
    return found, missing


def parse():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default="build/release")
    parser.add_argument("--workload", type=pathlib.Path, help="calibrated before [calibrate]")
    parser.add_argument("--f-a", type=float, default=0.9)
    parser.add_argument("--seconds", type=float, default=6)
    parser.add_argument("--out", type=pathlib.Path, help="write the results to this JSON file")
    parser.add_argument("--commit", default="", help="that was built, for the JSON file")
    return parser.parse_args()


def run(what, command, environment=None):
    done = subprocess.run(command, text=True, capture_output=True, env=environment)
    if done.returncode != 0:
        sys.exit(f"{what}: exit status {done.returncode}\n{done.stderr[-4000:]}")
    return done


def measure(args, folder, library):
    chains = str(args.build / "bin/urgengo-chains")
    workload, stamps, records = (str(pathlib.Path(folder, name))
                                 for name in ("workload.json", "stamps", "records"))
    if args.workload:
        workload = str(args.workload)
    else:
        run("calibrate", [chains, "calibrate", "--out", workload])
    environment = {**os.environ, "CUDA_INJECTION64_PATH": str(library), "CUPTI_KERNELS": records}
    done = run("run", [chains, "run", "--workload", workload, "--f-a", str(args.f_a), "--seconds",
                       str(args.seconds), "--stamps", stamps, "--sample-us", "0"], environment)
    if not pathlib.Path(records).exists():
        sys.exit(f"CUPTI recorded nothing\n{done.stderr[-2000:]}")
    return stamps_file.StampsFile(stamps), read_records(records)


def main():
    args = parse()
    equality.skip_if(equality.why_not_here(()))
    args.build = equality.check_build(args.build)
    with tempfile.TemporaryDirectory() as folder:
        library, missing = cupti_library.build(folder)
        equality.skip_if(missing)
        file, records = measure(args, folder, library)
    found, not_found = compare(file, records)
    results = {name: summary(values) for name, values in found.items() if values}
    for name, s in results.items():
        print(f"{name:<14} stamps less CUPTI: median {s['median_us']:.2f} us; sizes: median "
              f"{s['median_size_us']:.2f}, p99 {s['p99_size_us']:.2f}, max {s['max_size_us']:.2f} "
              f"us, {s['count']} launches")
    wrong = [f"{name}: no records" for name in not_found]
    judged = results.get(JUDGED)
    if judged and (judged["median_size_us"] > MEDIAN_US or judged["p99_size_us"] > P99_US):
        wrong.append(f"{JUDGED}: found {judged}, accepted: median {MEDIAN_US} us, p99 {P99_US} us")
    if args.out:
        equality.write_json(args.out, {
            **equality.where_and_when("tools/bench/stamps_check.py", args.build, args.commit),
            "f_a": args.f_a, "seconds": args.seconds, "resolution_ns": file.resolution_ns(),
            "differences": results, "wrong": wrong})
    if wrong or not results:
        sys.exit("\n".join(wrong) or "nothing to compare")


if __name__ == "__main__":
    main()
