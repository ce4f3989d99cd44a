#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What a program measures with timing events stays true under UrgenGo.

An autotuner's way of timing, in PyTorch and Triton: the L2 cache is flushed, then one kernel runs
between two timing events, many times. Under UrgenGo, alone and beside a more urgent chain that is
busy, the kernel's times must be distributed as they are bare, in the same company: a hold or a mark
between the events would show as a longer time. Bare is run twice, which shows the noise; the other
has a stream of the greatest priority then, too, since that is what a more urgent chain has. Beside
it, times may be shorter than bare, if UrgenGo had the two run after each other. And a program that
times whole inferences of many launches must still be held.

  tests/gpu/timing_events.py --build build/release --out result.json

Exit status 0 if so, 1 if not, 77 (skipped) without the packages or a GPU.
"""
import argparse
import json
import statistics
import sys
import tempfile

import equality
from equality import Row

try:
    import triton
    import triton.language as tl
except ImportError:  # then main() skips
    triton = None

NUM_TIMES = 1000
LAUNCHES_PER_INFERENCE = 40
NUM_INFERENCES = 50
# The other's blocks: one on each of an H200's SMs, so that it disturbs a kernel little, and yet the
# two are more than the GPU holds at once, so that the less urgent one is held.
OTHER_BLOCKS = 132

OTHER_PRIORITY = -5  # beyond the range counts as its end

# The median may differ so much from bare, and a time so far above that is slow. A mark takes
# about 1.5 us, the kernel about 15, a hold at least 50.
MEDIAN_TOLERANCE = {False: 0.04, True: 0.10}  # beside
SLOW_US = {False: 0.8, True: 20}
SLOW_SHARE_TOLERANCE = 0.03

ROWS = (Row("bare", "bare"), Row("bare again", "bare"), Row("preload, no config", "preload"),
        Row("enforce", "enforce"), Row("bystander", "enforce", bystander=True),
        Row("bare, beside", "bare", beside=True), Row("bare, beside, again", "bare", beside=True),
        Row("enforce, beside", "enforce", beside=True),
        Row("bystander, beside", "enforce", beside=True, bystander=True))

if triton:

    @triton.jit
    def scale_add_kernel(out, x, y, size, BLOCK: tl.constexpr):
        offsets = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
        inside = offsets < size
        tl.store(out + offsets, tl.load(x + offsets, mask=inside) * 0.5 +
                 tl.load(y + offsets, mask=inside), mask=inside)


class Program:
    """Times one kernel, and inferences of many."""

    def __init__(self):
        import torch

        self.torch, self.size = torch, 1 << 22
        self.x, self.y = torch.randn(self.size).cuda(), torch.randn(self.size).cuda()
        self.out = torch.empty_like(self.x)
        self.flush = torch.empty(512 << 20, dtype=torch.uint8, device="cuda")
        for _ in range(20):
            self.flush.zero_()
            self.launch()
        torch.cuda.synchronize()

    def launch(self):
        scale_add_kernel[(triton.cdiv(self.size, 1024),)](self.out, self.x, self.y, self.size,
                                                          BLOCK=1024, num_warps=4)

    def time(self, launch):
        """@returns microseconds between two events around it, on a GPU that is busy before"""
        begin, end = (self.torch.cuda.Event(enable_timing=True) for _ in range(2))
        # Long enough for the host to be ahead: what is timed is the GPU, and not the launching.
        self.flush.zero_()
        begin.record()
        launch()
        end.record()
        end.synchronize()
        return begin.elapsed_time(end) * 1000

    def time_kernel(self):
        return [self.time(self.launch) for _ in range(NUM_TIMES)]

    def time_inferences(self):
        def infer():
            for _ in range(LAUNCHES_PER_INFERENCE):
                self.launch()

        return [self.time(infer) for _ in range(NUM_INFERENCES)]


def work(what, beside, make_program):
    """In a process of its own: prints times as one line of JSON."""
    times_us = []
    equality.run_as_chain(lambda: times_us.extend(getattr(make_program(), what)()), beside,
                          blocks=OTHER_BLOCKS, priority=OTHER_PRIORITY)
    print(json.dumps({"times_us": times_us}))


def slow_share(row, times_us, median):
    return sum(time > median + SLOW_US[row.beside] for time in times_us) / len(times_us)


def compare(row, times_us, bare, bare_again, alone):
    """@param bare   in the same company   @param alone  bare, without any
    @returns what differs from bare by more than bare from bare; empty if nothing does"""
    reference, median = statistics.median(bare), statistics.median(times_us)
    noise = abs(statistics.median(bare_again) / reference - 1)
    tolerance = max(MEDIAN_TOLERANCE[row.beside], 2 * noise)
    least = min(reference, statistics.median(alone)) * (1 - tolerance)
    if not least <= median <= reference * (1 + tolerance):
        return (f"{row.name}: found a median of {median:.2f} us, accepted: {least:.2f} to "
                f"{reference * (1 + tolerance):.2f}")
    usual = max(slow_share(row, bare, reference), slow_share(row, bare_again, reference))
    share, accepted = slow_share(row, times_us, reference), usual + SLOW_SHARE_TOLERANCE
    if share > accepted:
        return (f"{row.name}: found {100 * share:.1f} % of slow times, accepted: up to "
                f"{100 * accepted:.1f} %")
    return ""


def print_row(row, times_us, reference, counts):
    ordered = sorted(times_us)
    p90, p99 = (ordered[int(share * len(ordered))] for share in (0.9, 0.99))
    print(f"{row.name:<24} median {statistics.median(times_us):8.2f} us"
          f"  p90 {p90:8.2f}  p99 {p99:8.2f}"
          f"  slow {100 * slow_share(row, times_us, reference):5.1f} %"
          f"  marks {counts.get('marks', '-'):>5} holds {counts.get('holds', '-'):>5}", flush=True)


def run_rows(command, args):
    """@returns results by row, and what is wrong"""
    results, wrong = {}, []
    with tempfile.TemporaryDirectory() as folder:
        for row in ROWS:
            result = equality.run_row(row, command + ["--work", "time_kernel"], {},
                                      equality.CHAIN_THREAD, args.build, folder)
            results[row.name] = result
            bare, again = (results.get(f"bare{', beside' * row.beside}{end}", result)["times_us"]
                           for end in ("", ", again" if row.beside else " again"))
            counts = equality.counts_of(result, "measured")
            print_row(row, result["times_us"], statistics.median(bare), counts)
            if row.runs != "bare":
                wrong.append(compare(row, result["times_us"], bare, again,
                                     results["bare"]["times_us"]))
            if row.runs == "enforce" and not row.bystander and not counts["scheduled"]:
                wrong.append(f"{row.name}: nothing was scheduled: it shows nothing")
        row = Row("inferences, beside", "enforce", beside=True)
        result = equality.run_row(row, command + ["--work", "time_inferences"], {},
                                  equality.CHAIN_THREAD, args.build, folder)
        results[row.name] = result
        counts = equality.counts_of(result, "measured")
        print_row(row, result["times_us"], statistics.median(result["times_us"]), counts)
        if not counts["holds"]:
            wrong.append("inferences timed by events are not held")
    return results, [text for text in wrong if text]


def main(packages=("torch", "triton"), make_program=Program):
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    equality.add_options(parser, with_rows=False)
    parser.add_argument("--work", help=argparse.SUPPRESS)
    parser.add_argument("--beside", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.work:
        work(args.work, args.beside, make_program)
        return
    equality.skip_if(equality.why_not_here(packages))
    args.build = equality.check_build(args.build)
    results, wrong = run_rows([sys.executable, sys.argv[0]], args)
    if args.out:
        equality.write_json(args.out, {
            **equality.where_and_when("tests/gpu/timing_events.py", args.build, args.commit),
            "tolerance": {"median, alone and beside": list(MEDIAN_TOLERANCE.values()),
                          "slow_us, alone and beside": list(SLOW_US.values()),
                          "slow_share": SLOW_SHARE_TOLERANCE},
            "wrong": wrong,
            "rows": {name: {"times_us": [round(time, 2) for time in result["times_us"]],
                            "statistics": result.get("statistics", {}).get("chains", [])}
                     for name, result in results.items()}})
    sys.exit("\n".join(wrong) or 0)


if __name__ == "__main__":
    main()
