# SPDX-License-Identifier: Apache-2.0
"""tools/bench/watching_cost.py: what counts as more, and what an NVTX tool's recording says."""
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools/bench"))
import watching_cost as cost  # noqa: E402


def runs_of(row, misses, cpu=10.0, **more):
    return [{"row": row, "seed": seed, "miss_pct": miss, "cpu_s": cpu, **more}
            for seed, miss in enumerate(misses)]


class Watching(unittest.TestCase):
    def unmet(self, *rows):
        runs = [run for row in rows for run in row]
        return cost.unmet_goals(cost.differences(runs), runs)

    def test_differences_are_paired_by_seed(self):
        # The seeds differ by 20 points, trace by 1 within each seed: paired, that is beyond noise.
        found = cost.differences(runs_of("plain", [10, 20, 30]) +
                                 runs_of("trace", [11.1, 21.0, 30.9]))["trace to plain"]
        self.assertAlmostEqual(found["miss_pct"]["mean_more"], 1.0)
        low, high = found["miss_pct"]["interval"]
        self.assertAlmostEqual(low, 1 - 4.303 * 0.1 / 3 ** 0.5)
        self.assertAlmostEqual(high, 1 + 4.303 * 0.1 / 3 ** 0.5)

    def test_seed_that_one_row_lacks_is_left_out(self):
        found = cost.differences(runs_of("plain", [10, 20, 30]) + runs_of("trace", [10, 20]))
        self.assertEqual(found["trace to plain"]["seeds"], [0, 1])

    def test_more_beyond_the_interval_is_told_and_less_is_not(self):
        plain = runs_of("plain", [10, 20, 30])
        self.assertEqual(self.unmet(plain, runs_of("trace", [9, 21, 30])), [])
        self.assertEqual(self.unmet(plain, runs_of("trace", [9, 19.1, 28.9])), [])
        more = self.unmet(plain, runs_of("trace", [11.1, 21, 30.9]))
        self.assertEqual(len(more), 1)
        self.assertIn("trace to plain: more misses", more[0])

    def test_cpu_time_counts_for_observe_alone(self):
        self.assertEqual(self.unmet(runs_of("plain", [1, 1, 1]), runs_of("trace", [1, 1, 1], 11)),
                         [])
        more = self.unmet(runs_of("bare", [1, 1, 1]), runs_of("observe", [1, 1, 1], 11))
        self.assertEqual(len(more), 1)
        self.assertIn("observe to bare: more CPU time", more[0])

    def test_what_a_row_with_itself_differs_by_is_no_goal(self):
        self.assertEqual(self.unmet(runs_of("plain", [1, 2, 3]), runs_of("again", [5, 6, 7])), [])

    def test_errors_of_the_protocol_and_silence_are_told(self):
        for nvtx in ({"events": 5, "errors": 1, "first_errors": ["ERROR pop"]},
                     {"events": 0, "errors": 0, "first_errors": []}):
            self.assertEqual(len(self.unmet(runs_of("nvtx", [1], nvtx=nvtx))), 1)
        nvtx = {"events": 5, "errors": 0, "first_errors": []}
        self.assertEqual(self.unmet(runs_of("nvtx", [1], nvtx=nvtx)), [])

    def test_lost_records_and_a_scheduler_that_gave_up_are_told(self):
        self.assertEqual(len(self.unmet(runs_of("trace", [1], trace={"lost": 2}))), 1)
        self.assertEqual(len(self.unmet(runs_of("plain", [1], tripped="too many errors"))), 1)

    def test_recording_counts_calls_of_urgengo_and_errors(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder, "recording")
            path.write_text("init of module 2\n[] domain urgengo\n[urgengo] start lidar = 1\n"
                            "[other] mark its own\n[urgengo] sample lidar laxity 5\n"
                            "ERROR end of range 7 that was not started\n[urgengo] start x = 2\n")
            found = cost.read_recording(path)
        self.assertEqual((found["events"], found["errors"]), (3, 1))
        self.assertEqual(found["by_kind"], {"start": 2, "sample": 1})


if __name__ == "__main__":
    unittest.main()
