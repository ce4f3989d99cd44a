# SPDX-License-Identifier: Apache-2.0
"""CUPTI's records of a program's kernels: builds the library that writes them down
(cupti_kernels.cpp, with g++), and reads what it wrote."""
import collections
import glob
import os
import pathlib
import subprocess
import sysconfig
import typing

HERE = pathlib.Path(__file__).resolve().parent
CHAINS_KERNELS = ("chains_comp", "chains_mem")


class Kernel(typing.NamedTuple):
    """Times of CUPTI's clock."""
    stream: int
    correlation: int
    begin_ns: int
    end_ns: int
    name: str


class Records(typing.NamedTuple):
    kernels: list
    launches: dict  # by correlation: (thread, ns of CLOCK_MONOTONIC)
    threads: dict   # names
    clocks: list    # (CUPTI's, CLOCK_MONOTONIC), ns, as time goes on
    dropped: int

    def to_monotonic(self, cupti_ns):
        """By the first and the last reading of both clocks."""
        (first, ours), (last, last_ours) = self.clocks[0], self.clocks[-1]
        pace = (last_ours - ours) / (last - first) if last != first else 1.0
        return ours + (cupti_ns - first) * pace


def read_records(path):
    kernels, launches, threads, clocks, counts = [], {}, {}, [], collections.Counter()
    with open(path) as file:
        for line in file:
            kind, rest = line.rstrip("\n").split(" ", 1)
            if kind == "kernel":
                *numbers, name = rest.split(" ", 4)
                kernels.append(Kernel(*map(int, numbers), name))
            elif kind == "launch":
                correlation, thread, time_ns = map(int, rest.split())
                launches[correlation] = (thread, time_ns)
            elif kind == "thread":
                thread, name = rest.split(" ", 1)
                threads[int(thread)] = name
            elif kind == "clock":
                clocks.append(tuple(map(int, rest.split())))
            elif kind == "dropped":
                counts[kind] += int(rest)
            else:
                raise ValueError(f"{path}: found a line of {kind!r}")
    return Records(kernels, launches, threads, sorted(clocks), counts["dropped"])


def roots():
    """Where a toolkit or the packages of pip may be."""
    packages = sysconfig.get_paths()["purelib"]
    return [*filter(None, (os.environ.get("CUDA_HOME"), os.environ.get("CUDA_PATH"))),
            *sorted(glob.glob("/usr/local/cuda*"), reverse=True),
            *sorted(glob.glob(packages + "/nvidia/*"), reverse=True),
            *glob.glob(packages + "/triton/backends/nvidia")]


def first_with(file):
    for root in roots():
        for folder in ("include", "extras/CUPTI/include", "lib64", "lib", "extras/CUPTI/lib64"):
            found = sorted(glob.glob(os.path.join(root, folder, file)))
            if found:
                return pathlib.Path(found[0])
    return None


def build(folder, library=None):
    """@param library  instead of the toolkit's libcupti
    @returns its path; or what is missing"""
    cupti_h, cuda_h = first_with("cupti.h"), first_with("cuda.h")
    library = library or first_with("libcupti.so.1[0-9]*") or first_with("libcupti.so*")
    if not cupti_h or not cuda_h or not library:
        return None, "no CUPTI: no " + ", ".join(
            name for name, found in (("cupti.h", cupti_h), ("cuda.h", cuda_h),
                                     ("libcupti.so", library)) if not found)
    built = pathlib.Path(folder, "libcupti_kernels.so")
    command = ["g++", "-shared", "-fPIC", "-O2", "-std=c++17", f"-I{cupti_h.parent}",
               f"-I{cuda_h.parent}", str(HERE / "cupti_kernels.cpp"), "-o", str(built),
               str(library), f"-Wl,-rpath,{library.parent}"]
    try:
        done = subprocess.run(command, text=True, capture_output=True)
    except OSError as error:
        return None, f"no compiler: {error}"
    return (built, "") if done.returncode == 0 else (None, f"g++: {done.stderr[-1000:]}")
