# SPDX-License-Identifier: Apache-2.0
"""Builds math_libraries.cu with nvcc and with the libraries that this machine has.

They may lie in the toolkit or in Python packages (nvidia-cublas, nvidia-cudnn-cu13, ...), with or
without the name that a linker looks for.
"""
import glob
import os
import pathlib
import shutil
import site
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
HEADERS = {"cublas": "cublas_v2.h", "cublasLt": "cublasLt.h", "cufft": "cufft.h",
           "cudnn": "cudnn.h"}
THE_OTHER = {"static": "shared", "shared": "static"}


def nvcc():
    """@returns its path, or empty"""
    return shutil.which("nvcc") or next(iter(sorted(glob.glob("/usr/local/cuda*/bin/nvcc"))), "")


def places(kind):
    """@param kind  include | lib   @returns folders to look in, the toolkit's first"""
    toolkit = pathlib.Path(os.path.realpath(nvcc())).parent.parent
    found = [toolkit / kind, toolkit / (kind + "64"), toolkit / "targets/x86_64-linux" / kind,
             toolkit / "targets/sbsa-linux" / kind]
    for packages in {*site.getsitepackages(), *sys.path}:
        found += [pathlib.Path(p) for p in sorted(glob.glob(f"{packages}/nvidia/*/{kind}"))]
    found += [pathlib.Path(p) for p in (sorted(glob.glob(f"/usr/{kind}")) +
                                        sorted(glob.glob(f"/usr/{kind}/*-linux-gnu")))]
    return [place for place in found if place.is_dir()]


def find(kind, pattern):
    for place in places(kind):
        for path in sorted(place.glob(pattern)):
            return path
    return None


def find_library(name):
    return find("lib", f"lib{name}.so") or find("lib", f"lib{name}.so.*")


def found_libraries():
    """@returns name -> (folder of its header, file to link), and the names of those not here"""
    found = {name: (find("include", header), find_library(name))
             for name, header in HEADERS.items()}
    here = {name: (header.parent, library) for name, (header, library) in found.items()
            if header and library}
    return here, sorted(set(HEADERS) - set(here))


def compile_with_nvcc(arguments):
    done = subprocess.run([nvcc(), "-std=c++17", "-arch=native", "-O2", *arguments], text=True,
                          capture_output=True)
    if done.returncode != 0:
        sys.exit(f"nvcc {' '.join(arguments)}: exit status {done.returncode}\n{done.stdout}"
                 f"{done.stderr}")


def rpath(folder):
    return ["-Xlinker", f"-rpath={folder}"]


def runtime_arguments(runtime):
    """Which copy of cudart to link."""
    library = find("lib", "libcudart.so*") if runtime == "shared" else None
    return [f"-cudart={runtime}"] + (rpath(library.parent) if library else [])


def build(folder, runtime):
    """@param runtime  static | shared: which copy of cudart the program has
    @returns the program's path and what is not in it"""
    here, missing = found_libraries()
    program = folder / f"math_libraries_{runtime}"
    arguments = ["-o", str(program), str(HERE / "math_libraries.cu"), "-ldl",
                 "-Xlinker", "--allow-shlib-undefined", *runtime_arguments(runtime)]
    for name, (include, library) in here.items():
        arguments += [f"-DHAVE_{name.upper()}", f"-I{include}", "-Xlinker", str(library),
                      *rpath(library.parent)]
    compile_with_nvcc(arguments)
    return program, missing


def build_second_runtime(folder, runtime):
    """@returns a library to load late, linked with the copy of cudart that `runtime` is not"""
    library = folder / f"libsecond_runtime_{THE_OTHER[runtime]}.so"
    compile_with_nvcc(["-shared", "-Xcompiler", "-fPIC", "-o", str(library),
                       str(HERE / "second_runtime.cu"), *runtime_arguments(THE_OTHER[runtime])])
    return library
