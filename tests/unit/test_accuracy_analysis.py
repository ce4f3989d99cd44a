# SPDX-License-Identifier: Apache-2.0
"""tools/bench/accuracy_analysis.py: what counts as an error of a position, and what does not."""
import json
import pathlib
import struct
import sys
import tempfile
import types
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools/bench"))
import accuracy_analysis as analysis  # noqa: E402
import stamps_file  # noqa: E402

OFFSET = 10**15
PROFILE = {"chains": [{"name": "C0", "tasks": [
    {"name": "first", "kernels": [{"gpu_time_ns": 100_000}, {"gpu_time_ns": 50_000},
                                  {"gpu_time_ns": 50_000}]}]}]}


def file_of(*samples, lost=0):
    """Two runs of three launches, at 1 ms and at 2 ms on the host; each launch 100 us."""
    stamps = [(OFFSET + start + 100_000 * i, OFFSET + start + 100_000 * (i + 1))
              for start in (1_000_000, 2_000_000) for i in range(3)]
    stream = stamps_file.Stream("C0", ["first"], 6, lost, stamps[:6 - lost],
                                [stamps_file.Run(0, 0, 0, 3), stamps_file.Run(0, 1, 3, 3)])
    clock = stamps_file.Clock([{"gpu_ns": OFFSET, "host_ns": 0, "bound_ns": 0, "round_trips": 9},
                               {"gpu_ns": OFFSET + 10**7, "host_ns": 10**7, "bound_ns": 1000,
                                "round_trips": 9}])
    return types.SimpleNamespace(clock=clock, streams=[stream], samples=list(samples))


def sample(time_ns, run, instance, launch, remaining_ns, flags=stamps_file.ANSWERED):
    return stamps_file.Sample(time_ns - 50, 100, 0, flags, run, launch, instance, 0, remaining_ns,
                              0, 0)


class Analysis(unittest.TestCase):
    def found(self, *samples, lost=0):
        return analysis.analyse(file_of(*samples, lost=lost), PROFILE)

    def test_exact_position_has_no_error(self):
        # In the middle of the second launch: half of its 50 us, and the third one's, remain.
        found = self.found(sample(1_150_000, 0, 1, 1, 75_000))
        self.assertEqual(found["exact"], 1)
        self.assertEqual(found["kernels"]["max"], 0)
        self.assertAlmostEqual(found["remaining_us"]["max"], 0, places=3)

    def test_one_launch_too_early_and_its_work(self):
        found = self.found(sample(1_150_000, 0, 1, 0, 150_000))
        self.assertEqual((found["exact"], found["within_one"]), (0, 1))
        self.assertEqual(found["kernels_histogram"], {-1: 1})
        self.assertAlmostEqual(found["remaining_us"]["max"], 75, places=3)
        self.assertEqual(found["kernels_behind"], 1)

    def test_position_of_an_earlier_instance_means_nothing_done(self):
        found = self.found(sample(2_250_000, 1, 1, 3, 25_000))
        self.assertEqual(found["kernels_histogram"], {-2: 1})
        self.assertEqual(found["other_instance"], 1)
        found = self.found(sample(1_050_000, 0, 2, 0, 150_000))
        self.assertEqual(found["kernels_histogram"], {3: 1})

    def test_instances_are_16_bits(self):
        self.assertEqual(analysis.as_int16(1 - 0x10000), 1)
        self.assertEqual(analysis.as_int16(0xffff - 0x10000), -1)
        self.assertEqual(analysis.as_int16(0xffff), -1)

    def test_only_what_is_on_the_gpu_counts(self):
        found = self.found(sample(999_000, 0, 1, 0, 0), sample(1_301_000, 0, 1, 3, 0),
                           sample(1_100_500, 0, 1, 0, 0, flags=0), sample(1_050_000, 0, 1, 0, 0))
        self.assertEqual(found["samples"], 1)
        self.assertEqual(found["left_out"], {"not on the GPU": 2, "not answered": 1})

    def test_runs_without_all_stamps_are_left_out(self):
        found = self.found(sample(2_050_000, 1, 2, 0, 0), lost=1)
        self.assertEqual(found["left_out"], {"no truth": 1})
        self.assertIsNone(found["exact"])

    def test_what_the_clocks_leave_open_counts_as_exact_apart(self):
        # The second launch began 500 ns ago; the clocks are known within 1 us.
        found = self.found(sample(1_100_500, 0, 1, 0, 100_000))
        self.assertEqual((found["exact"], found["exact_within_clocks"]), (0, 1))
        found = self.found(sample(1_102_500, 0, 1, 0, 100_000))
        self.assertEqual(found["exact_within_clocks"], 0)

    def test_histogram_ends_and_percentiles(self):
        ends = analysis.bin_ends_us()
        counts = analysis.histogram([0, 0.05, -150, 1e9])
        self.assertEqual((counts[0], counts[-1], len(counts)), (2, 1, len(ends)))
        place = counts.index(1)
        self.assertTrue(ends[place - 1] <= 150 < ends[place])
        self.assertEqual(analysis.percentiles([-3, 1, 2]), {"p50": 2, "p95": 3, "p99": 3, "max": 3})


class File(unittest.TestCase):
    HEADER = {"format_version": 1,
              "clock": [{"gpu_ns": 100, "host_ns": 0, "bound_ns": 7, "round_trips": 3},
                        {"gpu_ns": 1100, "host_ns": 2000, "bound_ns": 5, "round_trips": 3}],
              "streams": [{"chain": "C0", "tasks": ["a"], "launches": 2, "lost": 0}],
              "arrays": [{"name": "stamps", "count": 2, "bytes": 16, "fields": "QQ"},
                         {"name": "runs", "count": 1, "bytes": 16, "fields": "IIII"},
                         {"name": "samples", "count": 1, "bytes": 56, "fields": "qIHHIIIIqqq"}]}
    ARRAYS = struct.pack("=4Q4IqIHHIIIIqqq", 100, 200, 200, 350, 0, 0, 0, 2, 5, 6, 0, 3, 0, 1, 1, 0,
                         -7, 8, 9)

    def read(self, header, arrays):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder, "stamps")
            path.write_bytes(json.dumps(header).encode() + b"\n" + arrays)
            return stamps_file.StampsFile(path)

    def test_arrays_follow_the_first_line(self):
        file = self.read(self.HEADER, self.ARRAYS)
        self.assertEqual(file.streams[0].stamps, [(100, 200), (200, 350)])
        self.assertEqual(file.streams[0].runs[0].num_launches, 2)
        self.assertEqual((file.samples[0].flags, file.samples[0].remaining_ns), (3, -7))
        self.assertEqual(file.clock.to_host(600), 1000)
        self.assertEqual((file.clock.bound_ns, file.resolution_ns()), (7, 100))

    def test_what_is_cut_off_is_refused(self):
        with self.assertRaisesRegex(ValueError, "not what its first line says"):
            self.read(self.HEADER, self.ARRAYS[:-1])
        with self.assertRaisesRegex(ValueError, "format_version 2, accepted: 1"):
            self.read({**self.HEADER, "format_version": 2}, self.ARRAYS)


if __name__ == "__main__":
    unittest.main()
