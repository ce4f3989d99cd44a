# SPDX-License-Identifier: Apache-2.0
"""Reads what `urgengo-chains run --stamps` writes (tools/chains/stamps_file.h)."""
import json
import struct
import typing

ANSWERED, BUSY, OVERDUE = 1, 2, 4


class Run(typing.NamedTuple):
    """Of a task, on a stream."""
    task: int
    frame: int
    first_launch: int
    num_launches: int


class Sample(typing.NamedTuple):
    """What ug_position() answered, and when: host time."""
    before_ns: int
    took_ns: int
    stream: int
    flags: int
    run: int
    launch: int
    instance: int
    reserved: int
    remaining_ns: int
    unexecuted_ns: int
    uncertain_ns: int


class Stream(typing.NamedTuple):
    chain: str
    tasks: list
    launches: int
    lost: int
    stamps: list  # (begin, end) of every launch, nanoseconds of the GPU's clock
    runs: list


class Clock:
    """The GPU's clock on the host's, between two readings."""

    def __init__(self, readings):
        first, last = readings[0], readings[-1]
        self.gpu_ns, self.host_ns = first["gpu_ns"], first["host_ns"]
        passed = last["gpu_ns"] - first["gpu_ns"]
        self.pace = (last["host_ns"] - first["host_ns"]) / passed if passed else 1.0
        self.bound_ns = max(reading["bound_ns"] for reading in readings)
        self.round_trips = min(reading["round_trips"] for reading in readings)

    def to_host(self, gpu_ns):
        return self.host_ns + (gpu_ns - self.gpu_ns) * self.pace

    @property
    def drift_ppm(self):
        return (self.pace - 1) * 1e6


class StampsFile:
    def __init__(self, path):
        with open(path, "rb") as file:
            self.header = json.loads(file.readline())
            data = file.read()
        if self.header.get("format_version") != 1:
            raise ValueError(f"{path}: found format_version {self.header.get('format_version')}, "
                             "accepted: 1")
        arrays, offset = [], 0
        for array in self.header["arrays"]:
            size = array["count"] * array["bytes"]
            part = data[offset:offset + size]
            if len(part) != size or struct.calcsize("=" + array["fields"]) != array["bytes"]:
                raise ValueError(f"{path}: found {len(data)} bytes of arrays, which is not what "
                                 "its first line says")
            arrays.append(list(struct.iter_unpack("=" + array["fields"], part)))
            offset += size
        self.clock = Clock(self.header["clock"])
        self.samples = [Sample(*sample) for sample in arrays.pop()]
        self.streams = [Stream(**stream, stamps=stamps, runs=[Run(*run) for run in runs])
                        for stream, stamps, runs in zip(self.header["streams"], arrays[::2],
                                                        arrays[1::2])]

    def resolution_ns(self):
        """@returns the least distance between two different begins of the GPU's clock"""
        times = sorted({t for stream in self.streams for stamp in stream.stamps for t in stamp})
        return min((b - a for a, b in zip(times, times[1:])), default=0)
