# SPDX-License-Identifier: Apache-2.0
"""What ug_position() said against what the kernels' own stamps say.

A sample counts while its task's run has GPU work unfinished: from its first launch's begin to its
last one's end. The truth at that moment: the launches that have ended, and what remains of the
task, by the profile's estimates; of a launch that executes, by the share of its stamps' interval
that is left. So an error in remaining work is one of position, not of the estimates.

A position of another instance counts as what it means for this one: an earlier one's as nothing
done, a later one's as all.
"""
import bisect
import collections
import itertools
import math

from stamps_file import ANSWERED

BINS_PER_DECADE = 20
FIRST_BIN_US, NUM_BINS = 0.1, 7 * BINS_PER_DECADE  # to 1 s
PERCENTILES = (("p50", 0.5), ("p95", 0.95), ("p99", 0.99))


def as_int16(number):
    return (number + 0x8000) % 0x10000 - 0x8000


class RunTruth:
    """One run of a task: when each of its launches began and ended, on the host's clock."""

    def __init__(self, stamps, estimates_ns, clock, number):
        self.begins = [clock.to_host(begin) for begin, _ in stamps]
        self.ends = [clock.to_host(end) for _, end in stamps]
        self.estimates_ns = estimates_ns
        sums = list(itertools.accumulate(estimates_ns))
        self.remaining_ns = [sums[-1] - done for done in [0] + sums]
        self.number = number  # of the task's runs, from 1: UrgenGo's instance

    def is_on_gpu(self, time_ns):
        return self.begins[0] <= time_ns <= self.ends[-1]

    def done(self, time_ns):
        return bisect.bisect_right(self.ends, time_ns)

    def remaining_at(self, time_ns):
        done = self.done(time_ns)
        remaining = self.remaining_ns[done]
        if done < len(self.ends) and time_ns > self.begins[done]:
            length = self.ends[done] - self.begins[done]
            remaining -= self.estimates_ns[done] * (time_ns - self.begins[done]) / length
        return remaining

    def done_according_to(self, sample):
        other = as_int16(sample.instance - self.number)
        if other:
            return 0 if other < 0 else len(self.ends)
        return min(sample.launch, len(self.ends))


def estimates_of(profile):
    """@returns {(chain, task): GPU time of each of its launches, nanoseconds}"""
    return {(chain["name"], task["name"]): [kernel["gpu_time_ns"] for kernel in task["kernels"]]
            for chain in profile["chains"] for task in chain["tasks"]}


def truths_of(stream, estimates, clock):
    """@returns the truth of each run; nothing for those without all stamps, or whose profile has
    another number of launches"""
    truths, numbers = [], collections.Counter()
    for run in stream.runs:
        numbers[run.task] += 1
        stamps = stream.stamps[run.first_launch:run.first_launch + run.num_launches]
        its = estimates.get((stream.chain, stream.tasks[run.task]), [])
        complete = len(stamps) == run.num_launches == len(its)
        truths.append(RunTruth(stamps, its, clock, numbers[run.task]) if complete else None)
    return truths


def histogram(values_us):
    """@returns counts of |values|: below FIRST_BIN_US, then bin by bin, the last one open"""
    counts = [0] * (NUM_BINS + 1)
    for value in values_us:
        size = abs(value)
        place = 0
        if size >= FIRST_BIN_US:
            place = 1 + int(BINS_PER_DECADE * math.log10(size / FIRST_BIN_US))
        counts[min(place, NUM_BINS)] += 1
    return counts


def bin_ends_us():
    return [FIRST_BIN_US * 10 ** (i / BINS_PER_DECADE) for i in range(NUM_BINS + 1)]


def percentiles(values):
    """@returns of the sizes: by name, max among them"""
    ordered = sorted(abs(value) for value in values)
    if not ordered:
        return {name: None for name, _ in PERCENTILES} | {"max": None}
    at = {name: ordered[min(len(ordered) - 1, math.ceil(share * len(ordered)) - 1)]
          for name, share in PERCENTILES}
    return at | {"max": ordered[-1]}


def share(hits, count):
    return hits / count if count else None


def analyse(file, profile):
    """@param file  a StampsFile
    @returns distributions of both errors, and what was left out"""
    estimates, clock = estimates_of(profile), file.clock
    truths = [truths_of(stream, estimates, clock) for stream in file.streams]
    kernels, exact_within_clocks, us, took = [], 0, [], []
    left_out = collections.Counter()
    other_instance = overdue = 0
    for sample in file.samples:
        truth = truths[sample.stream][sample.run]
        time_ns = sample.before_ns + sample.took_ns / 2
        if truth is None:
            left_out["no truth"] += 1
        elif not truth.is_on_gpu(time_ns):
            left_out["not on the GPU"] += 1
        elif not sample.flags & ANSWERED:
            left_out["not answered"] += 1
        else:
            said, done = truth.done_according_to(sample), truth.done(time_ns)
            kernels.append(said - done)
            unsure_ns = clock.bound_ns + sample.took_ns / 2
            exact_within_clocks += (truth.done(time_ns - unsure_ns) <= said <=
                                    truth.done(time_ns + unsure_ns))
            us.append((sample.remaining_ns - truth.remaining_at(time_ns)) / 1000)
            took.append(sample.took_ns)
            other_instance += as_int16(sample.instance - truth.number) != 0
            overdue += bool(sample.flags & 4)
    count = len(kernels)
    return {"samples": count,
            "left_out": dict(left_out),
            "other_instance": other_instance,
            "overdue": overdue,
            "took_ns": percentiles(took),
            "exact": share(sum(error == 0 for error in kernels), count),
            "exact_within_clocks": share(exact_within_clocks, count),
            "within_one": share(sum(abs(error) <= 1 for error in kernels), count),
            "kernels": percentiles(kernels),
            "kernels_behind": share(sum(error < 0 for error in kernels), count),
            "remaining_us": percentiles(us),
            "remaining_mean_us": sum(us) / count if count else None,
            "kernels_histogram": dict(sorted(collections.Counter(kernels).items())),
            "remaining_histogram": histogram(us)}
