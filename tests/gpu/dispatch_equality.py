#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Host and GPU open the same gates: compiles dispatch_equality.cu here and runs it.

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


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", help="not used: the dispatcher is compiled, too")
    parser.add_argument("--snapshots", default="1000000", metavar="N")
    parser.add_argument("--seed", default="1", metavar="N")
    options = parser.parse_args()
    equality.skip_if(equality.why_not_here([]))
    equality.skip_if("" if build_math_libraries.nvcc() else "no nvcc")
    with tempfile.TemporaryDirectory() as folder:
        program = pathlib.Path(folder, "dispatch_equality")
        # The host's compiler must not fuse what the GPU's does not.
        build_math_libraries.compile_with_nvcc(
            ["-std=c++20", "-O2", "--expt-relaxed-constexpr", "-fmad=false", "-Xcompiler",
             "-ffp-contract=off", f"-I{ROOT}", f"-I{ROOT}/include",
             f"{ROOT}/tests/gpu/dispatch_equality.cu", f"{ROOT}/host/sched/dispatch_round.cpp",
             "-o", str(program)])
        command = [str(program), options.snapshots, options.seed]
        sys.exit(subprocess.run(command, check=False).returncode)


if __name__ == "__main__":
    main()
