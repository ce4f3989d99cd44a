// SPDX-License-Identifier: Apache-2.0
//
// The progress mark: a kernel of one block launched after the program's own, on the same stream.
// When it runs, everything before it on that stream has run, and the host can read so from its
// memory. One of its threads does all; how many it has is chosen by the host
// (host/exec/mark_width.h).
// Layout and meaning: include/urgengo/abi/device_mailbox.h.
#include <stdint.h>

// Keeps its stream busy for a while, so that what is launched behind it queues up.
extern "C" __global__ void urgengo_delay(uint64_t duration_ns) {
    uint64_t begin_ns, now_ns;
    asm volatile("mov.u64 %0, %globaltimer;" : "=l"(begin_ns));
    do {
        asm volatile("mov.u64 %0, %globaltimer;" : "=l"(now_ns));
    } while (now_ns - begin_ns < duration_ns);
}

// Launched with programmatic serialisation it may start before what comes before it has ended: it
// waits for that end first, and lets nothing behind it start before its own
// (host/exec/progress_marks.h). Launched plainly, the wait is over at once.
extern "C" __global__ void urgengo_mark(uint64_t* line, uint64_t word0, uint64_t tag) {
#if __CUDA_ARCH__ >= 900
    asm volatile("griddepcontrol.wait;" ::: "memory");
#endif
    if (threadIdx.x != 0) return;
    uint64_t time_ns;
    asm volatile("mov.u64 %0, %globaltimer;" : "=l"(time_ns));
    const uint64_t word1 = time_ns << 16 | (tag & 0xffff);
    asm volatile("st.volatile.global.v2.u64 [%0], {%1, %2};" ::"l"(line), "l"(word0), "l"(word1)
                 : "memory");
}
