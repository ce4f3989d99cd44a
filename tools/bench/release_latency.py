#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How long after more urgent work has ended does work that waited for it begin?

release_latency.cu, compiled here, in processes of its own: bare, where the GPU's own queue decides,
and under UrgenGo with launches that wait in their threads, or behind gates that the host or the GPU
opens (dispatch). One profile for all rows.

With --blocking another question: how long does an urgent kernel wait that is released while a less
urgent thread has 16 kernels of 0.3 ms, each of which fills the GPU, to launch? From before its launch
to its thread's knowing that it has executed, less what it executed for. The rows `alone` (bare) and
`alone_thread` (under UrgenGo) are those of a program without that thread: what launching and waiting
take by themselves.

  tools/bench/release_latency.py --build build/release --out result.json
  tools/bench/release_latency.py --blocking --out blocking.json
  tools/bench/release_latency.py --busy 32                   # beside so many endless loops

Exit status 0 if all rows ran, 1 if not, 77 (skipped) without nvcc or a GPU.
"""
import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests/gpu"))
sys.path.insert(0, str(HERE))
import build_math_libraries  # noqa: E402
import equality  # noqa: E402
import result_file  # noqa: E402
from dispatch_ways import dispatch_key  # noqa: E402

ALONE_ROWS = ("alone", "alone_thread")
ROWS = ("bare", "thread", "host", "piggyback", "leased", "armed")
CONFIG = """version: 1
mode: enforce
scheduler: {{guard: off{dispatch}}}
chains:
  - name: urgent
    period_ms: 8
    deadline_ms: 4
    tasks: [{{name: urgent, thread: urgent}}]
  - name: loose
    period_ms: 8
    deadline_ms: 8
    tasks: [{{name: loose, thread: loose}}]
"""
PROFILE_ROUNDS, TIMEOUT_S = 100, 60


def config_of(row):
    return CONFIG.format(dispatch=dispatch_key(row))


class Rows:
    def __init__(self, options, folder):
        self.options, self.folder = options, folder
        self.program = str(folder / "release_latency")
        self.urgengo = str(pathlib.Path(options.build, "bin/urgengo").resolve())
        self.profile = folder / "profile.json"

    def config(self, row):
        path = self.folder / "chains.yaml"
        path.write_text(config_of(row))
        return str(path)

    def learn(self):
        subprocess.run([self.urgengo, "profile", "-c", self.config("thread"), "-o",
                        str(self.profile), "--", self.program, str(PROFILE_ROUNDS),
                        *self.words("blocking")], check=True,
                       timeout=TIMEOUT_S, stdout=subprocess.DEVNULL)

    def words(self, what):
        return [what] if self.options.blocking else []

    def run(self, row):
        stats, command = self.folder / "stats.json", [self.program, str(self.options.rounds)]
        command += self.words("alone" if row in ALONE_ROWS else "blocking")
        stats.unlink(missing_ok=True)
        if row not in ("bare", "alone"):
            command = [self.urgengo, "run", "-c", self.config(row), "--quiet", "--profile",
                       str(self.profile), "--stats", str(stats), "--", *command]
        done = subprocess.run(command, text=True, capture_output=True, timeout=TIMEOUT_S,
                              check=False)
        its = sorted(int(word) / 1000 for word in done.stdout.split() if word.isdigit())
        if done.returncode != 0 or len(its) < 2:
            print(f"{row}: exit status {done.returncode}, {len(its)} latencies\n"
                  f"{done.stdout[-500:]}{done.stderr}")
            return None
        quantiles = statistics.quantiles(its, n=100, method="inclusive")
        known = json.loads(stats.read_text()) if stats.exists() else {}
        found = {"rounds": len(its), "p50_us": round(quantiles[49], 1),
                 "p99_us": round(quantiles[98], 1), "gates": known.get("gates"),
                 "holds": {one["name"]: one["holds"] for one in known.get("chains", [])},
                 "marks": {one["name"]: one["marks"] for one in known.get("chains", [])},
                 "latencies_us": its}
        print(f"{row:12} p50 {found['p50_us']:8.1f} us  p99 {found['p99_us']:8.1f}  of {len(its)}"
              f"  holds {found['holds']} marks {found['marks']} gates {found['gates']}", flush=True)
        return found


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=pathlib.Path("build/release"),
                        help="folder with bin/urgengo and lib/urgengo [build/release]")
    parser.add_argument("--rows", help=f"of {','.join(ROWS)}, and with --blocking "
                                       f"{','.join(ALONE_ROWS)} [all]")
    parser.add_argument("--blocking", action="store_true",
                        help="what is in the way of an urgent kernel that is released")
    parser.add_argument("--rounds", type=int, default=300, help="of a row, 8 ms each [300]")
    parser.add_argument("--busy", type=int, default=0, help="endless loops beside it [0]")
    parser.add_argument("--out", type=pathlib.Path, help="write all numbers to this JSON file")
    parser.add_argument("--commit", help="that was built, for the JSON file")
    options = parser.parse_args()
    accepted = (*ALONE_ROWS, *ROWS) if options.blocking else ROWS
    wanted = options.rows.split(",") if options.rows else accepted
    unknown = set(wanted) - set(accepted)
    if unknown:
        parser.error(f"--rows: found '{min(unknown)}', accepted: {', '.join(accepted)}")
    equality.skip_if(equality.why_not_here([]))
    equality.skip_if("" if build_math_libraries.nvcc() else "no nvcc")
    with tempfile.TemporaryDirectory() as folder:
        rows = Rows(options, pathlib.Path(folder))
        build_math_libraries.compile_with_nvcc(
            [str(HERE / "release_latency.cu"), "-o", rows.program])
        rows.learn()
        loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"])
                 for _ in range(options.busy)]
        try:
            found = {row: rows.run(row) for row in wanted}
        finally:
            for loop in loops:
                loop.kill()
    if options.out:
        result_file.write(options.out, {
            **result_file.where_and_when("tools/bench/release_latency.py", options.build,
                                         options.commit), "busy": options.busy,
            "blocking": options.blocking, "rows": found})
    return 0 if all(found.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
