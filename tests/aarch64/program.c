/* SPDX-License-Identifier: Apache-2.0
 *
 * Calls the driver through the library for AArch64: first the function whose number is given, which
 * finds the driver not loaded yet, then all of them, and the first again. Exits with 0 if every
 * argument arrived. */
#include <stdio.h>
#include <stdlib.h>

#include "calls.h"

static int call(int number) {
    switch (number) {
        case 0:
            return cuMemsetD2D32Async(UINT64_MAX, 2, 3, 4, 5, POINTER(6));
        case 1:
            return cuTexRefSetMipmapLevelClamp(POINTER(1), 0.25f, 1e30f);
        case 2:
            return cuTensorMapEncodeTiled(POINTER(1), 2, 3, POINTER(4), POINTER(5), POINTER(6),
                                          POINTER(7), POINTER(8), 9, 10, 11, 12);
        default:
            return cuLaunchKernel(POINTER(1), 2, 3, 4, 5, 6, 7, 8, POINTER(9), POINTER(10),
                                  POINTER(11));
    }
}

int main(int argc, char** argv) {
    const int first = argc > 1 ? atoi(argv[1]) : 0;
    for (int i = 0; i <= 4; ++i) {
        const int number = (first + i) % 4;
        if (call(number) == kArrived) continue;
        fprintf(stderr, "call %d, after %d others: the arguments did not arrive\n", number, i);
        return 1;
    }
    return 0;
}
