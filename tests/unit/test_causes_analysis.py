# SPDX-License-Identifier: Apache-2.0
"""tools/bench/causes_analysis.py: a frame that was late for each cause, rightly and wrongly named."""
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools/bench"))
import causes_analysis as analysis  # noqa: E402
import causes_check as check  # noqa: E402
import cupti_library  # noqa: E402
from causes_analysis import Frame, Hold, Kernel  # noqa: E402

MS = 1_000_000
DEADLINE = 20 * MS
# Usual: 5 ms of CPU time, then two kernels of 5 ms each, launched 0.1 ms apart.
CPU, KERNEL = 5 * MS, 5 * MS


def kernels_at(begin, lengths=(KERNEL, KERNEL), launched=None):
    """One after the other; launched when the first one begins, if not told."""
    found = []
    for length in lengths:
        found.append(Kernel(begin if launched is None else launched, begin, begin + length))
        launched, begin = found[0].launched_ns, begin + length
    return found


class Causes(unittest.TestCase):
    def setUp(self):
        self.usual = {"A": analysis.Usual([KERNEL, KERNEL], CPU)}

    def verdict(self, end, own, others=None, cause="unknown", behind="", holds=(), frames=(),
                arrival=0, **more):
        """@param others  {chain: kernels}; @param frames  theirs, and earlier ones of A"""
        frame = Frame("A", 1, arrival, end, DEADLINE, cause, behind, holds=tuple(holds), **more)
        records = analysis.RunRecords([frame, *frames], {"A": own, **(others or {})}, self.usual)
        verdicts, self.left_out = analysis.judge_run(records, self.usual)
        return verdicts[0] if verdicts else None

    def check(self, right, *wrong, **run):
        """@param right, wrong  (cause, behind)"""
        for named, accepted in ((right, True), *((each, False) for each in wrong)):
            verdict = self.verdict(cause=named[0], behind=named[1], **run)
            self.assertEqual(verdict["right"], accepted, (named, verdict))
        return dict(((kind, chain), ms) for kind, chain, ms in verdict["components"])

    def test_cpu_that_takes_longer(self):
        found = self.check(("cpu_longer", ""), ("gpu_longer", ""), ("held", "B"), ("shared", ""),
                           ("arrived_late", ""), ("unknown", ""), ("given_up", ""),
                           end=30 * MS, own=kernels_at(20 * MS))
        self.assertEqual(found, {("cpu_longer", ""): 15})

    def test_gap_between_kernels_is_the_cpus(self):
        own = [*kernels_at(5 * MS, [KERNEL]), *kernels_at(25 * MS, [KERNEL])]
        self.assertEqual(self.check(("cpu_longer", ""), ("gpu_longer", ""), end=30 * MS, own=own),
                         {("cpu_longer", ""): 15})

    def test_kernels_that_take_longer_alone(self):
        found = self.check(("gpu_longer", ""), ("cpu_longer", ""), ("shared", "B"), ("held", "B"),
                           end=30 * MS, own=kernels_at(5 * MS, [10 * MS, 15 * MS]))
        self.assertEqual(found, {("gpu_longer", ""): 15})

    def test_kernel_that_takes_longer_beside_anothers(self):
        # The first is as usual, alone; the second takes 15 ms longer, beside B's all the time.
        others = {"B": [Kernel(9 * MS, 10 * MS, 31 * MS)]}
        frames = [Frame("B", 1, 8 * MS, 32 * MS, 5 * MS)]
        found = self.check(("shared", "B"), ("gpu_longer", ""), ("held", "B"), ("shared", "C"),
                           end=30 * MS, own=kernels_at(5 * MS, [KERNEL, 20 * MS]), others=others,
                           frames=frames)
        self.assertEqual(found, {("shared", "B"): 15})

    def test_growth_seen_in_kernels_alone_is_taken_for_its_own_in_the_others(self):
        # The first takes 3 times as long, alone: so would the second, beside B.
        found = self.check(("gpu_longer", ""), ("shared", "B"), end=35 * MS,
                           own=kernels_at(5 * MS, [15 * MS, 15 * MS]),
                           others={"B": [Kernel(19 * MS, 20 * MS, 35 * MS)]},
                           frames=[Frame("B", 1, 8 * MS, 36 * MS, 5 * MS)])
        self.assertEqual(found, {("gpu_longer", ""): 20})

    def blocked(self, their_begin, their_deadline):
        """Launched at 5 ms, begins at 20."""
        return {"end": 30 * MS, "own": kernels_at(20 * MS, launched=5 * MS),
                "others": {"B": [Kernel(1 * MS, their_begin, 20 * MS)],
                           "C": [Kernel(1 * MS, 5 * MS, 8 * MS)]},
                "frames": [Frame("B", 1, 0, 25 * MS, their_deadline), Frame("C", 1, 0, 25 * MS, 1)]}

    def test_launch_that_is_blocked_by_more_urgent_work(self):
        found = self.check(("shared", "B"), ("shared", "C"), ("cpu_longer", ""), ("gpu_longer", ""),
                           ("held", "B"), **self.blocked(6 * MS, 10 * MS))
        self.assertEqual(found, {("shared", "B"): 14, ("shared", "C"): 3})

    def test_kernel_that_was_taken_up_early_counts_from_when_it_may_have_begun(self):
        # B's kernel takes 2 ms, and CUPTI tells of 14, as C's were in front of both.
        self.usual["B"] = analysis.Usual([2 * MS], 0)
        found = self.check(("shared", "C"), ("shared", "B"), end=30 * MS,
                           own=kernels_at(20 * MS, launched=5 * MS),
                           others={"B": [Kernel(1 * MS, 6 * MS, 20 * MS)],
                                   "C": [Kernel(1 * MS, 5 * MS, 16 * MS)]},
                           frames=[Frame("B", 1, 0, 25 * MS, 1), Frame("C", 1, 0, 25 * MS, 1)])
        self.assertEqual(found, {("shared", "B"): 4, ("shared", "C"): 11})

    def test_kernel_in_front_and_late_priority_are_told_apart_by_when_it_began(self):
        front, late = self.blocked(4 * MS, 90 * MS), self.blocked(6 * MS, 90 * MS)
        self.assertIn(("kernel_in_front", "B"),
                      self.check(("kernel_in_front", "B"), ("held", "B"), **front))
        self.assertIn(("priority_late", "B"),
                      self.check(("priority_late", "B"), ("held", "B"), **late))
        for run, kind, other in ((front, "kernel_in_front", "priority_late"),
                                 (late, "priority_late", "kernel_in_front")):
            self.assertTrue(self.verdict(cause=kind, behind="B", **run)["kind_right"])
            verdict = self.verdict(cause=other, behind="B", **run)
            self.assertTrue(verdict["right"])  # it is what B took
            self.assertFalse(verdict["kind_right"])

    def test_bystanders_work_has_no_chain(self):
        found = self.check(("shared", ""), ("shared", "B"), ("gpu_longer", ""), end=30 * MS,
                           own=kernels_at(20 * MS, launched=5 * MS),
                           others={analysis.BYSTANDER: [Kernel(1 * MS, 4 * MS, 20 * MS)]})
        self.assertEqual(found, {("shared", ""): 15})

    def held(self, kind="held"):
        """Held from 5 to 20 ms, while B's kernels run for 10 of them and C's for 4."""
        return {"end": 30 * MS, "own": kernels_at(20 * MS),
                "holds": [Hold(5 * MS, 20 * MS, kind, "C")],
                "others": {"B": [Kernel(0, 6 * MS, 16 * MS)], "C": [Kernel(0, 16 * MS, 20 * MS)]},
                "frames": [Frame("B", 1, 0, 25 * MS, 1), Frame("C", 1, 0, 25 * MS, 1)]}

    def test_hold_is_behind_whose_kernels_ran_whatever_its_record_says(self):
        found = self.check(("held", "B"), ("held", "C"), ("shared", "B"), ("cpu_longer", ""),
                           **self.held())
        self.assertEqual(found, {("held", "B"): 10, ("held", "C"): 4})

    def test_hold_at_a_gate_is_one_although_its_launch_was_made(self):
        run = self.held("gate")
        run["own"] = kernels_at(20 * MS, launched=5 * MS)
        self.check(("held", "B"), ("shared", "B"), **run)

    def test_hold_while_its_own_kernels_run_costs_nothing(self):
        run = self.held()
        run.update(own=kernels_at(5 * MS, [KERNEL, 20 * MS]), others={}, frames=[])
        self.assertEqual(self.check(("gpu_longer", ""), ("held", "B"), ("held", "C"), **run),
                         {("gpu_longer", ""): 15})

    def test_pacing_and_late_answers_are_not_the_cpus(self):
        for kind in ("paced", "wait"):
            run = {"end": 30 * MS, "own": kernels_at(20 * MS),
                   "holds": [Hold(5 * MS, 20 * MS, kind, "")]}
            self.check(("unknown", ""), ("cpu_longer", ""), **run)

    def test_frame_that_begins_late_as_the_one_before_it_was(self):
        before = Frame("A", 0, 0, 15 * MS, DEADLINE)
        run = {"arrival": 1 * MS, "end": 30 * MS, "frames": [before],
               "own": kernels_at(5 * MS) + kernels_at(20 * MS)}
        self.assertEqual(self.check(("arrived_late", ""), ("cpu_longer", ""), ("unknown", ""),
                                    **run), {("arrived_late", ""): 14})

    def test_begin_is_late_by_what_is_more_than_usual(self):
        # Of four frames in time two began 4 ms after their arrivals, the others at once: 14 is 12 more
        # than their median.
        earlier = [Frame("A", n, t * MS, (t + 15) * MS, DEADLINE)
                   for n, t in ((1, 0), (2, 11), (3, 22), (4, 100))]
        found = self.check(("arrived_late", ""), ("cpu_longer", ""), arrival=101 * MS,
                           end=130 * MS, frames=earlier, own=kernels_at(120 * MS))
        self.assertEqual(found, {("arrived_late", ""): 12})

    def test_too_little_of_the_lateness_is_unknown(self):
        # Late by 10 ms, of which 2 are the CPU's and the others are not known.
        run = {"end": 30 * MS, "own": kernels_at(20 * MS), "holds": [Hold(7 * MS, 20 * MS, "paced",
                                                                          "")]}
        self.check(("unknown", ""), ("gpu_longer", ""), **run)

    def test_what_is_within_a_tenth_of_the_largest_is_right(self):
        # 10 ms more of the CPU's, 9.5 of its kernels'; then 8.
        for longer, right in ((9.5, True), (8, False)):
            own = kernels_at(15 * MS, [KERNEL, int((5 + longer) * MS)])
            verdict = self.verdict(end=own[-1].end_ns, cause="gpu_longer", own=own)
            self.assertEqual(verdict["right"], right)

    def test_given_up_is_right_where_others_took_most(self):
        for behind in ("B", "C"):  # for whose frame, no kernel tells
            self.check(("given_up", behind), **self.held())
        self.check(("given_up", ""), **self.held())
        self.check(("cpu_longer", ""), ("given_up", ""), ("given_up", "B"), end=30 * MS,
                   own=kernels_at(20 * MS))

    def test_frames_that_cannot_be_judged_are_counted(self):
        self.assertIsNone(self.verdict(end=30 * MS, own=kernels_at(5 * MS, [KERNEL]),
                                       cause="cpu_longer"))
        self.assertEqual(self.left_out, {"not all of its kernels": 1})
        self.assertIsNone(self.verdict(end=30 * MS, own=kernels_at(5 * MS), cause="given_up",
                                       exited=True))
        self.assertEqual(self.left_out, {"ended early by its program": 1})
        self.assertIsNone(self.verdict(end=30 * MS, own=kernels_at(5 * MS), cause="off"))
        self.assertEqual(self.left_out, {"off": 1})
        self.usual = {}
        self.assertIsNone(self.verdict(end=30 * MS, own=kernels_at(5 * MS), cause="cpu_longer"))
        self.assertEqual(self.left_out, {"nothing is usual for its chain": 1})

    def test_frame_that_a_simulated_gpu_was_late_for_is_left_out_there_alone(self):
        frame = Frame("A", 1, 0, 30 * MS, DEADLINE, "unknown", holds=(Hold(5 * MS, 20 * MS, "wait",
                                                                           ""),))
        records = analysis.RunRecords([frame], {"A": kernels_at(20 * MS)})
        self.assertEqual(len(analysis.judge_run(records, self.usual)[0]), 1)
        self.assertEqual(analysis.judge_run(records, self.usual, is_nominal=True),
                         ([], {"the simulated GPU was late": 1}))

    def test_usual_is_of_frames_in_time(self):
        frames = [Frame("A", i, i * 100 * MS, i * 100 * MS + 15 * MS, DEADLINE) for i in range(2)]
        frames += [Frame("A", i, i * 100 * MS, i * 100 * MS + 90 * MS, DEADLINE, "gpu_longer")
                   for i in range(2, 6)]
        own = [kernel for frame in frames for kernel in kernels_at(
            frame.arrival_ns + CPU, [KERNEL, 80 * MS if frame.cause else KERNEL])]
        usual = analysis.usual_of(analysis.RunRecords(frames, {"A": own}))
        self.assertEqual(usual, self.usual)


RECORDS = """clock 1000000000 5000
thread 71 C0
thread 72 bystander
launch 1 71 5100
launch 2 72 5150
kernel 9 1 1000000200 1000000300 chains_comp
kernel 8 2 1000000300 1000000400 chains_mem
kernel 9 3 1000000400 1000000500 chains_comp
kernel 9 1 1000000310 1000000320 urgengo_mark
dropped 3
clock 1000001000 6001
"""
CSV = """kind,chain,frame,task,thread,begin_ns,end_ns,why,behind,cause_ns,value
frame,C0,1,,,100,900,held,C1,250,
task,C0,1,t,71,110,890,,,,
held,C0,1,t,71,200,300,more urgent work fills the GPU,C1,,
paced,C0,1,t,71,300,400,its own work is far enough ahead of the GPU,,,
held,C0,2,t,71,950,,more urgent work fills the GPU,C1,,
frame,C0,2,,,500,1100,given_up,,10,
executed,C0,,t,71,600,600,,,,5
frame,C1,1,,,100,200,,,,
frame,C1,2,,,300,,,,,
"""


class Reading(unittest.TestCase):
    def test_kernels_are_of_the_chain_whose_thread_launched_them(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder, "records")
            path.write_text(RECORDS)
            records = cupti_library.read_records(path)
        self.assertEqual(records.dropped, 3)
        kernels, unknown = check.kernels_by_chain(records, ["C0", "C1"])
        self.assertEqual(unknown, 1)
        self.assertEqual(kernels["C1"], [])
        (kernel,) = kernels["C0"]
        self.assertEqual(kernel.launched_ns, 5100)
        self.assertAlmostEqual(kernel.begin_ns, 5200.2)  # their clock is 0.1 % slower
        self.assertAlmostEqual(kernel.end_ns, 5300.3)
        self.assertEqual([round(k.launched_ns) for k in kernels[analysis.BYSTANDER]], [5150, 5400])

    def test_frames_have_their_holds_and_causes(self):
        info = {"chains": [{"name": "C0", "deadline_ms": 0.0005},
                           {"name": "C1", "deadline_ms": 0.0005}],
                "late": [{"chain": "C0", "frame": 1, "exited": False},
                         {"chain": "C0", "frame": 2, "exited": True}]}
        late, exited, in_time = check.read_frames(CSV.splitlines(keepends=True), info)
        self.assertEqual(late, Frame("C0", 1, 100, 900, 500, "held", "C1", 250, False, (
            Hold(200, 300, "held", "C1"), Hold(300, 400, "paced", ""))))
        self.assertEqual(late.late_ns, 300)
        self.assertTrue(exited.exited)
        self.assertEqual((in_time.chain, in_time.cause), ("C1", ""))

    def test_disturbances_are_of_the_chains_that_they_name(self):
        workload = {"chains": [{"name": name, "tasks": [
            {"cpu_ms": 1, "kernels": [{"iterations": 3}]},
            {"cpu_ms": 1, "kernels": [{"iterations": 3}]}]} for name in ("C0", "C1")]}
        found = check.disturbed(workload, {"cpu_more_ms": {"C1": 25}, "gpu_times": {"C0": 2}})
        self.assertEqual([[(task["cpu_ms"], task["kernels"][0]["iterations"])
                           for task in chain["tasks"]] for chain in found["chains"]],
                         [[(1, 6), (1, 6)], [(26, 3), (1, 3)]])


if __name__ == "__main__":
    unittest.main()
