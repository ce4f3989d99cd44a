/* SPDX-License-Identifier: Apache-2.0
 *
 * The mailbox through which the GPU tells the host how far it is: one cache line a task, in mapped
 * host memory, written by mark kernels and read by any thread of the host without a driver call.
 *
 * A mark is two 8-byte words that carry the same tag:
 *
 *   word 0   position (32 bits) | instance (16 bits) | tag (16 bits)
 *   word 1   %globaltimer, ns, low 48 bits           | tag (16 bits)
 *
 * The GPU writes both with one 16-byte store, but nothing promises that the host sees both at once:
 * a reader that finds two different tags reads again. The tag is the low 16 bits of the mark's
 * sequence number in its line; the launching side has far fewer than 2^16 marks in flight, so the
 * sequence number follows from the tag and the last number issued.
 */
#ifndef URGENGO_ABI_DEVICE_MAILBOX_H_
#define URGENGO_ABI_DEVICE_MAILBOX_H_

#include <stdint.h>

#define UG_MARK_KERNEL_NAME "urgengo_mark"
#define UG_DELAY_KERNEL_NAME "urgengo_delay"

struct ug_mark_line {
    uint64_t word[2];      /* read and written atomically, each by itself */
    uint64_t reserved[14]; /* 128 bytes: neighbours never share a line, prefetched pairs included */
};

/* Word 0 of the mark with this sequence number. */
static inline uint64_t ug_mark_word0(uint32_t position, uint16_t instance, uint32_t sequence) {
    return (uint64_t)position << 32 | (uint64_t)instance << 16 | (sequence & 0xffffu);
}

#endif
