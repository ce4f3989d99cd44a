# SPDX-License-Identifier: Apache-2.0
"""Why was a frame late, by CUPTI's records of kernels alone? For causes_check.py.

1 The time from a frame's arrival to its end is divided. Before its work begins, its chain was at the
  frame before. Then, at each moment, the first that holds: a kernel of its own runs; a launch of its
  own was made and its kernel has not begun (it is blocked); a launch is held, or paced, or its
  thread waits for what the GPU has done already (these three by UrgenGo's record); what is left is
  the CPU's.
2 Time that is blocked or held is of those chains whose kernels run meanwhile. Of what they take a
  kernel of a less urgent frame that ran already when the wait began was in front; one that began
  later had the priority to. CUPTI's kernels begin when the GPU takes them up, which may be long
  before their first block where others fill it: of another's kernel the last part counts, at most
  twice what it takes usually.
3 Its own kernels are compared, one by one, with the medians of a run at low load. What those take
  longer that run beside no other chain's is its own, and the same share of the others; the rest of
  what the others take longer is of those beside whom they run.
4 Which cause is right: the largest of these, or within a tenth of it. What a chain takes counts as
  one there; whether it is of the right kind (in front, by priority, more urgent) is told besides.

Times are ns of CLOCK_MONOTONIC. Pure.
"""
import bisect
import collections
import statistics
import typing

BYSTANDER = ""
LEAST_NS, FAIR_SHARE = 50_000, 0.25  # of `unknown`: host/observe/miss_cause.cpp
TOLERANCE = 0.1
MOST_TIMES = 2  # its usual time, that a kernel of another executes
BESIDE_SHARE = 0.1  # a kernel runs beside others if this share of it does
OWN = ("arrived_late", "cpu_longer", "gpu_longer")
TAKEN = ("shared", "kernel_in_front", "priority_late")
JUDGED = (*OWN, *TAKEN, "held", "given_up", "unknown")


class Kernel(typing.NamedTuple):
    launched_ns: float  # the driver's call
    begin_ns: float
    end_ns: float


class Hold(typing.NamedTuple):
    begin_ns: int
    end_ns: int
    kind: str  # held, gate, paced, wait
    behind: str


class Frame(typing.NamedTuple):
    chain: str
    number: int
    arrival_ns: int
    end_ns: int
    deadline_ns: int  # after its arrival
    cause: str = ""   # as UrgenGo names it; "": in time
    behind: str = ""
    cause_ns: int = 0
    exited: bool = False
    holds: tuple = ()

    @property
    def late_ns(self):
        return self.end_ns - self.arrival_ns - self.deadline_ns


# --- disjoint intervals in order

def union(pairs):
    found = []
    for begin, end in sorted(pairs):
        if end <= begin:
            continue
        if found and begin <= found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], end))
        else:
            found.append((begin, end))
    return found


def intersect(a, b):
    found, j = [], 0
    for begin, end in a:
        while j < len(b) and b[j][1] <= begin:
            j += 1
        i = j
        while i < len(b) and b[i][0] < end:
            found.append((max(begin, b[i][0]), min(end, b[i][1])))
            i += 1
    return found


def subtract(a, b):
    found, j = [], 0
    for begin, end in a:
        while j < len(b) and b[j][1] <= begin:
            j += 1
        i = j
        while i < len(b) and b[i][0] < end:
            if b[i][0] > begin:
                found.append((begin, b[i][0]))
            begin = max(begin, b[i][1])
            i += 1
        if begin < end:
            found.append((begin, end))
    return found


def length(pairs):
    return sum(end - begin for begin, end in pairs)


# --- a run

class Work(typing.NamedTuple):
    """What a chain did for a frame."""
    frame: Frame
    begin_ns: int  # the frame before has ended
    kernels: list


class RunRecords:
    """All frames of a run and all kernels, each with the frame that it is of."""

    def __init__(self, frames, kernels, usual=None):
        """@param kernels  by chain; BYSTANDER: of none
        @param usual    Usual by chain, if it is known"""
        self.works, self.tagged = {}, {}
        by_chain = collections.defaultdict(list)
        for frame in frames:
            by_chain[frame.chain].append(frame)
        for chain, its in kernels.items():
            its = sorted(its, key=lambda kernel: kernel.begin_ns)
            self.works[chain] = self.divide(sorted(by_chain[chain], key=lambda f: f.arrival_ns),
                                            its)
            self.tagged[chain] = self.tag(self.works[chain], its, (usual or {}).get(chain))
        self.begins = {chain: [kernel.begin_ns for kernel, _ in its]
                       for chain, its in self.tagged.items()}
        self.longest = {chain: max((kernel.end_ns - kernel.begin_ns for kernel, _ in its),
                                   default=0) for chain, its in self.tagged.items()}

    @staticmethod
    def divide(frames, kernels):
        """Frames of a chain are worked on one after the other."""
        begins, works, before_ns = [kernel.begin_ns for kernel in kernels], [], 0
        for frame in frames:
            begin = min(max(frame.arrival_ns, before_ns), frame.end_ns)
            its = kernels[bisect.bisect_left(begins, begin):
                          bisect.bisect_left(begins, frame.end_ns)]
            works.append(Work(frame, begin, its))
            before_ns = max(before_ns, frame.end_ns)
        return works

    @staticmethod
    def tag(works, kernels, usual):
        """@returns (kernel as it executes, its frame's deadline or None) in order"""
        if not works:
            return [(kernel, None) for kernel in kernels]
        tagged = []
        for work in works:
            deadline = work.frame.arrival_ns + work.frame.deadline_ns
            is_whole = usual and len(work.kernels) == len(usual.kernels_ns)
            for i, kernel in enumerate(work.kernels):
                if is_whole:
                    least = kernel.end_ns - MOST_TIMES * usual.kernels_ns[i]
                    kernel = kernel._replace(begin_ns=max(kernel.begin_ns, least))
                tagged.append((kernel, deadline))
        return sorted(tagged, key=lambda its: its[0].begin_ns)

    def others(self, chain, begin, end):
        """@returns (chain, kernel, its frame's deadline) that run in that time"""
        for other, its in self.tagged.items():
            if other == chain:
                continue
            first = bisect.bisect_left(self.begins[other], begin - self.longest[other])
            for kernel, deadline in its[first:bisect.bisect_left(self.begins[other], end)]:
                if kernel.end_ns > begin:
                    yield other, kernel, deadline


class Usual(typing.NamedTuple):
    """Of a chain's frames at low load, all in time."""
    kernels_ns: list  # medians, by position
    cpu_ns: float


def states(work):
    """@returns intervals of what the frame was at, from the begin of its work on"""
    frame = work.frame
    left = union([(work.begin_ns, frame.end_ns)])
    found = {}

    def take(name, pairs):
        nonlocal left
        found[name] = intersect(left, union(pairs))
        left = subtract(left, found[name])

    def holds(kind):
        return [(hold.begin_ns, hold.end_ns) for hold in frame.holds if hold.kind == kind]

    take("running", [(kernel.begin_ns, kernel.end_ns) for kernel in work.kernels])
    take("gate", holds("gate"))
    take("pending", [(kernel.launched_ns, kernel.begin_ns) for kernel in work.kernels])
    take("held", holds("held"))
    take("paced", holds("paced"))
    take("told_late", holds("wait"))
    found["held"] = union(found["held"] + found.pop("gate"))
    found["cpu"] = left
    return found


def usual_of(records):
    """@returns Usual by chain, of frames in time that have the usual number of kernels"""
    found = {}
    for chain, works in records.works.items():
        works = [work for work in works if not work.frame.cause and work.kernels]
        if chain == BYSTANDER or not works:
            continue
        count = statistics.mode(len(work.kernels) for work in works)
        works = [work for work in works if len(work.kernels) == count]
        found[chain] = Usual(
            [statistics.median(work.kernels[i].end_ns - work.kernels[i].begin_ns
                               for work in works) for i in range(count)],
            statistics.median(length(states(work)["cpu"]) for work in works))
    return found


def kind_of(deadline, own_deadline, was_there):
    """What work of another chain is to a frame. @param was_there  before the frame had to wait"""
    if deadline is None or deadline < own_deadline:
        return "shared"
    return "kernel_in_front" if was_there else "priority_late"


def by_others(records, work, pieces):
    """@returns {(kind, chain): time} that others' kernels ran in these pieces, each of which begins
    when the wait does"""
    frame = work.frame
    own_deadline = frame.arrival_ns + frame.deadline_ns
    found = collections.defaultdict(list)
    for begin, end in pieces:
        for chain, kernel, deadline in records.others(frame.chain, begin, end):
            kind = kind_of(deadline, own_deadline, kernel.begin_ns <= begin)
            found[kind, chain].append((max(begin, kernel.begin_ns), min(end, kernel.end_ns)))
    return {key: length(union(pairs)) for key, pairs in found.items()}


def growth(records, work, usual):
    """@returns own time beyond the usual, and {(kind, chain): time} of that which others took"""
    own = usual_own = beside = usual_beside = 0
    overlaps = collections.Counter()
    for kernel, its_usual in zip(work.kernels, usual.kernels_ns):
        took = kernel.end_ns - kernel.begin_ns
        with_it = by_others(records, work, [(kernel.begin_ns, kernel.end_ns)])
        if sum(with_it.values()) > BESIDE_SHARE * took:
            beside, usual_beside = beside + took, usual_beside + its_usual
            overlaps.update(with_it)
        else:
            own, usual_own = own + took, usual_own + its_usual
    # From too few of its kernels nothing is known of the others.
    is_known = usual_own > 0.1 * (usual_own + usual_beside)
    ratio = max(1.0, own / usual_own) if is_known else 1.0
    by_own = max(0, own - usual_own) + (ratio - 1) * usual_beside
    taken = max(0, beside - ratio * usual_beside)
    total = sum(overlaps.values())
    return by_own, {key: taken * time / total for key, time in overlaps.items()} if total else {}


def account(records, work, usual, usual_start_ns=0):
    """@param usual_start_ns  from arrival to begin, of the chain's frames in time
    @returns {(kind, behind): ns}, and {what: ns} that is no cause"""
    parts = states(work)
    found = collections.Counter()
    found["arrived_late", ""] = max(0, work.begin_ns - work.frame.arrival_ns - usual_start_ns)
    found["cpu_longer", ""] = max(0, length(parts["cpu"]) - usual.cpu_ns)
    found["gpu_longer", ""], taken = growth(records, work, usual)
    found.update(taken)
    # A wait may be cut in pieces by its own kernels: each is a wait for itself.
    found.update(by_others(records, work, parts["pending"]))
    for (_, chain), time in by_others(records, work, parts["held"]).items():
        found["held", chain] += time
    return dict(found), {"running": length(parts["running"]), "blocked": length(parts["pending"]),
                         "held": length(parts["held"]), "paced": length(parts["paced"]),
                         "told_late": length(parts["told_late"]), "cpu": length(parts["cpu"])}


def component_of(kind, chain):
    return ("taken" if kind in TAKEN else kind, chain)


def judge(frame, components):
    """@param components  {(kind, chain): ns}, as account() tells them
    @returns what is largest, its time, that of what is named, and whether that is right"""
    merged = collections.Counter()
    for key, time in components.items():
        merged[component_of(*key)] += time
    largest, most = merged.most_common(1)[0]
    least = max(LEAST_NS, FAIR_SHARE * frame.late_ns)
    named = merged[component_of(frame.cause, frame.behind)]

    def is_most(time, of):
        return time >= (1 - TOLERANCE) * of

    kind_right = True
    if frame.cause == "unknown":
        right = is_most(least, most)
    elif frame.cause == "given_up":
        # Its own times come before that. For whose frame it was, no kernel tells.
        by_others = max((max(merged["taken", chain], merged["held", chain])
                         for kind, chain in merged if kind not in OWN), default=0)
        by_own = max(merged[kind, ""] for kind in OWN)
        named = by_others
        right = is_most(max(by_others, least), by_own)
    else:
        right = named > 0 and is_most(named, most)
        kind_right = right and (frame.cause not in TAKEN or is_most(
            components.get((frame.cause, frame.behind), 0),
            max(components.get((kind, frame.behind), 0) for kind in TAKEN)))
    return {"largest": list(largest), "largest_ms": round(most / 1e6, 3),
            "named_ms": round(named / 1e6, 3), "right": right, "kind_right": right and kind_right}


def held_by_record(frame):
    """@returns by chain, ms: whether or not it had work of its own on the GPU meanwhile"""
    found = collections.Counter()
    for hold in frame.holds:
        if hold.kind in ("held", "gate"):
            found[hold.behind] += hold.end_ns - hold.begin_ns
    return {chain: round(time / 1e6, 3) for chain, time in found.most_common()}


def judge_run(records, usual, is_nominal=False):
    """@param is_nominal  kernels' times are as they should be, not as they were: the simulated GPU's
    @returns a verdict of each late frame that can be judged, and how many cannot, by reason"""
    verdicts, left_out = [], collections.Counter()
    for chain, works in records.works.items():
        starts = [work.begin_ns - work.frame.arrival_ns for work in works if not work.frame.cause]
        usual_start = statistics.median(starts) if starts else 0
        for work in works:
            frame = work.frame
            if not frame.cause:
                continue
            if frame.exited:
                left_out["ended early by its program"] += 1
            elif frame.cause not in JUDGED:
                left_out[frame.cause] += 1
            elif chain not in usual:
                left_out["nothing is usual for its chain"] += 1
            elif len(work.kernels) != len(usual[chain].kernels_ns):
                left_out["not all of its kernels"] += 1
            else:
                components, parts = account(records, work, usual[chain], usual_start)
                if is_nominal and parts["told_late"] > FAIR_SHARE * frame.late_ns:
                    left_out["the simulated GPU was late"] += 1
                    continue
                verdicts.append({
                    "chain": chain, "frame": frame.number, "cause": frame.cause,
                    "behind": frame.behind, "cause_ms": frame.cause_ns / 1e6,
                    "late_ms": frame.late_ns / 1e6,
                    "components": [[*key, round(time / 1e6, 3)] for key, time in sorted(
                        components.items(), key=lambda item: -item[1]) if time >= LEAST_NS],
                    "held_by_record_ms": held_by_record(frame),
                    "parts_ms": {name: round(time / 1e6, 3) for name, time in parts.items()},
                    **judge(frame, components)})
    return verdicts, dict(left_out)


def tally(verdicts):
    """@returns by cause: how many, how many right, how many of the right kind"""
    found = {}
    for verdict in verdicts:
        its = found.setdefault(verdict["cause"], {"frames": 0, "right": 0, "kind_right": 0})
        its["frames"] += 1
        its["right"] += verdict["right"]
        its["kind_right"] += verdict["kind_right"]
    return found
