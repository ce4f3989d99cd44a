# SPDX-License-Identifier: Apache-2.0
"""What every result says about the machine and the command, and how it is written."""
import json
import pathlib
import subprocess
import sys
import time

REAL_LIBRARY = "URGENGO_REAL_LIBCUDA"  # which driver there is: no setting of the scheduler


def without_urgengo(environment):
    return {name: value for name, value in environment.items()
            if not name.startswith("URGENGO_") or name == REAL_LIBRARY}


def first_line_of(command):
    try:
        lines = subprocess.run(command, text=True, capture_output=True).stdout.splitlines()
    except OSError:
        return ""
    return lines[0].strip() if lines else ""


def utc_now():
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())


def where_and_when(script, build, commit=""):
    """@returns the head of a result; the GPU is the program's to say"""
    return {"format_version": 1, "program": script,
            "gpu": first_line_of(["nvidia-smi", "--query-gpu=name", "--format=csv,noheader"]),
            "driver": first_line_of(["nvidia-smi", "--query-gpu=driver_version",
                                     "--format=csv,noheader"]),
            "urgengo": first_line_of([str(pathlib.Path(build) / "bin/urgengo"), "--version"]),
            "commit": commit, "date_utc": utc_now(),
            "command_line": " ".join([script] + [pathlib.Path(a).name if a.startswith("/") else a
                                                 for a in sys.argv[1:]])}


def write(path, content):
    """Whole or not at all."""
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(json.dumps(content, indent=1) + "\n")
    temporary.replace(path)
