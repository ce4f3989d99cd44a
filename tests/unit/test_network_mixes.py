# SPDX-License-Identifier: Apache-2.0
"""tools/bench/network_mixes.py and its program: what is drawn, when frames come, what is counted."""
import pathlib
import sys
import unittest

BENCH = pathlib.Path(__file__).resolve().parents[2] / "tools/bench"
sys.path[:0] = [str(BENCH), str(BENCH / "programs")]
import frames  # noqa: E402
import mix_plan  # noqa: E402
import network_threads  # noqa: E402
import networks  # noqa: E402

A = mix_plan.MIXES["A"]


def calibration(mix, latency_ms=4.0):
    return {mix_plan.key(*one): {"latency_ms": latency_ms}
            for one in mix_plan.candidates(mix, networks.KINDS)}


def run(row, pct, seed=1, mix="A", load=0.9, bystander=False, missed=1):
    return {"mix": mix, "load": load, "bystander": bystander, "row": row, "seed": seed,
            "overall_miss_pct": pct, "networks": [{"name": "n", "frames": 100, "missed": missed}]}


class Thread:
    """A thread in virtual time, whose frames take so long."""

    def __init__(self, *takes):
        self.now, self.takes, self.begins = 0.0, list(takes), []

    def sleep(self, seconds):
        self.now += seconds

    def frame(self):
        self.begins.append(self.now)
        self.now += self.takes.pop(0)

    def run(self, dues):
        return frames.run_frames(dues, self.frame, lambda: self.now, self.sleep)


class Frames(unittest.TestCase):
    def test_arrivals_are_the_seeds_and_the_names(self):
        its = frames.arrivals_s("a", 1, 10, 1)
        self.assertEqual(its, frames.arrivals_s("a", 1, 10, 1))
        self.assertNotEqual(its, frames.arrivals_s("a", 2, 10, 1))
        self.assertNotEqual(its, frames.arrivals_s("b", 1, 10, 1))
        self.assertIn(len(its), (99, 100))
        self.assertEqual(its, sorted(its))

    def test_longer_run_begins_with_the_same_arrivals(self):
        self.assertEqual(frames.arrivals_s("a", 1, 10, 2)[:90], frames.arrivals_s("a", 1, 10, 1)[:90])

    def test_frame_waits_for_its_arrival_and_runs_late_if_the_thread_is_late(self):
        thread = Thread(1.5, 0.2, 0.2)
        self.assertEqual([round(end, 3) for end in thread.run([1, 2, 4])], [2.5, 2.7, 4.2])

    def test_oldest_frames_are_skipped_until_two_wait(self):
        thread = Thread(5.5, 0.1, 0.1)
        ends = thread.run([0, 1, 2, 3, 4, 5])
        self.assertEqual([end is None for end in ends], [False, True, True, True, False, False])
        self.assertEqual(len(thread.begins), 3)

    def test_skipped_is_missed_and_lateness_is_beyond_the_deadline(self):
        its = frames.of_frames([0, 1, 2], [0.005, None, 2.030], 20)
        self.assertEqual((its["frames"], its["skipped"], its["missed"]), (3, 1, 2))
        self.assertAlmostEqual(its["mean_lateness_ms"], 5)
        self.assertAlmostEqual(its["latency_ms"]["max"], 30)

    def test_frames_before_the_warm_up_is_over_do_not_count(self):
        self.assertEqual(frames.of_frames([0, 1], [9, 1.001], 20, not_before=1)["missed"], 0)

    def test_nothing_that_counts_is_no_error(self):
        its = frames.of_frames([], [], 20)
        self.assertEqual((its["frames"], its["latency_ms"]["p50"]), (0, None))
        self.assertEqual(frames.overall_miss_pct([its]), 0)


class Spec(unittest.TestCase):
    one = {"name": "n", "network": "resnet50", "form": "eager", "period_ms": 9, "deadline_ms": 9}

    def wrong(self, alone=False, **changes):
        return network_threads.what_is_wrong({"networks": [self.one | changes]}, alone)

    def test_accepts_what_it_should(self):
        self.assertEqual(self.wrong(), "")
        self.assertEqual(self.wrong(alone=True, period_ms=0), "")

    def test_says_what_is_wrong(self):
        self.assertIn("resnet51", self.wrong(network="resnet51"))
        self.assertIn("lazy", self.wrong(form="lazy"))
        self.assertIn("15 bytes", self.wrong(name="n" * 16))
        self.assertIn("period_ms", self.wrong(period_ms=0))
        self.assertIn("each once", network_threads.what_is_wrong({"networks": [self.one] * 2}))
        self.assertIn("found none", network_threads.what_is_wrong({}))

    def test_phases(self):
        self.assertEqual(network_threads.parse_phases("1,2b"), [(1, False), (2, True)])
        self.assertRaises(ValueError, network_threads.parse_phases, "b1")


class Mixes(unittest.TestCase):
    def test_networks_are_enough_and_of_all_libraries(self):
        self.assertGreaterEqual(len(networks.KINDS), 25)
        self.assertEqual({kind.library for kind in networks.KINDS.values()},
                         {"torchvision", "timm", "transformers"})

    def test_names_fit_threads_in_each_mix(self):
        for mix in mix_plan.MIXES.values():
            its = mix_plan.networks_of(mix, 0.5, networks.KINDS, calibration(mix))
            self.assertEqual(network_threads.what_is_wrong({"networks": its}), "")
            self.assertTrue(6 <= len(its) <= 10)

    def test_load_is_latency_over_period(self):
        for load in (0.5, 0.9):
            its = mix_plan.networks_of(A, load, networks.KINDS, calibration(A))
            self.assertAlmostEqual(sum(one["latency_alone_ms"] / one["period_ms"] for one in its),
                                   load, places=2)

    def test_other_load_is_the_same_mix(self):
        half, full = (mix_plan.networks_of(A, load, networks.KINDS, calibration(A))
                      for load in (0.45, 0.9))
        self.assertEqual([one["network"] for one in half], [one["network"] for one in full])
        for slow, fast in zip(half, full):
            self.assertAlmostEqual(slow["period_ms"], 2 * fast["period_ms"], delta=0.02)

    def test_half_is_tight_and_can_be_met(self):
        its = mix_plan.networks_of(A, 0.9, networks.KINDS, calibration(A))
        self.assertEqual(sum(one["tight"] for one in its), len(its) // 2)
        for one in its:
            self.assertEqual(one["deadline_ms"] < one["period_ms"], one["tight"])
            self.assertGreaterEqual(one["deadline_ms"], one["latency_alone_ms"])

    def test_network_that_does_not_run_here_is_replaced(self):
        known = calibration(A)
        gone = next(iter(known))
        del known[gone]
        its = mix_plan.networks_of(A, 0.5, networks.KINDS, known)
        self.assertEqual(len(its), A.count)
        self.assertNotIn(gone.split("/")[0], [one["network"] for one in its])
        self.assertRaises(ValueError, mix_plan.networks_of, A, 0.5, networks.KINDS, {})

    def test_mix_c_has_regnet_in_whatever_is_drawn(self):
        mix = mix_plan.MIXES["C"]
        its = mix_plan.networks_of(mix, 0.5, networks.KINDS, calibration(mix))
        self.assertEqual(its[0]["network"], "regnet_y_8gf")
        self.assertEqual({one["form"] for one in its}, set(networks.FORMS))

    def test_own_mix(self):
        mix = mix_plan.parse_mix("6:traced+eager:21")
        self.assertEqual((mix.count, mix.forms, mix.seed), (6, ("traced", "eager"), 21))
        self.assertRaises(ValueError, mix_plan.parse_mix, "D")

    def test_config_has_a_chain_a_thread(self):
        its = mix_plan.networks_of(A, 0.5, networks.KINDS, calibration(A))
        text = mix_plan.config_text(its, "admission: none", "guard: off")
        self.assertEqual(text.count("- name:"), len(its))
        self.assertIn(f'thread: "{its[0]["name"]}"', text)
        self.assertTrue(text.endswith("scheduler: {admission: none}\nguard: off\n"))


class Comparison(unittest.TestCase):
    def compare(self, *runs):
        return mix_plan.compare(mix_plan.cells(runs), {"A": "traced"})

    def test_ratio_is_over_seeds_that_both_have(self):
        found = self.compare(run("bare", 10), run("bare", 50, seed=2), run("urgengo", 3))
        self.assertEqual(found["cells"][0]["urgengo/bare"], 0.3)
        self.assertEqual(found["worse"], [])

    def test_kind_is_the_ratio_of_means_over_cells(self):
        found = self.compare(run("bare", 10), run("urgengo", 1), run("bare", 30, load=0.5),
                             run("urgengo", 7, load=0.5))
        self.assertEqual(found["kinds"]["traced"]["urgengo/bare"]["ratio"], 0.2)

    def test_worse_cell_is_named(self):
        found = self.compare(run("bare", 1), run("priorities", 5), run("urgengo", 4))
        self.assertEqual([one["than"] for one in found["worse"]], ["bare"])

    def test_nothing_missed_has_no_ratio(self):
        self.assertIsNone(self.compare(run("bare", 0), run("urgengo", 0))["cells"][0]["urgengo/bare"])

    def test_wrong_profile_is_wrong_by_the_factor_and_the_right_one_stays(self):
        right = {"gpu": "G", "chains": [{"name": name, "tasks": [{
            "instances": 9, "segments": [{"latency_ns": 800, "cpu_time_ns": 5}],
            "kernels": [{"gpu_time_ns": 400, "samples": 4}]}]} for name in "abc"]}
        wrong, factors = mix_plan.wrong_profile(right, "times_4", 1)
        self.assertEqual(list(factors.values()), [4])
        for chain in wrong["chains"]:
            task, by = chain["tasks"][0], factors.get(chain["name"], 1)
            self.assertEqual((task["kernels"][0]["gpu_time_ns"], task["kernels"][0]["samples"],
                              task["segments"][0]["latency_ns"], task["segments"][0]["cpu_time_ns"],
                              task["instances"]), (400 * by, 4, 800 * by, 5, 9))
        self.assertEqual(right["chains"][0]["tasks"][0]["kernels"][0]["gpu_time_ns"], 400)
        _, factors = mix_plan.wrong_profile(right, "random_2", 1)
        self.assertEqual(set(factors), set("abc"))
        self.assertTrue(all(0.5 <= by <= 2 for by in factors.values()))

    def test_networks_whose_answers_differ_are_named(self):
        def run_of(row, **answers):
            return {"mix": "A", "row": row, "networks": [
                {"name": name, "answer_sha256": bits} for name, bits in answers.items()]}

        found = mix_plan.answers([run_of("bare", a="x", b="y", c=""), run_of("urgengo", a="x", b="z"),
                                  run_of("urgengo", a="x", b="y"), run_of("empty", a="w")])
        self.assertEqual(found, {"networks": 2, "frames": 6, "different": [
            {"mix": "A", "network": "b", "by_row": {"bare": [0], "urgengo": [1, 0]}}]})

    def test_rows_take_turns(self):
        self.assertEqual(mix_plan.in_turns(["a", "b", "c"], 4), ["b", "c", "a"])


if __name__ == "__main__":
    unittest.main()
