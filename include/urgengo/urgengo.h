/* SPDX-License-Identifier: Apache-2.0
 *
 * Hints: what middleware may tell UrgenGo about frames and tasks, and ask it.
 *
 * Optional. A program finds the functions at run time with ug_hints_load(), so the same binary runs
 * with and without UrgenGo: without it every function of struct ug_hints does nothing and answers
 * "continue". C99, no CUDA, no library to link (dlsym needs -ldl before glibc 2.34).
 *
 * Every function may be called from any thread, never blocks, never fails the program, and leaves
 * errno alone.
 */
#ifndef URGENGO_URGENGO_H_
#define URGENGO_URGENGO_H_

#include <dlfcn.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define UG_API_VERSION 1

/* One frame's passage through one chain. 0 is "no instance": accepted everywhere, and ignored. */
typedef uint64_t ug_instance;

/* The clock of a time that is handed in. */
enum ug_clock {
    UG_CLOCK_MONOTONIC = 0, /* clock_gettime(CLOCK_MONOTONIC) */
    UG_CLOCK_REALTIME = 1   /* clock_gettime(CLOCK_REALTIME): a ROS 2 header stamp, say */
};

/* What ug_task_begin() answers. */
enum ug_verdict {
    UG_CONTINUE = 0,
    UG_EXIT_CHAIN = 1 /* the deadline can no longer be met and the chain's on_late is `exit`: the
                         instance is over, skip this task and those after it (early chain exit) */
};

/** A data frame arrived for `chain` (its name in chains.yaml).
 *  @param arrival_ns  when, nanoseconds on `clock`; 0 = now
 *  @returns the instance to hand to the tasks; 0 if the chain is unknown or UrgenGo is off */
typedef ug_instance (*ug_arrival_fn)(const char* chain, int64_t arrival_ns, int clock);

/** The calling thread starts `task` of the instance. Until ug_task_end() its GPU work belongs to
 * it.
 *  @returns an enum ug_verdict */
typedef int (*ug_task_begin_fn)(ug_instance instance, const char* task);

/** The calling thread's task is done, its GPU work included. The end of a chain's last task ends
 * the instance. */
typedef void (*ug_task_end_fn)(void);

/** @returns 1 while UrgenGo schedules this process, 2 while it only observes, 0 otherwise */
typedef int (*ug_status_fn)(void);

/* Where the GPU is in a task's work. */
typedef struct {
    uint32_t size;     /* in: sizeof(ug_position_t); fields are only ever added */
    uint32_t busy;     /* 1: the GPU executes `launch`; 0: that one is the next, all before it
                          are done */
    uint32_t launch;   /* index, from 0, of a launch in its instance */
    uint32_t instance; /* whose it is: counts the task's instances from 1, low 16 bits. Not the
                          newest one while instances overlap */
    uint32_t overdue;  /* 1: what is launched should have executed long ago: it waits for
                          something that is not the GPU */
    uint32_t reserved; /* 0 */
    int64_t
        remaining_ns; /* estimated GPU time of the task that has not executed, launched or not */
    int64_t unexecuted_ns; /* of that, what is launched */
    int64_t uncertain_ns; /* estimated GPU time between the two progress marks that the GPU is known
                             to be between; both of the above are off by less than that, if the
                             estimates are right */
} ug_position_t;

/** Tells where the GPU is in a task of a chain, by their names in chains.yaml: from progress marks,
 * and between two of them by time. With another `scheduler.tracking`, what that knows, at its last
 * synchronisation. Calls no driver, takes no lock. May be asked from any thread, of
 * any task, also between its instances.
 *  @param[in,out] position  only its `size` is read
 *  @returns 1 if `position` was filled; else 0, and it is as it was: there is no such task, nothing
 *           of it was ever scheduled, UrgenGo is off, `size` is too small, or the task moved on
 *           under every look */
typedef int (*ug_position_fn)(const char* chain, const char* task, ug_position_t* position);

struct ug_hints {
    ug_arrival_fn arrival;
    ug_task_begin_fn task_begin;
    ug_task_end_fn task_end;
    ug_status_fn status;
    ug_position_fn position;
};

static ug_instance ug_none_arrival_(const char* chain, int64_t arrival_ns, int clock) {
    (void)chain, (void)arrival_ns, (void)clock;
    return 0;
}
static int ug_none_task_begin_(ug_instance instance, const char* task) {
    (void)instance, (void)task;
    return UG_CONTINUE;
}
static void ug_none_task_end_(void) {}
static int ug_none_status_(void) {
    return 0;
}
static int ug_none_position_(const char* chain, const char* task, ug_position_t* position) {
    (void)chain, (void)task, (void)position;
    return 0;
}

/** Fills `hints` with UrgenGo's functions, or with ones that do nothing.
 *  @returns 1 if UrgenGo is loaded into this process, else 0 */
static inline int ug_hints_load(struct ug_hints* hints) {
    void* handle = dlopen("libcuda.so.1", RTLD_LAZY | RTLD_NOLOAD);
    void* arrival = dlsym(RTLD_DEFAULT, "ug_arrival");
    void* from = RTLD_DEFAULT;
    void* position = 0;
    if (!arrival && handle) {
        arrival = dlsym(handle, "ug_arrival");
        from = handle;
    }
    if (arrival) {
        /* POSIX guarantees that a function's address survives the way through void*. */
        *(void**)&hints->arrival = arrival;
        *(void**)&hints->task_begin = dlsym(from, "ug_task_begin");
        *(void**)&hints->task_end = dlsym(from, "ug_task_end");
        *(void**)&hints->status = dlsym(from, "ug_status");
    } else {
        hints->arrival = ug_none_arrival_;
        hints->task_begin = ug_none_task_begin_;
        hints->task_end = ug_none_task_end_;
        hints->status = ug_none_status_;
    }
    hints->position = ug_none_position_;
    if (arrival) position = dlsym(from, "ug_position");
    if (position) *(void**)&hints->position = position; /* not in an older UrgenGo */
    if (handle) dlclose(handle);
    return arrival != 0;
}

#ifdef __cplusplus
}
#endif
#endif
