#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A profile in a third of its size: kernels in columns, their names shortened.

  tools/sim/compact_profile.py chains.profile.json > tools/sim/data/mix.profile.json

`urgengo sim --profile` reads both (tools/urgengo/sim_workload.cpp). What the simulation does not read
(sizes, samples) is left out. Kernels that had one name still have one, and others have others.
"""
import json
import sys

NAME_LENGTH = 14
COLUMNS = ("name", "grid_blocks", "block_threads", "gpu_time_ns", "utilization", "launch_ns")
DIGITS = 5


def short(name, names):
    """@returns the name's end that tells most, and a number of its own"""
    if name not in names:
        words = name.replace("_ZN", "").lstrip("_0123456789")
        names[name] = f"{words[:NAME_LENGTH]}.{len(names)}"
    return names[name]


def compact(profile):
    names = {}
    for chain in profile["chains"]:
        for task in chain["tasks"]:
            kernels = task["kernels"]
            for kernel in kernels:
                kernel["name"] = short(kernel["name"], names)
                kernel["utilization"] = float(f"{kernel['utilization']:.{DIGITS}g}")
            columns = COLUMNS + (("stream",) if any(k.get("stream") for k in kernels) else ())
            task["kernels"] = {key: [kernel.get(key, 0) for kernel in kernels] for key in columns}
            task.pop("sizes", None)
    return profile


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    with open(sys.argv[1], encoding="utf-8") as file:
        profile = compact(json.load(file))
    text = json.dumps(profile, separators=(",", ":"))
    print(text.replace('"name":["', '\n"name":["').replace("],", "],\n"))


if __name__ == "__main__":
    main()
