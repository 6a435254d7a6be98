"""What several test files need: where recordings are, and experiments that were simulated once."""

import json
import os
import sys

# Many small matrices: threads of their own cost more than they do, the more so beside other work.
# Before NumPy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from browser import browser
from places import DATA, ROOT

from steelyard.cli import main
from steelyard.inertia import Inertia


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
