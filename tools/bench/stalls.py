# SPDX-License-Identifier: Apache-2.0
"""A machine that stalls: now and then all threads of a program stand still (SIGSTOP), as where a
hypervisor takes the cores away. A GPU goes on; the simulated one is in the program, and stands still
as well. Frames pile up, and the scheduler has to sort that out. A loud machine stalled for some 15 ms
now and then (docs/measurements.md).
"""
import os
import random
import signal
import subprocess
import threading
import time

EVERY_S = 0.6  # in the mean, exponentially


def run(command, stall_ms, seed, timeout, **options):
    """@returns what subprocess.run does, with captured output unless told where it goes; stalls are
        the same for a seed
    @raises subprocess.TimeoutExpired  with all processes of the command ended"""
    chances, over = random.Random(seed), threading.Event()

    def stall(group):
        while not over.wait(chances.expovariate(1 / EVERY_S)):
            try:
                os.killpg(group, signal.SIGSTOP)
                time.sleep(stall_ms / 1000)
                os.killpg(group, signal.SIGCONT)
            except ProcessLookupError:
                return

    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
    with subprocess.Popen(command, text=True, start_new_session=True, **options) as process:
        thread = threading.Thread(target=stall, args=(process.pid,))
        thread.start()
        try:
            out, err = process.communicate(timeout=timeout)
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            raise
        finally:
            over.set()
            thread.join()
    return subprocess.CompletedProcess(command, process.returncode, out, err)
