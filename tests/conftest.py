"""What several test files need: where recordings are, and experiments that were simulated once;
and that collecting them is quick.
"""

import gc
import json
import os
import re
import signal
import sys
from itertools import combinations
from zlib import crc32

# Many small matrices: threads of their own cost more than they do, the more so beside other work.
# Before NumPy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Results made twice are the same bytes only with a stated time: a second may pass between them.
os.environ["SOURCE_DATE_EPOCH"] = "1700000000"
# Sentences are broken at the same words on every machine.
os.environ["COLUMNS"] = "80"

import numpy as np
import pytest
from browser import browser
from places import DATA, ROOT

from steelyard.cli import main
from steelyard.inertia import Inertia

TIERS = ("integration", "mujoco", "browser", "slow")
MARK_OF_A_FILE = re.compile(r"^pytestmark = \[?pytest\.mark\.(\w+)", re.MULTILINE)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Look for no garbage meanwhile: millions of objects are made that stay."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()
        # And rarely later: a twentieth of the time.
        gc.set_threshold(100_000, 20, 20)


def pytest_addoption(parser):
    for mark in ("long", "slow"):
        parser.addoption(
            f"--{mark}-part",
            default="0/1",
            metavar="K/N",
            help=f"Of the tests that are marked {mark}, those whose number is K of N; 0/1: all."
            " A test that is long counts as no other.",
        )


def pytest_collection_modifyitems(config, items):
    """Leave slow tests of other parts out, the same ones in every process."""
    part = {
        mark: tuple(int(each) for each in config.getoption(f"{mark}_part").split("/"))
        for mark in ("long", "slow")
    }

    def is_in_part(item):
        mark = next((each for each in part if item.get_closest_marker(each)), None)
        number, parts = part.get(mark, (0, 1))
        return crc32(item.nodeid.encode()) % parts == number % parts

    left_out = [item for item in items if not is_in_part(item)]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        gone = set(left_out)
        items[:] = [item for item in items if item not in gone]


def pytest_ignore_collect(collection_path, config):
    """Do not even import a file whose mark, alone or with others, is not asked for by ``-m``."""
    expression = config.getoption("markexpr")
    if not expression or collection_path.suffix != ".py":
        return None
    mark = MARK_OF_A_FILE.search(collection_path.read_text(encoding="utf-8"))
    if mark is None or mark[1] not in TIERS:
        return None
    return not any(asked_for(expression, {mark[1], *others}) for others in sets_of(TIERS))


def asked_for(expression, marks):
    """Whether an expression of ``-m`` takes tests with these marks, so far as that is known."""
    try:
        return eval(expression, {"__builtins__": {}}, {name: name in marks for name in TIERS})
    except (NameError, SyntaxError, TypeError):
        return True


def sets_of(names):
    return (chosen for n in range(len(names) + 1) for chosen in combinations(names, n))


@pytest.fixture(scope="session")
def recordings():
    """Simulated recordings of another simulator (tests/data/README.md)."""
    return DATA


@pytest.fixture(scope="session")
def recorded_truth(recordings):
    """Name of a recording -> its true body."""
    values = json.loads((recordings / "truth.json").read_text())
    return {name: Inertia.from_dict(entry) for name, entry in values.items()}


@pytest.fixture(scope="session")
def examples():
    return ROOT / "examples"


@pytest.fixture(scope="module")
def driver():
    """A browser, one for the tests of a file."""
    with browser() as opened:
        yield opened


@pytest.fixture
def rng():
    return np.random.default_rng(20170821)


@pytest.fixture
def run(monkeypatch, capfd):
    """Run the command line in this process: exit status, stdout, stderr."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["steelyard", *map(str, arguments)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as end:
            main()
        out, err = capfd.readouterr()
        return end.value.code, out, err

    return run


@pytest.fixture(autouse=True, scope="session")
def interrupts_are_heard():
    """Where the tests run in the background, a shell has SIGINT ignored, also by what they begin."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
