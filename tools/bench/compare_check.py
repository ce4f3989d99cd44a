#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Does `urgengo compare` find a difference where there is none, and where there is one?

Of the ten chains (tools/chains): so many comparisons of observe with observe, at its own 95 %, and
so many of observe with scheduling.

  tools/bench/compare_check.py --simulated --runs 20 --out result.json
  tools/bench/compare_check.py --build build/release --runs 20            # GPU

Exit status 0 if at most 3 of 20 found a difference where there is none, and all of the others
fewer misses with scheduling, in the mean over the chains; else 1.
"""
import argparse
import json
import os
import pathlib
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import result_file  # noqa: E402
from kill_switch import Bench, Failed  # noqa: E402

WARM_UP_S = 2


def compare(bench, options, others, seed):
    count = options.blocks if others == "observe" else options.enforce_blocks
    blocks = ["--block", str(options.block_s), "--blocks", str(count), "--warm-up", str(WARM_UP_S)]
    seconds = WARM_UP_S + options.block_s * count + 10
    done = bench.call([bench.urgengo, "compare", "--json", "-q", *bench.driver, "-c", "chains.yaml",
                       "--with", "observe", "--against", others, "--seed", str(seed), *blocks, "--",
                       bench.chains, "run", "--f-a", str(options.f_a), "--seconds", str(seconds),
                       "--seed", str(seed), "--cpu", options.cpu, "--quiet"],
                      timeout=10 * seconds)
    try:
        told = json.loads(done.stdout)
    except ValueError:
        raise Failed(f"compare ended with {done.returncode}: {done.stderr.strip()}") from None
    all_chains = [row for row in told["rows"] if row["measure"].startswith("miss")]
    return {"against": others, "seed": seed, "finds_difference": told["finds_difference"],
            "found": [f"{row['of']}: {row['measure']}" for row in told["rows"] if row["is_found"]],
            "misses": {row["of"]: {"value": row["value"], "interval": row["interval"]}
                       for row in all_chains if "value" in row}}


def is_better(run):
    """@returns whether scheduling was found to miss fewer frames, in the mean over the chains"""
    return run["finds_difference"] and run["misses"]["all chains"]["interval"][1] < 0


def profile(bench, options):
    """As a user would: scheduling goes by it."""
    done = bench.call([bench.urgengo, "profile", "-q", *bench.driver, "-c", "chains.yaml",
                       "--source", "marks", "--", bench.chains, "run", "--f-a", "0.6", "--seconds",
                       "8", "--cpu", options.cpu, "--quiet"], timeout=120)
    if done.returncode != 0:
        raise Failed("profile: " + done.stderr.strip())


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", default="build/release")
    parser.add_argument("--runs", type=int, default=20, help="of observe with observe")
    parser.add_argument("--enforce-runs", type=int, default=3, help="of observe with scheduling")
    parser.add_argument("--block-s", type=float, default=1.5)
    parser.add_argument("--blocks", type=int, default=14)
    parser.add_argument("--enforce-blocks", type=int, default=30)
    parser.add_argument("--f-a", type=float, default=0.9)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--cpu", default="auto", choices=("auto", "spin", "sleep"))
    parser.add_argument("--simulated", action="store_true", help="on the simulated GPU")
    parser.add_argument("--commit", default="")
    parser.add_argument("--out", type=pathlib.Path)
    options = parser.parse_args()
    runs, wrong = [], ""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        bench = Bench(options, pathlib.Path(folder))
        try:
            bench.prepare()
            profile(bench, options)
            for against, count in (("observe", options.runs), ("on", options.enforce_runs)):
                for i in range(count):
                    runs.append(compare(bench, options, against, options.first_seed + i))
                    print(f"{against} {i + 1} of {count}: {runs[-1]['found']}", file=sys.stderr)
        except (Failed, OSError) as error:
            wrong = str(error)
    same = [run for run in runs if run["against"] == "observe"]
    other = [run for run in runs if run["against"] == "on"]
    result = {**result_file.where_and_when("compare_check.py", options.build, options.commit),
              "simulated": options.simulated, "cores": os.cpu_count(), "wrong": wrong,
              "found_where_there_is_none": sum(run["finds_difference"] for run in same),
              "of": len(same), "scheduling_found_better": sum(map(is_better, other)),
              "of_scheduling": len(other), "runs": runs}
    print(json.dumps({key: result[key] for key in (
        "wrong", "found_where_there_is_none", "of", "scheduling_found_better", "of_scheduling")}))
    if options.out:
        result_file.write(options.out, result)
    is_good = (not wrong and 20 * result["found_where_there_is_none"] <= 3 * len(same)
               and result["scheduling_found_better"] == len(other))
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())
