#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Marks that may start early keep their stream's order: compiles mark_order.cu here and runs it.

Exit status 0 if they do, 1 if not, 77 (skipped) without nvcc or a GPU that can launch so.
"""
import argparse
import pathlib
import subprocess
import sys
import tempfile

import build_math_libraries
import equality

HERE = pathlib.Path(__file__).resolve().parent


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", help="not used: the mark is compiled, too")
    parser.parse_args()
    equality.skip_if(equality.why_not_here([]))
    equality.skip_if("" if build_math_libraries.nvcc() else "no nvcc")
    with tempfile.TemporaryDirectory() as folder:
        program = pathlib.Path(folder, "mark_order")
        build_math_libraries.compile_with_nvcc(
            [f"-I{HERE.parents[1]}", str(HERE / "mark_order.cu"), "-o", str(program)])
        sys.exit(subprocess.run([str(program)], check=False).returncode)


if __name__ == "__main__":
    main()
