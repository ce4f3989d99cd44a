/* SPDX-License-Identifier: Apache-2.0
 *
 * The mailbox through which the GPU tells the host how far it is: one cache line a task, in mapped
 * host memory, read by any thread of the host without a driver call. Who writes it is the progress
 * source: mark kernels, stream writes, or a thread of the host that asks for events.
 *
 * A mark is two 8-byte words that carry the same tag:
 *
 *   word 0   position (32 bits) | instance (16 bits) | tag (16 bits)
 *   word 1   time, ns, low 48 bits                   | tag (16 bits)
 *
 * The time: a mark kernel writes %globaltimer; a stream write UG_MARK_NO_TIME; the thread that asks
 * for events CLOCK_MONOTONIC, about when the event was complete: between its last two looks.
 * `clock` says which clock it is; it changes at most once, when events are given up, and a reader
 * that cares looks at it again after the words. `looked_ns` is that thread's, too: when it last saw
 * that what comes behind the mark was not complete.
 *
 * A mark kernel writes both with one 16-byte store, the others write word 0 first, and nothing
 * promises that the host sees both at once:
 * a reader that finds two different tags reads again. The tag is the low 16 bits of the mark's
 * sequence number in its line; the launching side has far fewer than 2^16 marks in flight, so the
 * sequence number follows from the tag and the last number issued.
 */
#ifndef URGENGO_ABI_DEVICE_MAILBOX_H_
#define URGENGO_ABI_DEVICE_MAILBOX_H_

#include <stdint.h>

#define UG_MARK_KERNEL_NAME "urgengo_mark"
#define UG_DELAY_KERNEL_NAME "urgengo_delay"

#define UG_MARK_BRANCHES 6
#define UG_MARK_NO_TIME 0u
#define UG_MARK_CLOCK_GPU 0u  /* %globaltimer */
#define UG_MARK_CLOCK_HOST 1u /* CLOCK_MONOTONIC */

struct ug_mark_line {
    uint64_t word[2];   /* read and written atomically, each by itself */
    uint64_t clock;     /* UG_MARK_CLOCK_*, written by the host */
    uint64_t looked_ns; /* CLOCK_MONOTONIC; 0: never */
    /* Of single streams, between a fork and its join: GPU time ever launched there in
       forks, ns, and a tag that says nothing (host/model/fork_progress.h). To 128 bytes: neighbours
       never share a line, prefetched pairs included. */
    uint64_t branch[UG_MARK_BRANCHES][2];
};

/* Word 0 of the mark with this sequence number. */
static inline uint64_t ug_mark_word0(uint32_t position, uint16_t instance, uint32_t sequence) {
    return (uint64_t)position << 32 | (uint64_t)instance << 16 | (sequence & 0xffffu);
}

/* Word 1 of the mark with this sequence number. */
static inline uint64_t ug_mark_word1(uint64_t time_ns, uint32_t sequence) {
    return time_ns << 16 | (sequence & 0xffffu);
}

#endif
