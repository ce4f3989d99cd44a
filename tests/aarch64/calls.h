/* SPDX-License-Identifier: Apache-2.0
 *
 * What program.c passes to driver.c through the library that lies between them: functions with
 * arguments in general registers, in floating-point registers and on the stack. */
#ifndef URGENGO_TESTS_AARCH64_CALLS_H
#define URGENGO_TESTS_AARCH64_CALLS_H

#include <stdint.h>

enum { kArrived = 0, kGarbled = 999 };

/* Six integers: registers. */
int cuMemsetD2D32Async(uint64_t address, uint64_t pitch, uint32_t value, uint64_t width,
                       uint64_t height, void* stream);
/* Floating-point registers. */
int cuTexRefSetMipmapLevelClamp(void* texture, float least, float most);
/* Twelve: four on the stack. */
int cuTensorMapEncodeTiled(void* map, int type, uint32_t rank, void* address, const uint64_t* dims,
                           const uint64_t* strides, const uint32_t* box, const uint32_t* steps,
                           int interleave, int swizzle, int promotion, int fill);
/* Eleven, and a C++ function of the library's instead of a trampoline. */
int cuLaunchKernel(void* function, unsigned grid_x, unsigned grid_y, unsigned grid_z,
                   unsigned block_x, unsigned block_y, unsigned block_z, unsigned shared,
                   void* stream, void** parameters, void** extra);

#define POINTER(n) ((void*)(uintptr_t)(0x1234567800000000u + (n)))

#endif
