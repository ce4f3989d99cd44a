# SPDX-License-Identifier: Apache-2.0
"""tools/bench/stalls.py: a program stands still now and then, and is else what it was."""
import pathlib
import subprocess
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools/bench"))
import stalls  # noqa: E402

# Says how many times it stood still for 0.3 s or more, in 4 s.
WATCHES = """
import time
begin = last = time.monotonic()
gaps = 0
while last - begin < 4:
    time.sleep(0.01)
    now = time.monotonic()
    gaps += now - last >= 0.3
    last = now
print(gaps)
"""


def run(program, stall_ms, timeout=30):
    return stalls.run([sys.executable, "-c", program], stall_ms, seed=5, timeout=timeout)


class Stalls(unittest.TestCase):
    def test_it_stands_still_now_and_then(self):
        self.assertGreaterEqual(int(run(WATCHES, 400).stdout), 2)

    def test_output_and_exit_status_are_kept(self):
        done = run("import sys; print(1); print(2, file=sys.stderr); sys.exit(3)", 10)
        self.assertEqual((done.returncode, done.stdout, done.stderr), (3, "1\n", "2\n"))

    def test_what_hangs_is_ended(self):
        with self.assertRaises(subprocess.TimeoutExpired):
            run("import time; time.sleep(60)", 10, timeout=2)


if __name__ == "__main__":
    unittest.main()
