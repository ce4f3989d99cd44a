# SPDX-License-Identifier: Apache-2.0
"""tools/bench/summary.py: what it says of repeated cells, and which files it refuses."""
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

TOOL = pathlib.Path(__file__).resolve().parents[2] / "tools/bench/summary.py"
sys.path.insert(0, str(TOOL.parent))
import summary  # noqa: E402


def run(row, seed, missed, f_a=0.9, frames=10):
    """Two chains: one misses so many in each second, one, with twice the frames, none."""
    chains = [{"frames": [frames] * len(missed), "missed": missed},
              {"frames": [2 * frames] * len(missed), "missed": [0] * len(missed)}]
    pct = 50 * sum(missed) / (frames * len(missed)) if missed else 10
    return {"row": row, "f_a": f_a, "repeat": 0, "seed": seed, "overall_miss_pct": pct,
            "blocks_of_chains": chains, "report": {"date_utc": f"{row} {seed} {missed}"}}


def results(*runs, f_d="1", **changes):
    return {"program": "urgengo bench smoke", "gpu": "G", "driver": "580", "version": "1",
            "commit": "c", "workload_hash": "w",
            "parameters": {"f_d": f_d, "seconds": "4", "seed": "1", "cpu": "spin"},
            "runs": list(runs)} | changes


class Summary(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def files(self, *documents):
        paths = [self.folder / f"{i}.json" for i in range(len(documents))]
        for path, document in zip(paths, documents):
            path.write_text(json.dumps(document))
        return [str(path) for path in paths]

    def cell(self, *documents, level=(0.9, 1.0)):
        cells, _ = summary.read(self.files(*documents))
        return summary.Cell(cells[level])

    def refused(self, *documents, mixed=False):
        with self.assertRaises(summary.Refused) as caught:
            summary.read(self.files(*documents), mixed)
        return str(caught.exception)

    def test_median_range_and_number_are_over_all_files(self):
        cell = self.cell(results(run("urgengo", 1, [1, 1])), results(run("urgengo", 2, [4, 2])),
                         results(run("urgengo", 3, [6, 8]), run("urgengo", 1, [0, 0], f_a=1.1)))
        found = cell.summary("urgengo", [])
        self.assertEqual((found["runs"], found["median"], found["min"], found["max"]),
                         (3, 15, 5, 35))

    def test_reduction_is_over_seeds_that_both_have(self):
        cell = self.cell(results(run("urgengo", 1, [1, 1]), run("paper", 1, [4, 4])),
                         results(run("urgengo", 2, [9, 9])), results(run("paper", 3, [1, 1])))
        less = cell.reduction("urgengo", "paper")
        self.assertEqual((less["value"], less["seeds"]), (75, 1))
        self.assertIsNone(cell.reduction("paper", "paper"))
        self.assertIsNone(cell.reduction("paper", "paam"))

    def test_rows_of_a_seed_are_drawn_at_the_same_seconds(self):
        # Whatever is drawn, one has half of the other's misses: there is nothing to be unsure of.
        half, whole = [1, 0, 3, 5], [2, 0, 6, 10]
        cell = self.cell(results(run("urgengo", 1, half), run("paper", 1, whole),
                                 run("urgengo", 2, [0, 1, 0, 0]), run("paper", 2, [0, 2, 0, 0])))
        less = cell.reduction("urgengo", "paper")
        for key in ("value", "low", "high"):
            self.assertAlmostEqual(less[key], 50)

    def test_interval_is_of_seeds(self):
        cell = self.cell(results(run("urgengo", 1, [0, 0, 0, 0]), run("paper", 1, [4, 4, 4, 4]),
                                 run("urgengo", 2, [3, 3, 3, 3]), run("paper", 2, [4, 4, 4, 4])))
        less = cell.reduction("urgengo", "paper")
        self.assertAlmostEqual(less["value"], 62.5)
        self.assertEqual((less["low"], less["high"]), (25, 100))

    def test_interval_is_of_seconds_too_and_the_same_again(self):
        cell = self.cell(results(run("urgengo", 1, [3, 0, 1, 0]), run("paper", 1, [4, 4, 4, 5])))
        less = cell.reduction("urgengo", "paper")
        self.assertLess(less["low"], 60)
        self.assertGreater(less["high"], 90)
        again = summary.Cell(cell.rows)
        seeds = ((1, "4"),)
        self.assertEqual(again.draws("urgengo", seeds), cell.draws("urgengo", seeds))

    def test_repeats_of_a_seed_are_drawn_one_at_a_time(self):
        cell = self.cell(results(run("urgengo", 1, [1]), run("paper", 1, [4])),
                         results(run("urgengo", 1, [3])))
        less = cell.reduction("urgengo", "paper")
        self.assertEqual((less["value"], less["low"], less["high"]), (50, 25, 75))

    def test_without_seconds_there_is_no_interval_and_without_misses_no_number(self):
        cell = self.cell(results(run("urgengo", 1, []), run("paper", 1, [4, 4]),
                                 run("paam", 1, [0, 0])))
        less = cell.reduction("urgengo", "paper")
        self.assertEqual((less["value"], less["low"]), (50, None))
        self.assertIsNone(cell.reduction("urgengo", "paam"))

    def test_miss_ratio_is_the_mean_over_chains_that_had_frames(self):
        chains = (((2, 0), (1, 0)), ((0, 4), (0, 1)), ((), ()))
        self.assertEqual(summary.miss_pct(chains, [0, 1]), (50 + 25) / 2)
        self.assertEqual(summary.miss_pct(chains, [0, 0]), 50)
        self.assertEqual(summary.miss_pct(chains, [5]), 0)

    def test_other_conditions_are_refused_unless_asked_for(self):
        first = results(run("urgengo", 1, [1]))
        for change, name in (({"commit": "d"}, "commit"), ({"gpu": "H"}, "gpu"),
                             ({"workload_hash": "v"}, "workload_hash")):
            other = results(run("urgengo", 2, [1]), **change)
            text = self.refused(first, other)
            self.assertRegex(text, f"1.json: {name}: found {change[name]}, accepted: .*0.json")
            self.assertEqual(len(summary.read(self.files(first, other), mixed=True)[0]), 1)
        other = results(run("urgengo", 2, [1]))
        other["parameters"] |= {"cpu": "sleep", "seed": "2"}
        self.assertIn("cpu: found sleep, accepted: spin", self.refused(first, other))

    def test_what_is_no_result_or_comes_twice_is_refused(self):
        first = results(run("urgengo", 1, [1]))
        self.assertIn("found urgengo at f_a 0.9, seed 1 of another file again",
                      self.refused(first, first))
        self.assertIn("found results of urgengo bench calls",
                      self.refused(results(program="urgengo bench calls")))
        self.assertIn("found no results", self.refused({"runs": []}))

    def test_table_and_json(self):
        paths = self.files(results(run("bare", 1, [4, 4]), run("paper", 1, [2, 2])),
                           results(run("bare", 1, [1, 1]), f_d="1.5"))
        out = self.folder / "out.json"
        done = subprocess.run([sys.executable, TOOL, *paths, "--json", out], text=True, check=True,
                              stdout=subprocess.PIPE)
        self.assertEqual(done.stdout.splitlines(), [
            "f_a 0.9, f_d 1  miss %       range  runs            less than paper",
            "bare              20.0  20.0..20.0     1  -100.0 % (-100.0..-100.0)",
            "paper             10.0  10.0..10.0     1",
            "",
            "f_a 0.9, f_d 1.5  miss %     range  runs  less than paper",
            "bare                 5.0  5.0..5.0     1"])
        written = json.loads(out.read_text())
        self.assertEqual([(c["f_a"], c["f_d"]) for c in written["cells"]], [(0.9, 1), (0.9, 1.5)])
        self.assertEqual(written["cells"][0]["rows"][0]["less_than"]["paper"]["value"], -100)


if __name__ == "__main__":
    unittest.main()
