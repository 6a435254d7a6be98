"""How long a test may take: by the work it does, never by the clock on the wall.

A busy machine makes everything slower, and no test may fail for that. What hangs without computing
ends after ten minutes all the same.
"""

import os
import signal
import subprocess
from contextlib import contextmanager

import pytest

HANGS = 600.0
"""[s] after which a process that waits is taken to wait for ever, however busy the machine is."""
WORK = 60
"""[s] of processor time that a process of the command line may need for something small."""


def processor_time():
    """[s] of this process and of those that it has waited for."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


@contextmanager
def bounded(seconds):
    """Fails what computes for longer, or waits for ever."""

    def waited(number, frame):
        pytest.fail(f"hangs: not done after {HANGS:g} s")

    def computed(number, frame):
        pytest.fail(f"not done after {seconds} s of computing")

    handlers = {signal.SIGALRM: waited, signal.SIGPROF: computed}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    begun = processor_time()
    signal.setitimer(signal.ITIMER_REAL, HANGS)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)
    assert processor_time() - begun < seconds


def finished(command, *, seconds=WORK, **options):
    """A process that has ended, by itself or because it computed for too long."""
    limited = ["sh", "-c", f'ulimit -t {seconds}; exec "$@"', "sh", *command]
    return subprocess.run(limited, check=False, timeout=HANGS, **options)
