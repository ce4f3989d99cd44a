# SPDX-License-Identifier: Apache-2.0
"""Busy cores: processes beside a program, each of which computes 10 ms and sleeps 10 ms, in turn. A
thread that sleeps wakes up late then, or loses its core between two launches, some per cent of the
time and for milliseconds, as on a vehicle's computer. Endless loops are another thing: a thread that
sleeps a lot goes before them.
"""
import contextlib
import os
import subprocess
import sys
import time

TURN_S = 0.01


@contextlib.contextmanager
def beside(count):
    """So many of them, until the block is left."""
    with contextlib.ExitStack() as stack:
        for _ in range(count):
            process = stack.enter_context(subprocess.Popen([sys.executable, __file__]))
            stack.callback(process.kill)
        yield


def main():
    parent = os.getppid()
    while os.getppid() == parent:  # which may be killed
        end = time.monotonic() + TURN_S
        while time.monotonic() < end:
            pass
        time.sleep(TURN_S)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
