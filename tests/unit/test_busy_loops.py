# SPDX-License-Identifier: Apache-2.0
"""tools/bench/busy_loops.py: processes that compute half of the time, and end with their block."""
import os
import pathlib
import sys
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools/bench"))
import busy_loops  # noqa: E402


def of_children_s():
    """@returns CPU time of the processes that have ended"""
    times = os.times()
    return times.children_user + times.children_system


class BusyLoops(unittest.TestCase):
    def test_they_compute_meanwhile_and_end(self):
        before = of_children_s()
        with busy_loops.beside(2):
            time.sleep(1)
        computed_s = of_children_s() - before
        self.assertGreater(computed_s, 0.2)  # twice 0.5, less where the cores are busy
        self.assertLess(computed_s, 1.6)
        with self.assertRaises(ChildProcessError):
            os.waitpid(-1, os.WNOHANG)

    def test_they_end_when_the_block_is_left_by_an_error(self):
        with self.assertRaises(ValueError), busy_loops.beside(1):
            raise ValueError
        with self.assertRaises(ChildProcessError):
            os.waitpid(-1, os.WNOHANG)

    def test_none_is_none(self):
        before = of_children_s()
        with busy_loops.beside(0):
            pass
        self.assertEqual(of_children_s(), before)


if __name__ == "__main__":
    unittest.main()
