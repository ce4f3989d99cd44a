# SPDX-License-Identifier: Apache-2.0
"""The pointers to the driver that libraries of this process keep: to UrgenGo, or past it.

A process with UrgenGo differs from one without it in more than in what UrgenGo executes: its
libraries lie elsewhere, and that alone is worth a per cent (an empty library that is preloaded
shows it). So what UrgenGo executes is measured in one process: with its libraries' pointers to
entry points of the driver as they are, and with the same pointers changed to the driver's own
functions. Only for a benchmark that knows what its process does meanwhile.

Where they are: in the writable data of loaded libraries, as the CUDA runtime, cuDNN and cuBLAS keep
them. Pointers on the heap are left as they are and go through UrgenGo, which its statistics show.
"""
import array
import ctypes
import mmap
import os
import pathlib
import re
import struct

DRIVER_FILE = re.compile(r"/libcuda\.so\.\d+\.\d+")
NAME = re.compile(rb"\0(cu[A-Z]\w+)(?=\0)")
CHUNK = 16 << 20
PT_LOAD, PF_W = 1, 2  # elf.h


class NotHere(Exception):
    """This process is not one with UrgenGo and a driver below it."""


def mappings():
    """@returns of each mapping of this process: begin, end, rights, file"""
    found = []
    for line in pathlib.Path("/proc/self/maps").read_text().splitlines():
        place, rights, _, _, _, *file = line.split(maxsplit=5)
        begin, end = (int(part, 16) for part in place.split("-"))
        found.append((begin, end, rights, file[0] if file else ""))
    return found


def find_libraries(driver=None):
    """@param driver: the driver's file; found by its name if not given
    @returns the files of UrgenGo and of the driver, as they are mapped"""
    files = {file for *_, file in mappings()}
    drivers = [f for f in files if (f == driver if driver else DRIVER_FILE.search(f))]
    ours = [f for f in files if f.endswith("/libcuda.so.1") and f not in drivers]
    if len(ours) != 1 or len(drivers) != 1:
        raise NotHere(f"found UrgenGo as {ours} and the driver as {drivers}, accepted: one of each")
    return ours[0], drivers[0]


def range_of(file):
    its = [(begin, end) for begin, end, _, name in mappings() if name == file]
    return min(begin for begin, _ in its), max(end for _, end in its)


def entry_points(ours, driver):
    """@returns the driver's function by the address of UrgenGo's of the same name"""
    libraries = [ctypes.CDLL(file) for file in (ours, driver)]
    ranges = [range_of(file) for file in (ours, driver)]
    found = {}
    for name in set(NAME.findall(pathlib.Path(ours).read_bytes())):
        try:
            pair = [ctypes.cast(library[name.decode()], ctypes.c_void_p).value
                    for library in libraries]
        except AttributeError:
            continue  # not exported by both
        if all(begin <= address < end for address, (begin, end) in zip(pair, ranges)):
            found[pair[0]] = pair[1]
    return found


def data_segments(file):
    """@returns begin and end of what an ELF file of 64 bits has loaded writable, from where its
    first segment begins"""
    with open(file, "rb") as library:
        if library.read(5) != b"\x7fELF\x02":
            return []
        library.seek(32)
        table, = struct.unpack("<Q", library.read(8))
        library.seek(54)
        entry_bytes, num_entries = struct.unpack("<HH", library.read(4))
        library.seek(table)
        segments = [struct.unpack_from("<IIQQQQQ", library.read(entry_bytes))
                    for _ in range(num_entries)]
    loaded = [(flags, begin, num_bytes) for kind, flags, _, begin, _, _, num_bytes in segments
              if kind == PT_LOAD]
    first = loaded[0][1] // mmap.PAGESIZE * mmap.PAGESIZE
    return [(begin - first, begin - first + num_bytes) for flags, begin, num_bytes in loaded
            if flags & PF_W]


def library_data(ours, driver):
    """@returns begin and end of the writable data of all other libraries, whole words"""
    its = mappings()
    base = {}
    for begin, _, _, file in its:
        if file.startswith("/") and ".so" in file and file not in (ours, driver):
            base.setdefault(file, begin)
    writable = [(begin, end) for begin, end, rights, _ in its if rights.startswith("rw")]
    found = []
    for file, first in base.items():
        for data_begin, data_end in data_segments(file):
            for begin, end in writable:
                begin, end = max(begin, first + data_begin), min(end, first + data_end)
                begin, end = (begin + 7) // 8 * 8, end // 8 * 8
                if begin < end:
                    found.append((begin, end))
    return found


class DriverPointers:
    """Those of the libraries that are loaded now, and have been used: the driver is there then.

    @raises NotHere
    """

    def __init__(self, driver=None):
        ours, driver = find_libraries(driver)
        self.driver_of = entry_points(ours, driver)
        self.memory = os.open("/proc/self/mem", os.O_RDWR)
        # What changes by itself is no such pointer.
        self.where = dict(set(self.find(ours, driver)) & set(self.find(ours, driver)))

    def find(self, ours, driver):
        low, high = min(self.driver_of), max(self.driver_of)
        for begin, end in library_data(ours, driver):
            for place in range(begin, end, CHUNK):
                words = array.array("Q", os.pread(self.memory, min(CHUNK, end - place), place))
                for i, word in enumerate(words):
                    if low <= word <= high and word in self.driver_of:
                        yield place + 8 * i, word

    def go(self, directly):
        """Has all of them go to the driver, or through UrgenGo again. Not while others call it.
        @returns how many were changed: all, unless they had been changed by somebody else"""
        num_changed = 0
        for place, ours in self.where.items():
            pointer = ctypes.c_uint64.from_address(place)
            expected = (ours, self.driver_of[ours])
            if pointer.value in expected:
                pointer.value = expected[directly]
                num_changed += 1
        return num_changed
