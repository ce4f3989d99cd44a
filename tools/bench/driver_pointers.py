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


class Part(ctypes.Structure):
    """struct iovec"""
    _fields_ = [("begin", ctypes.c_void_p), ("num_bytes", ctypes.c_size_t)]


class Places:
    """Words of this process's memory, read and written all at once by the kernel: thousands of them
    one by one would take as long as what is to be measured, and its caches."""

    MOST_PARTS = 1024  # of a call

    def __init__(self, places):
        self.libc = ctypes.CDLL(None, use_errno=True)
        self.num_words = len(places)
        parts = []
        for place in sorted(places):
            if parts and parts[-1][0] + parts[-1][1] == place:
                parts[-1][1] += 8
            else:
                parts.append([place, 8])
        self.calls = []  # offset of its words in bytes, their number of bytes, parts
        offset = 0
        for first in range(0, len(parts), self.MOST_PARTS):
            its = parts[first:first + self.MOST_PARTS]
            num_bytes = sum(size for _, size in its)
            self.calls.append((offset, num_bytes, (Part * len(its))(*(Part(*one) for one in its))))
            offset += num_bytes

    def transfer(self, call, words):
        for offset, num_bytes, parts in self.calls:
            ours = Part(ctypes.addressof(words) + offset, num_bytes)
            done = call(os.getpid(), ctypes.byref(ours), ctypes.c_ulong(1), parts,
                        ctypes.c_ulong(len(parts)), ctypes.c_ulong(0))
            if done != num_bytes:
                raise OSError(ctypes.get_errno(), "a library's data is gone, or not to be changed")

    def read(self):
        words = (ctypes.c_uint64 * self.num_words)()
        self.transfer(self.libc.process_vm_readv, words)
        return words

    def write(self, words):
        self.transfer(self.libc.process_vm_writev, words)


class DriverPointers:
    """Those of the libraries that are loaded now, and have been used: the driver is there then.

    @raises NotHere
    """

    def __init__(self, driver=None):
        ours, driver = find_libraries(driver)
        self.driver_of = entry_points(ours, driver)
        with open("/proc/self/mem", "rb", buffering=0) as memory:
            # What changes by itself is no such pointer.
            self.take(dict(set(self.find(memory, ours, driver)) &
                           set(self.find(memory, ours, driver))))

    def find(self, memory, ours, driver):
        low, high = min(self.driver_of), max(self.driver_of)
        for begin, end in library_data(ours, driver):
            for place in range(begin, end, CHUNK):
                words = array.array("Q", os.pread(memory.fileno(), min(CHUNK, end - place), place))
                for i, word in enumerate(words):
                    if low <= word <= high and word in self.driver_of:
                        yield place + 8 * i, word

    def take(self, where):
        self.where = where
        self.places = Places(where)
        through = [where[place] for place in sorted(where)]
        words = ctypes.c_uint64 * len(where)
        self.words = (words(*through), words(*(self.driver_of[ours] for ours in through)))
        self.goes_directly = False

    def go(self, directly):
        """Has all of them go to the driver, or through UrgenGo again. One that another library has
        changed is let alone from then on. Not while others call it.
        @returns how many there are"""
        now = self.places.read()
        if bytes(now) != bytes(self.words[self.goes_directly]):
            expected, goes_directly = self.words[self.goes_directly], self.goes_directly
            kept = [place for place, word, its in zip(sorted(self.where), now, expected)
                    if word == its]
            self.take({place: self.where[place] for place in kept})
            self.goes_directly = goes_directly
        if directly != self.goes_directly:
            self.places.write(self.words[directly])
            self.goes_directly = directly
        return len(self.where)
