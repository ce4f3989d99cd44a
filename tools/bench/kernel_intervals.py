# SPDX-License-Identifier: Apache-2.0
"""What CUPTI's records of kernels say of an inference: read from a trace of torch.profiler.

Busy is the union of the kernels' intervals, so kernels that run side by side count once; the sum
counts each. Both are of kernels; copies and memsets are told apart. An inference is what begins
between two annotations of the program, which waits for the GPU before the next one.
"""
import bisect
import statistics
import typing

FRAME = "frame"
KERNEL, COPIES = "kernel", ("gpu_memcpy", "gpu_memset")


class Interval(typing.NamedTuple):
    begin_us: float
    end_us: float
    stream: int
    is_kernel: bool


def union_us(intervals):
    """@returns how long at least one of the (begin, end, ...) is under way"""
    total, until = 0.0, float("-inf")
    for begin, end, *_ in sorted(intervals):
        total += max(0.0, end - max(begin, until))
        until = max(until, end)
    return total


def read_trace(trace):
    """@param trace  of torch.profiler's export_chrome_trace()
    @returns by frame the intervals that began in it"""
    events = [one for one in trace["traceEvents"] if one.get("ph") == "X"]
    begins = sorted(one["ts"] for one in events
                    if one.get("cat") == "user_annotation" and one["name"].startswith(FRAME))
    frames = [[] for _ in begins]
    for one in events:
        category = one.get("cat", "").lower()
        if category != KERNEL and category not in COPIES:
            continue
        which = bisect.bisect_right(begins, one["ts"]) - 1
        if which >= 0:
            frames[which].append(Interval(one["ts"], one["ts"] + one["dur"],
                                          one.get("args", {}).get("stream", 0),
                                          category == KERNEL))
    return frames


def of_frames(frames):
    """@returns medians over frames, ms, and of how many frames with the usual number of kernels
    @errors ValueError if there is no kernel: another client may hold CUPTI"""
    counts = [sum(one.is_kernel for one in frame) for frame in frames]
    usual = statistics.mode(counts) if counts else 0
    if usual == 0:
        raise ValueError("found no kernels in the trace, accepted: some in each frame")
    found = {"busy_ms": [], "sum_ms": [], "span_ms": [], "busy_with_copies_ms": []}
    main_kernels, streams = 0, set()
    whole = [frame for frame, count in zip(frames, counts) if count == usual]
    for frame in whole:
        kernels = [one for one in frame if one.is_kernel]
        found["busy_ms"].append(union_us(kernels) / 1000)
        found["busy_with_copies_ms"].append(union_us(frame) / 1000)
        found["sum_ms"].append(sum(one.end_us - one.begin_us for one in kernels) / 1000)
        found["span_ms"].append((max(one.end_us for one in kernels) -
                                 min(one.begin_us for one in kernels)) / 1000)
        by_stream = statistics.multimode(one.stream for one in kernels)
        main_kernels += sum(one.stream == by_stream[0] for one in kernels)
        streams |= {one.stream for one in kernels}
    return {**{name: round(statistics.median(values), 5) for name, values in found.items()},
            "kernels": usual, "streams": len(streams),
            "side_share": round(1 - main_kernels / (usual * len(whole)), 4),
            "frames": len(whole), "other_frames": len(frames) - len(whole)}
