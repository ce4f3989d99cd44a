#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""cuBLAS, cuBLASLt, cuFFT and cuDNN called from C++: with either copy of cudart, and with both.

Compiles math_libraries.cu here, with this machine's nvcc: `static` and `shared` say which cudart
the program has, `two copies` that a library loaded late brings the other one.
"""
import argparse
import pathlib
import sys
import tempfile

import build_math_libraries
import equality


def variants(folder):
    """@yields name, command, libraries that are not here"""
    for runtime in ("static", "shared"):
        program, missing = build_math_libraries.build(folder, runtime)
        yield f"{runtime} cudart", [str(program)], missing
        if runtime == "static":
            helper = build_math_libraries.build_second_runtime(folder, runtime)
            yield "two copies of cudart", [str(program), "--second-runtime", str(helper)], missing


def why_not_here():
    return "" if build_math_libraries.nvcc() else "no nvcc"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    equality.add_options(parser)
    args = parser.parse_args()
    equality.skip_if(equality.why_not_here([]) or why_not_here())
    build = equality.check_build(args.build)
    reports, failures = {}, []
    # Its sums' order depends on the workspace.
    environment = {"CUBLAS_WORKSPACE_CONFIG": ":4096:8"}
    with tempfile.TemporaryDirectory() as folder:
        for name, command, missing in variants(pathlib.Path(folder)):
            print(f"-- {name}" + (f"; not here: {', '.join(missing)}" if missing else ""))
            try:
                results, wrong = equality.compare(equality.chosen_rows(args.rows), command,
                                                  environment, equality.CHAIN_THREAD, build,
                                                  dispatch=args.dispatch)
            except SystemExit as failed:  # the program's exit status; the other variants count
                failures.append(f"{name}: {failed}")
                continue
            reports[name] = {"not_here": missing, **equality.report(results, wrong)}
            if wrong:
                failures.append(f"{name}: {wrong}")
    if args.out:
        equality.write_json(args.out, {
            **equality.where_and_when("tests/gpu/math_libraries_equality.py", build, args.commit),
            "environment": environment, "variants": reports})
    sys.exit("\n".join(failures) or 0)


if __name__ == "__main__":
    main()
