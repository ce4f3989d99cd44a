#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""When does a small kernel begin beside one that is on every multiprocessor?

A multiprocessor is configured for the shared memory of the kernels that it runs, by how many of their
blocks it could hold, and changes that only while it runs none. So a small kernel may have to wait
until the other one ends, although there are threads and registers for it. Small kernels are
UrgenGo's: a mark with 1, 32, 64, 128, 256 threads, the mark before a gate with 32 and 256, and one
with 6 KB of shared memory, as the dispatcher's kernels had. Beside each of some shapes of blocks:
median of --rounds, us until the host sees that it ran; the other kernel takes 1500 us in all, of
which 200 have passed.

And what a mark takes of its stream, by its threads.

  tools/bench/mark_room.py --out mark_room.json

Exit status 0 if no mark waits for the other kernel's end, but those of fewer than 256 threads beside
blocks of 512 and more without shared memory (host/exec/mark_width.h), 1 if one does, 77 (skipped)
without nvcc or a GPU.
"""
import argparse
import ctypes
import pathlib
import statistics
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT / "tests/gpu"))
sys.path.insert(0, str(HERE))
import build_math_libraries  # noqa: E402
import equality  # noqa: E402
import result_file  # noqa: E402

MARK, GATE_MARK, WITH_SHARED = range(3)
SMALL = {"mark, 1": (MARK, 1), "32": (MARK, 32), "64": (MARK, 64), "128": (MARK, 128),
         "256": (MARK, 256), "before a gate, 32": (GATE_MARK, 32), "256 ": (GATE_MARK, 256),
         "6 KB, 32": (WITH_SHARED, 32)}
# threads of a block, blocks on a multiprocessor, KB of shared memory of a block
BESIDE = ((64, 1, 0), (128, 1, 0), (256, 1, 0), (256, 4, 0), (384, 1, 0), (512, 1, 0), (768, 1, 0),
          (1024, 1, 0), (512, 1, 4), (256, 1, 16), (512, 1, 48), (256, 1, 100), (256, 1, 164))
WAITS_US = 900  # what is left of the other kernel, less what a host may be late
WIDE, IN_THE_WAY, KERNELS, CHAIN_ROUNDS = 256, 512, 400, 9


class Failed(Exception):
    pass


class Gpu:
    def __init__(self, folder):
        library = folder / "libmr.so"
        build_math_libraries.compile_with_nvcc(
            ["-std=c++20", "-O2", "--expt-relaxed-constexpr", "-fmad=false", f"-I{ROOT}",
             f"-I{ROOT}/include", "-shared", "-Xcompiler", "-fPIC", str(HERE / "mark_room.cu"),
             "-o", str(library)])
        self.library = ctypes.CDLL(str(library))
        self.must("mr_begin")

    def must(self, name, *arguments):
        error = getattr(self.library, name)(*arguments)
        if error != 0:
            raise Failed(f"{name} answers CUDA error {error}")

    def us(self, name, *arguments):
        found = ctypes.c_double()
        self.must(name, *arguments, ctypes.byref(found))
        return found.value


def waits(gpu, rounds):
    """@returns rows: the shape beside, and us of each small kernel"""
    rows = []
    print(f"{'beside':18}" + "".join(f"{name:>19}" for name in SMALL))
    for threads, blocks, shared_kb in BESIDE:
        its = {name: round(statistics.median(
            gpu.us("mr_wait", threads, blocks, shared_kb << 10, kind, small)
            for _ in range(rounds)), 1) for name, (kind, small) in SMALL.items()}
        rows.append({"threads": threads, "blocks": blocks, "shared_kb": shared_kb, "us": its})
        print(f"{threads:4} x{blocks}, {shared_kb:3} KB    " +
              "".join(f"{us:19.0f}" for us in its.values()), flush=True)
    return rows


def costs(gpu):
    """@returns us of a stream that a mark takes, by its threads"""
    samples = {threads: [] for threads in (0, 1, 32, 128, 256)}
    for _ in range(CHAIN_ROUNDS):
        for threads, its in samples.items():
            its.append(gpu.us("mr_chain", KERNELS, threads) / KERNELS)
    bare = statistics.median(samples.pop(0))
    found = {threads: round(statistics.median(its) - bare, 3) for threads, its in samples.items()}
    print("a mark takes of its stream, us: " +
          ", ".join(f"{us} with {threads} threads" for threads, us in found.items()))
    return found


def wrong_in(rows):
    return [f"a mark ({name.strip()}) waits beside blocks of {row['threads']}"
            for row in rows for name, (kind, small) in SMALL.items()
            if kind != WITH_SHARED and row["us"][name] > WAITS_US and
            not (small < WIDE and row["threads"] >= IN_THE_WAY and row["shared_kb"] == 0)]


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="of each pair [5]")
    parser.add_argument("--out", type=pathlib.Path, help="write all numbers to this JSON file")
    parser.add_argument("--commit", default="", help="for the JSON file")
    options = parser.parse_args()
    equality.skip_if(equality.why_not_here([]))
    equality.skip_if("" if build_math_libraries.nvcc() else "no nvcc")
    with tempfile.TemporaryDirectory() as folder:
        try:
            gpu = Gpu(pathlib.Path(folder))
            rows, its_costs = waits(gpu, options.rounds), costs(gpu)
        except Failed as error:
            sys.exit(str(error))
    wrong = wrong_in(rows)
    for line in wrong:
        print(f"FAILURE: {line}")
    if options.out:
        result_file.write(options.out, {
            **result_file.where_and_when("tools/bench/mark_room.py", "", options.commit),
            "rows": rows, "mark_us": its_costs, "wrong": wrong})
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
