"""Signals end the program wherever they come, also where a library swallows the exception."""

import os
import random
import signal
import subprocess
import sys
import threading

import casadi as ca
import numpy as np
import pytest
from recordings import write_small
from time_limits import HANGS, WORK, finished

from steelyard.cli import interruption
from steelyard.cli.interruption import interruptible

pytestmark = pytest.mark.integration


@pytest.fixture(autouse=True)
def heard():
    """Where these tests run in the background, a shell has SIGINT ignored, also by what they begin."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def compute():
    """Calls of CasADi that are so short that most signals come while one begins or ends."""
    x = ca.SX.sym("x", 3)
    function = ca.Function("f", [x], [ca.sin(x) * ca.sumsqr(x) + x])
    value = np.ones(3)
    while True:
        value = np.asarray(function(value)).ravel()


def compute_and_clean(cleaned):
    try:
        compute()
    finally:
        # The timer must leave this alone.
        for _ in range(3):
            signal.sigtimedwait([], 0.03)
        cleaned.append(True)


def seconds_from_now(delay, number):
    timer = threading.Timer(delay, os.kill, (os.getpid(), number))
    timer.start()
    return timer


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "kind"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)]
)
def test_no_signal_is_lost_in_short_calls(monkeypatch, number, kind):
    # However busy the machine is: the exception itself must arrive.
    monkeypatch.setattr(interruption, "_LONGEST", HANGS)
    rng = random.Random(1)
    before = signal.getsignal(signal.SIGINT)
    cleaned = []
    for _ in range(25):
        timer = seconds_from_now(rng.uniform(0.01, 0.03), number)
        with pytest.raises(kind), interruptible():
            compute_and_clean(cleaned)
        timer.join()
    assert len(cleaned) == 25
    assert signal.getsignal(signal.SIGINT) is before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


SWALLOWING = """
import os, signal, sys
from steelyard.cli import interruption
interruption._LONGEST = float(sys.argv[2])
try:
    with interruption.interruptible():
        signals = [int(sys.argv[1])] * int(sys.argv[3])
        while True:
            try:
                if signals:
                    os.kill(os.getpid(), signals.pop())
            except BaseException:
                pass
except KeyboardInterrupt:
    # Between two rounds it gets out, which is as good.
    sys.exit(130)
"""


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize(("longest", "signals"), [(0.2, 1), (1e9, 2)])
def test_what_swallows_every_exception_is_ended_as_it_is(number, status, longest, signals):
    arguments = [str(int(number)), str(longest), str(signals)]
    ended = finished([sys.executable, "-c", SWALLOWING, *arguments], capture_output=True)
    assert (ended.returncode, ended.stderr) == (status, b"")


CLEARED = """
import os, signal, sys
from steelyard.cli import interruption
number = int(sys.argv[1])

class Cleared:
    def __del__(self):
        if signals:
            os.kill(os.getpid(), signals.pop())
            # The handler runs between two instructions of these.
            for _ in range(1000):
                pass

class Broken:
    def __del__(self):
        raise ValueError("told as before")

signals = [number]
try:
    with interruption.interruptible():
        Broken()
        while True:
            Cleared()
except KeyboardInterrupt:
    Broken()
    sys.exit(130)
"""


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_while_an_object_is_cleared_away_prints_nothing(number, status):
    """Python prints a traceback of an exception that a finaliser raises."""
    ended = finished([sys.executable, "-c", CLEARED, str(int(number))], capture_output=True)
    assert ended.returncode == status
    assert b"KeyboardInterrupt" not in ended.stderr
    assert b"SystemExit" not in ended.stderr
    # Every other one is printed, before and after.
    assert ended.stderr.count(b"told as before") == (2 if number == signal.SIGINT else 1)


LEAVING = """
import atexit, os, signal
atexit.register(lambda: print(signal.getitimer(signal.ITIMER_REAL)))
from steelyard.cli import interruption
handler = signal.signal

def killed_while_set(number, new):
    handler(number, new)
    if number == signal.SIGINT:
        os.kill(os.getpid(), signal.SIGTERM)

with interruption.interruptible():
    signal.signal = killed_while_set
"""


def test_a_signal_while_the_block_is_left_leaves_no_timer():
    ended = finished([sys.executable, "-c", LEAVING], capture_output=True)
    assert (ended.returncode, ended.stdout, ended.stderr) == (143, b"(0.0, 0.0)\n", b"")


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("verb", ["identify", "design", "simulate"])
def test_signals_at_random_moments_leave_all_or_nothing(verb, tmp_path):
    small = write_small(tmp_path / "small")
    out = tmp_path / "out"
    arguments = {
        "identify": ["identify", str(small)],
        "design": ["design", "cogiro", "--duration", "10", "--processes", "1"],
        "simulate": ["simulate", "cogiro", "--duration", "20"],
    }[verb]
    command = [sys.executable, "-m", "steelyard", *arguments, "--out", str(out)]

    def taken_away():
        """Files of the results, which are removed."""
        paths = sorted(out.rglob("*"), reverse=True)
        names = {path.relative_to(out).as_posix() for path in paths if path.is_file()}
        for path in paths:
            path.rmdir() if path.is_dir() else path.unlink()
        out.rmdir()
        return names

    assert finished(command, capture_output=True).returncode in (0, 3)
    whole = taken_away()
    rng = random.Random(2)
    for _ in range(10):
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        number = rng.choice([signal.SIGINT, signal.SIGTERM])
        try:
            process.wait(rng.uniform(0.5, 4))
        except subprocess.TimeoutExpired:
            process.send_signal(number)
        _, err = process.communicate(timeout=WORK)
        ended = {signal.SIGINT: 130, signal.SIGTERM: 143}[number]
        # Before the program's first line and after its last one, the signal itself ends the process.
        assert process.returncode in (0, 3, ended, -number), err
        assert b"Traceback" not in err or process.returncode == -number
        # Also a signal that comes when the results are in their place, before they are printed.
        if process.returncode in (0, 3) or out.exists():
            assert taken_away() == whole
        assert {path.name for path in tmp_path.iterdir()} == {"small"}
