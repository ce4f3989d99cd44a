# SPDX-License-Identifier: Apache-2.0
"""When frames arrive, in which order a thread takes them, and what became of them.

A frame that finds its thread busy waits. When the thread becomes free and more than `most_waiting`
frames have arrived, the oldest are skipped until so many are left: a camera's queue of that length.
A skipped frame counts as missed. Whatever is taken is run to its end, however late it is.

Latency is from the arrival to the end; lateness is what of it is beyond the deadline.
"""
import bisect
import random
import statistics

MOST_WAITING = 2


def arrivals_s(name, seed, period_ms, seconds, jitter=0.1):
    """@param jitter  each frame comes up to so much of a period late
    @returns when frames arrive, from 0: the same for the same name and seed, whatever else runs"""
    source = random.Random(f"{seed}/{name}")
    phase = source.random()
    times, i = [], 0
    while (phase + i) * period_ms < seconds * 1000:
        times.append((phase + i + source.uniform(0, jitter)) * period_ms / 1000)
        i += 1
    return times


def run_frames(dues, frame, clock, sleep, most_waiting=MOST_WAITING):
    """@returns when each frame ended, None for those that were skipped"""
    ends = []
    for i, due in enumerate(dues):
        now = clock()
        if due > now:
            sleep(due - now)
        elif bisect.bisect_right(dues, now) - i > most_waiting:
            ends.append(None)
            continue
        frame()
        ends.append(clock())
    return ends


def at(ordered, share):
    return ordered[int(share * (len(ordered) - 1))] if ordered else None


def of_frames(dues, ends, deadline_ms, not_before=0.0):
    """@returns what to report of the frames that arrived from `not_before` on"""
    counted = [(due, end) for due, end in zip(dues, ends) if due >= not_before]
    latencies = sorted((end - due) * 1000 for due, end in counted if end is not None)
    skipped = len(counted) - len(latencies)
    late = [max(0.0, latency - deadline_ms) for latency in latencies]
    return {"frames": len(counted), "skipped": skipped,
            "missed": skipped + sum(one > 0 for one in late),
            "latency_ms": {"p50": at(latencies, 0.5), "p90": at(latencies, 0.9),
                           "p99": at(latencies, 0.99), "max": at(latencies, 1)},
            "mean_lateness_ms": statistics.fmean(late) if late else 0.0}


def overall_miss_pct(networks):
    """@returns the mean over networks of what they missed, in per cent of their frames"""
    shares = [100 * n["missed"] / n["frames"] for n in networks if n["frames"]]
    return statistics.fmean(shares) if shares else 0.0
