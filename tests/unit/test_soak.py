#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What tools/bench/soak.py makes of configs and of what its parts found."""
import pathlib
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools/bench"))
import soak  # noqa: E402


def part(name, misses, **more):
    return {"part": name, "misses": misses, "results": "ok", "tripped": "", "calls": [],
            "gates": None, **more}


def gates(past_bound):
    return {"closed": 9, "parks": 2, "most_park_us": 7.5, "past_bound": past_bound,
            "most_past_us": 5001.0 * past_bound}


class Soak(unittest.TestCase):
    def test_periods_are_divided_and_all_else_stays(self):
        text = soak.scaled("chains:\n  - name: C0\n    period_ms: 90\n    deadline_ms: 60\n"
                           "# period_ms: none\n", 0.9, "device, device: leased")
        self.assertIn("    period_ms: 100.000000\n    deadline_ms: 60\n# period_ms: none\n", text)
        self.assertIn("scheduler: {dispatch: {where: device, device: leased}}", text)

    def test_every_second_disturbed_part_has_no_cooperative_launches(self):
        self.assertEqual(soak.parts(5), [("quiet", None), ("disturbed", ""), ("quiet", None),
                                         ("disturbed", "cooperative"), ("quiet", None)])

    def test_call_under_way_is_told_with_its_time(self):
        with tempfile.TemporaryDirectory() as folder:
            state = pathlib.Path(folder, "state")
            self.assertEqual(soak.under_way(state), "")
            state.write_text(f"{'cuMemFree':40}{time.monotonic() - 3:20.6f}\n")
            self.assertRegex(soak.under_way(state), r"^cuMemFree, for 3\.\d s$")
            state.write_text(f"{'-':40}{time.monotonic():20.6f}\n")
            self.assertEqual(soak.under_way(state), "")

    def test_misses_of_disturbed_parts_are_compared_with_those_of_quiet_ones(self):
        found = [part("quiet", 0.10), part("disturbed", 0.12), part("quiet", 0.10)]
        self.assertEqual(soak.what_is_wrong(found, soak.summary(found), True), [])
        found.append(part("disturbed", 0.20))  # 16 % together
        wrong = soak.what_is_wrong(found, soak.summary(found), True)
        self.assertEqual(wrong, ["misses 16.0 % disturbed, 10.0 % quiet"])
        self.assertEqual(soak.what_is_wrong(found, soak.summary(found), False), [])

    def test_gates_that_open_late_and_wrong_results_are_told(self):
        found = [part("quiet", 0, gates=gates(0)), part("disturbed", 0, gates=gates(1),
                                                        results="BAD")]
        wrong = soak.what_is_wrong(found, soak.summary(found), True)
        self.assertEqual(wrong, ["part 1: results BAD",
                                 "1 gates opened past their bound, by 5001 us at most"])

    def test_calls_of_all_parts_are_put_together(self):
        call = {"call": "cuMemFree", "count": 3, "p50_us": 10, "p99_us": 20, "max_us": 30}
        later = {**call, "count": 5, "p50_us": 20, "max_us": 25}
        found = [part("disturbed", 0, calls=[call]), part("disturbed", 0, calls=[later])]
        self.assertEqual(soak.summary(found)["calls"]["cuMemFree"],
                         {"count": 8, "p50_us": 15.0, "p99_us": 20, "max_us": 30})


if __name__ == "__main__":
    unittest.main()
