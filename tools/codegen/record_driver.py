#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Records what a libcuda.so.1 answers to those who ask it for entry points, or compares with it.

Three doors lead to a driver: the linker and dlsym (exported names), cuGetProcAddress, and
cuGetProcAddress_v2. The record says for each request the result and *which function* the answer is:
the exported name at that address, or ?n for the n-th address that no exported name has. So two
requests are answered alike if and only if their lines end alike, and records of two libraries (a
driver bare, and the same behind UrgenGo) can be compared line by line.

  record_driver.py --gpu "NVIDIA H200" --driver 580.159.04 -o driver_580.159.04.txt
  LD_PRELOAD=.../lib/urgengo/libcuda.so.1 record_driver.py --compare driver_580.159.04.txt

Asks before cuInit, as cudart does; needs no device, and nothing but Python 3.
"""
import argparse
import ctypes
import os
import pathlib
import re
import struct
import sys

HERE = pathlib.Path(__file__).resolve().parent
REQUESTS = HERE.parent.parent / "tests/interposer/data/cudart13_driver_requests.txt"
VERSIONS = (12000, 12040, 13000)
FLAGS = (0, 2)  # the legacy default stream, and the thread's own
# Near misses, and names whose answers change with version and flags, at the edges of both.
NEAR_MISSES = ("", "cu", "cuLaunchKerne", "cuLaunchKernelx", "culaunchkernel", " cuLaunchKernel",
               "cuLaunchKernel ", "cuLaunchKernel_ptsz", "cuMemcpyDtoH_v2", "cuGetProcAddress_v2",
               "ug_status", "urgengo_entry_points", "nothing")
EDGE_NAMES = ("cuLaunchKernel", "cuLaunchKernelEx", "cuGetProcAddress", "cuStreamBeginCapture",
              "cuMemcpyDtoH", "cuCtxSynchronize", "cuGLInit", "cuProfilerStart")
EDGE_VERSIONS = (-1, 0, 1, 2000, 3020, 4000, 7000, 11029, 11030, 11060, 11999, 12000, 13000, 13010,
                 99999)
EDGE_FLAGS = (0, 1, 2, 3, 4)
UNTOUCHED = 0x5A5A5A5A


def listed_names(path):
    lines = (line.split("#")[0].strip() for line in path.read_text().splitlines())
    return [line for line in lines if line]


def dynamic_symbols(path):
    """Names of the functions that a 64-bit little-endian ELF file exports. Not of its variables: a
    driver's are for debuggers, which find them in the driver's file."""
    data = pathlib.Path(path).read_bytes()
    if data[:6] != b"\x7fELF\x02\x01":
        sys.exit(f"{path}: found no 64-bit little-endian ELF file")
    (table,) = struct.unpack_from("<Q", data, 40)
    size, count = struct.unpack_from("<HH", data, 58)
    sections = [struct.unpack_from("<IIQQQQIIQQ", data, table + i * size) for i in range(count)]
    names = set()
    for section in sections:
        if section[1] != 11:  # SHT_DYNSYM
            continue
        strings = sections[section[6]][4]
        for offset in range(section[4], section[4] + section[5], 24):
            name, kind, _, index = struct.unpack_from("<IBBH", data, offset)
            if index != 0 and kind & 15 in (2, 10):  # STT_FUNC, STT_GNU_IFUNC
                start = strings + name
                names.add(data[start:data.index(b"\0", start)].decode())
    return names


class DlInfo(ctypes.Structure):
    _fields_ = [("path", ctypes.c_char_p), ("base", ctypes.c_void_p),
                ("name", ctypes.c_char_p), ("address", ctypes.c_void_p)]


class Library:
    """An open libcuda: its exported addresses, and the answers of its two resolvers."""

    def __init__(self, name):
        try:
            self.library = ctypes.CDLL(name)
        except OSError as error:
            sys.exit(f"{name}: {error}")
        candidates = set()
        for path in sorted((HERE / "exports").glob("*.txt")):
            candidates.update(listed_names(path))
        candidates.update(n for n in dynamic_symbols(self.path()) if n.startswith("cu"))
        self.exports = {}
        for name in sorted(candidates):
            address = self.address(name)
            if address:
                self.exports[name] = address
        self.owner = {}
        for name, address in self.exports.items():  # sorted: the first of all aliases
            self.owner.setdefault(address, name)
        self.unexported = {}

    def address(self, name):
        try:
            return ctypes.cast(getattr(self.library, name), ctypes.c_void_p).value
        except AttributeError:
            return None

    def path(self):
        info = DlInfo()
        dladdr = ctypes.CDLL(None).dladdr
        dladdr.argtypes = [ctypes.c_void_p, ctypes.POINTER(DlInfo)]
        if not dladdr(self.address("cuInit"), ctypes.byref(info)):
            sys.exit("the library has no cuInit, or the loader does not know where it lies")
        return os.fsdecode(info.path)

    def identity(self, address):
        if not address:
            return "-"
        if address == UNTOUCHED:
            return "untouched"
        if address in self.owner:
            return self.owner[address]
        return f"?{self.unexported.setdefault(address, len(self.unexported))}"

    def ask(self, name, version, flags):
        """One line: the request, then result and function of each resolver, and the status."""
        symbol = ctypes.c_char_p(name.encode())
        answers = []
        if "cuGetProcAddress" in self.exports:
            out = ctypes.c_void_p(UNTOUCHED)
            result = self.library.cuGetProcAddress(symbol, ctypes.byref(out), ctypes.c_int(version),
                                                   ctypes.c_uint64(flags))
            answers.append(f"{result} {self.identity(out.value)}")
        if "cuGetProcAddress_v2" in self.exports:
            out = ctypes.c_void_p(UNTOUCHED)
            status = ctypes.c_int(99)  # no value of the enumeration: is it written?
            result = self.library.cuGetProcAddress_v2(
                symbol, ctypes.byref(out), ctypes.c_int(version), ctypes.c_uint64(flags),
                ctypes.byref(status))
            answers.append(f"{result} {self.identity(out.value)} {status.value}")
        return f"{name!r} {version} {flags}: " + " | ".join(answers)

    def ask_with_nulls(self, which, symbol, function, status):
        """In a child, since a driver may crash: the result, or the signal."""
        reader, writer = os.pipe()
        child = os.fork()
        if child == 0:
            out, written = ctypes.c_void_p(UNTOUCHED), ctypes.c_int(99)
            arguments = [ctypes.c_char_p(b"cuLaunchKernel" if symbol else None),
                         ctypes.byref(out) if function else None, ctypes.c_int(12000),
                         ctypes.c_uint64(0)]
            if which == "cuGetProcAddress_v2":
                arguments.append(ctypes.byref(written) if status else None)
            result = getattr(self.library, which)(*arguments)
            os.write(writer, f"{result} {self.identity(out.value)} {written.value}".encode())
            os._exit(0)
        os.close(writer)
        answer = os.read(reader, 200).decode()
        os.close(reader)
        _, how = os.waitpid(child, 0)
        given = ", ".join(("symbol" if symbol else "null", "function" if function else "null",
                           "status" if status else "null"))
        return f"{which}({given}): " + (answer or f"signal {os.WTERMSIG(how)}")


def base_name(name):
    return re.sub(r"_v\d$", "", re.sub(r"_pts[zd]$", "", name))


def cudart_requests():
    for line in REQUESTS.read_text().splitlines():
        match = re.fullmatch(r"(\S*) ?ver=(-?\d+) flags=(\d+) ?", line)
        if not match:
            sys.exit(f"{REQUESTS}: found '{line}', accepted: NAME ver=VERSION flags=FLAGS")
        yield match[1], int(match[2]), int(match[3])


def record(library):
    """The record's lines, without its header."""
    lines = ["[exports] name, or name = the first name at the same address"]
    for name, address in library.exports.items():
        owner = library.owner[address]
        lines.append(name if owner == name else f"{name} = {owner}")
    answer = "cuGetProcAddress: result function | cuGetProcAddress_v2: result function status"
    lines.append(f"[cudart] name version flags: {answer}")
    lines += [library.ask(*request) for request in cudart_requests()]
    lines.append(f"[names] {answer}")
    for name in sorted({base_name(name) for name in library.exports}):
        lines += [library.ask(name, version, flags) for version in VERSIONS for flags in FLAGS]
    lines.append(f"[edges] {answer}")
    for name in NEAR_MISSES:
        lines += [library.ask(name, version, 0) for version in (0, 12000, 13000)]
    for name in EDGE_NAMES:
        lines += [library.ask(name, version, flags)
                  for version in EDGE_VERSIONS for flags in EDGE_FLAGS]
    lines.append("[nulls] resolver(arguments): result function status")
    for which in ("cuGetProcAddress", "cuGetProcAddress_v2"):
        if which in library.exports:
            lines += [library.ask_with_nulls(which, *given)
                      for given in ((0, 1, 1), (1, 0, 1), (1, 1, 0), (0, 0, 0))]
    return lines


def without_header(text):
    return [line for line in text.splitlines() if line and not line.startswith("#")]


def compare(expected, found):
    """Prints what differs. @returns the number of lines that do"""
    # The first word of a line, or all before its colon, is what was asked.
    def asked(line):
        return line.split(": ")[0] if ": " in line else line.split(" ")[0]

    section, tables = "", ({}, {})
    for table, lines in zip(tables, (expected, found)):
        for line in lines:
            if line.startswith("["):
                section = line.split("]")[0] + "]"
            else:
                table[(section, asked(line))] = line
    different = [key for key in {**tables[0], **tables[1]}
                 if tables[0].get(key) != tables[1].get(key)]
    for key in different[:40]:
        print(f"{key[0]} expected {tables[0].get(key, 'nothing')}\n"
              f"{' ' * len(key[0])} found    {tables[1].get(key, 'nothing')}")
    print(f"{len(different)} of {len({**tables[0], **tables[1]})} answers differ")
    return len(different)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("library", nargs="?", default="libcuda.so.1",
                        help="what to open: a path, or a name for the loader [libcuda.so.1]")
    parser.add_argument("--gpu", default="unknown", help="for the record's first line")
    parser.add_argument("--driver", default="unknown", help="for the record's first line")
    parser.add_argument("-o", "--output", type=pathlib.Path, help="the record [standard output]")
    parser.add_argument("--compare", type=pathlib.Path, metavar="RECORD",
                        help="say what differs from this record; exit 1 if anything does")
    args = parser.parse_args()
    if args.compare:
        expected = without_header(args.compare.read_text())
    lines = record(Library(args.library))
    header = f"# Entry points of libcuda.so.1, driver {args.driver}, {args.gpu}; record_driver.py"
    text = "\n".join([header] + lines) + "\n"
    if args.output:
        args.output.write_text(text)
    if args.compare:
        sys.exit(1 if compare(expected, lines) else 0)
    if not args.output:
        sys.stdout.write(text)


if __name__ == "__main__":
    main()
