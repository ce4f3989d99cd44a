# SPDX-License-Identifier: Apache-2.0
"""tools/bench/sweep.py: what is drawn, who counts as worse, and what is said in the end."""
import argparse
import pathlib
import sys
import tempfile
import threading
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools/bench"))
import sweep  # noqa: E402


def report(overall_pct, **missed):
    return {"overall_miss_pct": overall_pct,
            "chains": [{"name": name, "missed": number, "frames": 100}
                       for name, number in missed.items()]}


def workload(bare, profile, none, worse=(), failed=""):
    first = {"bare": report(bare, a=0), "profile": report(profile, a=0), "none": report(none, a=0)}
    return {"first": first, "again": {}, "worse": {"profile": list(worse)}, "failed": failed}


class Drawn(unittest.TestCase):
    def test_same_number_is_the_same_workload(self):
        self.assertEqual(sweep.draw(7), sweep.draw(7))
        self.assertNotEqual(sweep.draw(7), sweep.draw(8))

    def test_load_is_kernels_over_period(self):
        for number in range(1, 101):
            spec, load = sweep.draw(number)
            its = sum(c["kernels"] * sweep.alone_us(c, spec["bystander"]) / 1000 / c["period_ms"]
                      for c in spec["chains"])
            self.assertTrue(0.5 <= load <= 0.95)
            self.assertAlmostEqual(its, load, delta=0.12)  # kernels are whole

    def test_alone_every_chain_would_meet_its_deadline(self):
        for number in range(1, 101):
            spec, _ = sweep.draw(number)
            its = {c["name"]: c for c in spec["chains"]}
            for chain in its.values():
                frame_ms = chain["kernels"] * sweep.alone_us(chain, spec["bystander"]) / 1000
                self.assertLess(frame_ms, chain["deadline_ms"], (number, chain))
                if "waits_for" in chain:
                    self.assertTrue(sweep.can_wait(chain, its[chain["waits_for"]],
                                                   spec["bystander"]))

    def test_bystander_takes_a_kernel_between_two(self):
        chain = {"kernel_us": 50, "streams": 1}
        self.assertEqual(sweep.alone_us(chain, None), 52)
        self.assertEqual(sweep.alone_us(chain, {"kernel_us": 200}), 252)
        self.assertEqual(sweep.alone_us({**chain, "streams": 4}, {"kernel_us": 200}), 102)

    def test_hundred_have_all_that_may_be_drawn(self):
        specs = [sweep.draw(number)[0] for number in range(1, 101)]
        chains = [chain for spec in specs for chain in spec["chains"]]
        self.assertEqual({chain["streams"] for chain in chains}, {1, 2, 3, 4})
        self.assertTrue(10 < sum(spec["bystander"] is not None for spec in specs) < 45)
        self.assertTrue(10 < sum("waits_for" in chain for chain in chains) < 45)
        self.assertTrue(20 < sum(chain.get("locks", False) for chain in chains) < 90)

    def test_ten_of_ci_have_all_that_may_be_drawn(self):
        specs = [sweep.draw(number)[0] for number in range(1, 11)]
        chains = [chain for spec in specs for chain in spec["chains"]]
        self.assertTrue(any(spec["bystander"] for spec in specs))
        self.assertTrue(any("waits_for" in chain for chain in chains))
        self.assertTrue(any(chain.get("locks") for chain in chains))
        self.assertTrue(any(chain["streams"] == 4 for chain in chains))


class Known(unittest.TestCase):
    specs = sweep.read_specs(pathlib.Path(sweep.__file__).parent / "known_workloads.json")

    def test_known_workloads_have_all_features(self):
        self.assertEqual(set().union(*map(sweep.features, self.specs.values())),
                         set(sweep.FEATURES))

    def test_each_lock_is_held_while_launching_or_until_done(self):
        locks = {chain.get("locks", False) for spec in self.specs.values()
                 for chain in spec["chains"]}
        self.assertEqual(locks, set(sweep.LOCK_WORDS))

    def test_each_chain_would_meet_its_deadline_alone(self):
        for spec in self.specs.values():
            for chain in spec["chains"]:
                its_ms = chain["kernels"] * sweep.alone_us(chain, spec["bystander"]) / 1000
                self.assertLess(its_ms, chain["deadline_ms"], (spec["name"], chain))
            self.assertLess(sweep.load_of(spec), 1)


class Profiles(unittest.TestCase):
    def test_factor_is_learned_time_of_true_time(self):
        spec = {"chains": [{"name": "a", "kernels": 10, "kernel_us": 100},
                           {"name": "b", "kernels": 1, "kernel_us": 100}]}
        profile = {"chains": [{"name": "a", "tasks": [
            {"kernels": [{"gpu_time_ns": 1_500_000}, {"gpu_time_ns": 500_000}]}]}]}
        self.assertEqual(sweep.profile_factors(profile, spec), {"a": 2, "b": 0})


class Judged(unittest.TestCase):
    def test_two_frames_and_two_per_cent_are_allowed(self):
        bare = report(0, a=1, b=0)
        self.assertEqual(sweep.worse_chains(report(0, a=5, b=4), bare), set())
        self.assertEqual(sweep.worse_chains(report(0, a=6, b=4), bare), {"a"})

    def test_means_and_ratios_are_over_workloads(self):
        found = sweep.summarise({"1": workload(10, 2, 4), "2": workload(30, 2, 16)})
        self.assertEqual(found["mean_miss_pct"], {"bare": 20, "profile": 2, "none": 10})
        self.assertEqual(found["ratios"], {"profile": 0.1, "none": 0.5})
        self.assertEqual((found["worse"], found["failed"]), ([], []))

    def test_worse_and_failed_are_named(self):
        found = sweep.summarise({"1": workload(0, 0, 0, worse=["a"]),
                                 "2": {"first": {}, "again": {}, "worse": {}, "failed": "it hung"}})
        self.assertEqual(found["worse"], [{"workload": "1", "row": "profile", "chains": ["a"]}])
        self.assertEqual(found["failed"], ["2"])
        self.assertEqual(found["ratios"], {"profile": None, "none": None})


class SideBySide(unittest.TestCase):
    """Workload 2 misses more under UrgenGo than bare, each time."""

    class Recorded(sweep.Sweep):
        def __init__(self, folder, misses):
            super().__init__(argparse.Namespace(
                gpu=True, build=pathlib.Path(folder), side_by_side=2, least_load=0.5,
                most_load=0.95, scheduler="", config="", profile_seconds=1, stack_kib=64,
                specs=None, again=2, more_pct=2, stall_ms=0), folder)
            self.misses, self.ran, self.running = misses, [], 0
            self.both = threading.Barrier(2)

        def execute(self, command):
            pathlib.Path(command[command.index("-o") + 1]).write_text('{"chains": []}')
            self.both.wait(10)  # two workloads at once, or it breaks
            return ""

        def run(self, row, number):
            self.ran.append((number, row))
            names = [chain["name"] for chain in sweep.draw(number)[0]["chains"]]
            more = self.misses.get((number, row), [0])
            return report(0, **{name: more.pop(0) if len(more) > 1 else more[0]
                                for name in names[:1]}, **{name: 0 for name in names[1:]})

    def run_two(self, misses):
        with tempfile.TemporaryDirectory() as folder:
            its, done = self.Recorded(pathlib.Path(folder), misses), {}
            its.run_all(["2", "3"], done, lambda: None)
        return its.ran, done

    def test_suspect_alone_runs_again(self):
        ran, done = self.run_two({(2, "none"): [50]})
        self.assertEqual(sorted(ran[:6]), [(n, row) for n in (2, 3) for row in sorted(sweep.ROWS)])
        self.assertEqual(ran[6:], 2 * [(2, "bare"), (2, "none")])
        self.assertEqual(done["2"]["worse"], {"none": ["chain_a"]})
        self.assertEqual((done["3"]["again"], done["3"]["worse"]), ({}, {}))

    def test_worse_once_is_not_worse(self):
        ran, done = self.run_two({(2, "profile"): [50, 0]})
        self.assertEqual(ran[6:], [(2, "bare"), (2, "profile")])
        self.assertEqual(done["2"]["worse"], {"profile": []})

    def test_worse_less_often_than_again_says_is_not_worse(self):
        ran, done = self.run_two({(2, "profile"): [50, 50, 0]})
        self.assertEqual(ran[6:], 2 * [(2, "bare"), (2, "profile")])
        self.assertEqual(done["2"]["worse"], {"profile": []})


if __name__ == "__main__":
    unittest.main()
