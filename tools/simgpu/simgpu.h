/* SPDX-License-Identifier: Apache-2.0
 *
 * What the simulated GPU can tell a test beyond the CUDA driver API. C99; the functions are
 * exported by the simulated libcuda.so.1 only, so a program that may meet a real driver asks dlsym
 * for them.
 */
#ifndef URGENGO_SIMGPU_SIMGPU_H_
#define URGENGO_SIMGPU_SIMGPU_H_

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The simulated %globaltimer is CLOCK_MONOTONIC plus this, so that no program takes one for the
 * other. */
#define SIMGPU_GLOBALTIMER_OFFSET_NS INT64_C(1000000000000000)

/* One completed kernel. Times are nominal, CLOCK_MONOTONIC nanoseconds. */
struct simgpu_kernel_record {
    char name[64];      /* cut to fit, always ends in NUL */
    uint64_t stream_id; /* as cuStreamGetId */
    int32_t priority;   /* the one used: the launch attribute's, else the stream's */
    uint32_t device;
    uint64_t num_blocks;
    int64_t start_ns; /* the first block's start */
    int64_t end_ns;   /* the last block's end */
    uint64_t launch;  /* id of the call that launched it; a graph's kernels have its launch's */
};

/* Told, in the calling thread, when a call that launches kernels begins (1) and ends (0). */
typedef void (*simgpu_launch_hook)(uint64_t launch, int begins);

/* Where launches of a kernel leave their stamps, if its cost has a stamps_arg: that parameter is
 * the address of this in device memory, plus 1; without the 1 nothing is left. */
struct simgpu_stamps {
    uint64_t stamps;   /* address of pairs: begin and end, nanoseconds of %globaltimer */
    uint32_t room;     /* pairs; launches beyond leave none */
    uint32_t launches; /* ended so far, counted by them */
};

/** Copies the oldest completed kernels of the log, in the order in which they completed.
 *  @param[out] out  array of at least `max` records; may be NULL if max is 0
 *  @returns how many the log holds (at most 65536: the oldest are dropped), which may exceed `max`
 */
size_t simgpu_kernel_log(struct simgpu_kernel_record* out, size_t max);

/** Has every launch from here on tell the hook; NULL: none. */
void simgpu_set_launch_hook(simgpu_launch_hook hook);

/** Empties the log. */
void simgpu_kernel_log_clear(void);

#ifdef __cplusplus
}
#endif

#endif
