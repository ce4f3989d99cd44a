# SPDX-License-Identifier: Apache-2.0
"""tools/bench/profile_accuracy.py: what is read of traces and profiles, and how it is judged."""
import pathlib
import sys
import unittest

BENCH = pathlib.Path(__file__).resolve().parents[2] / "tools/bench"
sys.path[:0] = [str(BENCH), str(BENCH / "programs")]
import kernel_intervals  # noqa: E402
import networks  # noqa: E402
import profile_accuracy  # noqa: E402


def event(category, ts, dur, stream=7, name="k"):
    return {"ph": "X", "cat": category, "name": name, "ts": ts, "dur": dur,
            "args": {"stream": stream}}


def frame(ts):
    return event("user_annotation", ts, 90, name="frame 1")


def trace(*events):
    return {"traceEvents": [{"ph": "M", "name": "process_name"}, *events]}


def truth(**changes):
    return {"latency_ms": 2.0, "busy_ms": 1.0, "sum_ms": 1.0, "span_ms": 1.5,
            "streams": 1} | changes


def profiled(busy_ms, num_kernels=4):
    return {"busy_ms": busy_ms, "num_kernels": num_kernels}


class Intervals(unittest.TestCase):
    def test_union_counts_what_is_side_by_side_once(self):
        self.assertEqual(kernel_intervals.union_us([(0, 10), (5, 12), (6, 7), (20, 25)]), 17)
        self.assertEqual(kernel_intervals.union_us([]), 0)

    def test_frames_are_told_apart_by_annotations(self):
        frames = kernel_intervals.read_trace(trace(
            event("kernel", 50, 5), frame(100), event("kernel", 110, 5), event("cpu_op", 111, 50),
            event("gpu_user_annotation", 112, 9, name="frame 1"), frame(200),
            event("kernel", 205, 5), event("gpu_memcpy", 220, 5)))
        self.assertEqual([len(its) for its in frames], [1, 2])

    def test_busy_sum_span_and_side_streams(self):
        its = kernel_intervals.of_frames(kernel_intervals.read_trace(trace(
            *(one for at in (0, 1000) for one in (
                frame(at), event("gpu_memcpy", at, 100), event("kernel", at + 100, 100),
                event("kernel", at + 150, 100, stream=9), event("kernel", at + 300, 100))))))
        self.assertEqual((its["busy_ms"], its["sum_ms"], its["span_ms"]), (0.25, 0.3, 0.3))
        self.assertEqual((its["streams"], its["kernels"], its["frames"]), (2, 3, 2))
        self.assertEqual(its["busy_with_copies_ms"], 0.35)
        self.assertAlmostEqual(its["side_share"], 1 / 3, places=3)

    def test_frame_with_another_number_of_kernels_does_not_count(self):
        its = kernel_intervals.of_frames(kernel_intervals.read_trace(trace(
            frame(0), event("kernel", 1, 10), frame(100), event("kernel", 101, 10), frame(200),
            event("kernel", 201, 50), event("kernel", 260, 50))))
        self.assertEqual((its["busy_ms"], its["frames"], its["other_frames"]), (0.01, 2, 1))

    def test_trace_without_kernels_is_refused(self):
        self.assertRaises(ValueError, kernel_intervals.of_frames,
                          kernel_intervals.read_trace(trace(frame(0))))


class Judged(unittest.TestCase):
    def judge(self, its, source="cupti", **changes):
        return profile_accuracy.judge(truth(**changes), its, source)

    def test_busy_time_within_and_beyond(self):
        self.assertEqual(self.judge(profiled(1.04))["verdict"], "within")
        self.assertEqual(self.judge(profiled(1.06))["verdict"], "busy")
        self.assertEqual(self.judge(profiled(0.94))["error_pct"], -6)
        self.assertEqual(self.judge(profiled(1.09), "marks")["verdict"], "within")

    def test_gpu_bound_one_is_compared_with_its_latency(self):
        its = self.judge(profiled(0.98), latency_ms=1.04)
        self.assertEqual((its["of_latency_pct"], its["verdict"]), (-5.77, "latency"))
        self.assertNotIn("of_latency_pct", self.judge(profiled(1.0)))
        # No estimate could be within 5 % of both.
        self.assertNotIn("of_latency_pct", self.judge(profiled(1.0), latency_ms=1.08))

    def test_forked_one_may_be_refused_by_marks_but_not_by_cupti(self):
        for nothing in (None, profiled(0, 0)):
            self.assertEqual(self.judge(nothing, "marks", streams=4)["verdict"], "refused")
            self.assertEqual(self.judge(nothing, "cupti", streams=4)["verdict"], "not learned")
            self.assertEqual(self.judge(nothing, "marks")["verdict"], "not learned")
        self.assertEqual(self.judge(profiled(1.2), "marks", streams=4)["verdict"], "within")

    def test_kernels_of_a_profile_add_up(self):
        found = profile_accuracy.of_profile({"chains": [{"name": "a", "tasks": [{
            "name": "infer", "instances": 3, "segments": [{"latency_ns": 2_000_000}],
            "kernels": [{"gpu_time_ns": 400_000}, {"gpu_time_ns": 600_000}]}]}]})["a"]
        self.assertEqual((found["busy_ms"], found["latency_ms"], found["num_kernels"],
                          found["instances"]), (1.0, 2.0, 2, 3))


class Chosen(unittest.TestCase):
    def test_all_forms_are_there_and_each_network_once(self):
        its = profile_accuracy.assigned(list(networks.KINDS), [])
        self.assertEqual({form for _, form in its}, set(networks.FORMS))
        self.assertEqual(len({name for name, _ in its}), len(its))
        self.assertGreaterEqual(len(its), 25)

    def test_parts_are_all(self):
        its = profile_accuracy.assigned(list(networks.KINDS), [])
        parts = [one for part in ("1/3", "2/3", "3/3")
                 for one in profile_accuracy.part_of(its, part)]
        self.assertEqual(sorted(parts), sorted(its))
        for wrong in ("0/3", "4/3", "x", "1"):
            self.assertRaises(ValueError, profile_accuracy.part_of, its, wrong)

    def test_groups_have_one_form_and_so_many(self):
        its = profile_accuracy.assigned(list(networks.KINDS), [])
        groups = profile_accuracy.groups_of(its, 5)
        self.assertEqual(sorted(sum(groups, [])), sorted(its))
        for group in groups:
            self.assertLessEqual(len(group), 5)
            self.assertEqual(len({form for _, form in group}), 1)


if __name__ == "__main__":
    unittest.main()
