#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Host and GPU open the same gates: compiles dispatch_equality.cu, dispatch_armed.cu and
dispatch_lease.cu here and runs them.

Exit status 0 if they do, 1 if not, 77 (skipped) without nvcc or a GPU.
"""
import argparse
import pathlib
import subprocess
import sys
import tempfile

import build_math_libraries
import equality

ROOT = pathlib.Path(__file__).resolve().parents[2]


def run(name, arguments):
    with tempfile.TemporaryDirectory() as folder:
        program = pathlib.Path(folder, name)
        # The host's compiler must not fuse what the GPU's does not.
        build_math_libraries.compile_with_nvcc(
            ["-std=c++20", "-O2", "--expt-relaxed-constexpr", "-fmad=false", "-Xcompiler",
             "-ffp-contract=off", f"-I{ROOT}", f"-I{ROOT}/include",
             f"{ROOT}/tests/gpu/{name}.cu", f"{ROOT}/host/sched/dispatch_round.cpp",
             f"{ROOT}/host/sched/urgent_threshold.cpp",
             "-o", str(program)])
        return subprocess.run([str(program), *arguments], check=False).returncode


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", help="not used: the dispatcher is compiled, too")
    parser.add_argument("--snapshots", default="1000000", metavar="N", help="[1000000]")
    parser.add_argument("--armed-snapshots", default="20000", metavar="N",
                        help="decided by arms that marks wake [20000]")
    parser.add_argument("--bursts", default="5000", metavar="N",
                        help="of marks that wake arms [5000]")
    parser.add_argument("--seed", default="1", metavar="N", help="[1]")
    options = parser.parse_args()
    equality.skip_if(equality.why_not_here([]))
    equality.skip_if("" if build_math_libraries.nvcc() else "no nvcc")
    statuses = [run("dispatch_equality", [options.snapshots, options.seed]),
                run("dispatch_armed", [options.armed_snapshots, options.bursts, options.seed]),
                run("dispatch_lease", [])]
    sys.exit(max(statuses))


if __name__ == "__main__":
    main()
