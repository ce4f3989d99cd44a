# SPDX-License-Identifier: Apache-2.0
# Toolchain: the interposer for AArch64, built on another machine with Debian's cross compiler
# (package g++-aarch64-linux-gnu). host_headers.cmake finds the headers that it needs; those of the
# CUDA toolkit are that machine's too, and so is nvcc, which makes the device image.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)
set(CMAKE_ASM_COMPILER aarch64-linux-gnu-gcc)
