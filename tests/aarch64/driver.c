/* SPDX-License-Identifier: Apache-2.0
 *
 * A driver that only says whether the arguments that program.c passes have arrived. */
#include "calls.h"

static int answer(int arrived) {
    return arrived ? kArrived : kGarbled;
}

int cuInit(unsigned flags) {
    return answer(flags == 0);
}

int cuDriverGetVersion(int* version) {
    *version = 13000;
    return kArrived;
}

int cuMemsetD2D32Async(uint64_t address, uint64_t pitch, uint32_t value, uint64_t width,
                       uint64_t height, void* stream) {
    return answer(address == UINT64_MAX && pitch == 2 && value == 3 && width == 4 && height == 5 &&
                  stream == POINTER(6));
}

int cuTexRefSetMipmapLevelClamp(void* texture, float least, float most) {
    return answer(texture == POINTER(1) && least == 0.25f && most == 1e30f);
}

int cuTensorMapEncodeTiled(void* map, int type, uint32_t rank, void* address, const uint64_t* dims,
                           const uint64_t* strides, const uint32_t* box, const uint32_t* steps,
                           int interleave, int swizzle, int promotion, int fill) {
    return answer(map == POINTER(1) && type == 2 && rank == 3 && address == POINTER(4) &&
                  (const void*)dims == POINTER(5) && (const void*)strides == POINTER(6) &&
                  (const void*)box == POINTER(7) && (const void*)steps == POINTER(8) &&
                  interleave == 9 && swizzle == 10 && promotion == 11 && fill == 12);
}

int cuLaunchKernel(void* function, unsigned grid_x, unsigned grid_y, unsigned grid_z,
                   unsigned block_x, unsigned block_y, unsigned block_z, unsigned shared,
                   void* stream, void** parameters, void** extra) {
    return answer(function == POINTER(1) && grid_x == 2 && grid_y == 3 && grid_z == 4 &&
                  block_x == 5 && block_y == 6 && block_z == 7 && shared == 8 &&
                  stream == POINTER(9) && (void*)parameters == POINTER(10) &&
                  (void*)extra == POINTER(11));
}
