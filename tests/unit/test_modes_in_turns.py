# SPDX-License-Identifier: Apache-2.0
"""tools/bench/modes_in_turns.py: each mode once a cycle, compared with the same arrivals."""
import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools/bench"))
import modes_in_turns  # noqa: E402


class ModesInTurns(unittest.TestCase):
    def test_a_cycle_has_each_mode_once_with_the_same_arrivals(self):
        phases = modes_in_turns.plan(["off", "shadow", "on"], 2, 7)
        self.assertEqual(phases, [(0, "off", 7), (0, "shadow", 7), (0, "on", 7),
                                  (1, "shadow", 8), (1, "on", 8), (1, "off", 8)])

    def test_a_mode_is_compared_with_the_base_of_its_own_cycle(self):
        missed = {(0, "off"): 10, (0, "on"): 4, (1, "off"): 30, (1, "on"): 32}
        runs = [{"cycle": cycle, "mode": mode, "overall_miss_pct": pct}
                for (cycle, mode), pct in missed.items()]
        self.assertEqual(modes_in_turns.differences(runs, "on", "off"), [-6, 2])


if __name__ == "__main__":
    unittest.main()
