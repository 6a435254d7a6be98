"""A process that was forked beside the threads of a library says so, and does not wait."""

import os
import platform
import sys

import pytest
from recordings import write_small
from time_limits import finished

pytestmark = pytest.mark.integration

FORKED = """
import os, sys
from steelyard.errors import SteelyardError
from steelyard.experiment.read import read_experiment
from steelyard.identification.identify import identify
experiment = read_experiment(sys.argv[1])
own = identify(experiment, ["two-step"]).estimate.value.tolist()
child = os.fork()
if not child:
    assert identify(experiment, ["two-step"]).estimate.value.tolist() == own
    try:
        read_experiment(sys.argv[1])
    except SteelyardError as error:
        print(error, flush=True)
        os._exit(7)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.slow
def test_reading_again_after_a_fork_is_refused_at_once(tmp_path):
    experiment = write_small(tmp_path / "small")
    command = [sys.executable, "-W", "ignore", "-c", FORKED, str(experiment)]
    ended = finished(command, capture_output=True, text=True)
    said, status = ended.stdout.splitlines()
    assert status == "7"
    assert "get_context('spawn')" in said


HOLES = """
from pathlib import Path
import numpy as np
from steelyard.processes.heap import give_back

def resident():
    text = Path("/proc/self/status").read_text()
    return int(text.partition("VmRSS:")[2].split()[0]) / 1024

kept = [np.ones(8000) for _ in range(1000)]
kept = kept[::100]
before = resident()
give_back()
print(before - resident(), sum(float(each.sum()) for each in kept))
"""


@pytest.mark.skipif(
    platform.libc_ver()[0] != "glibc", reason="what other C libraries keep is theirs"
)
def test_memory_between_what_stays_is_given_back():
    found = finished([sys.executable, "-c", HOLES], capture_output=True, text=True)
    given, total = (float(each) for each in found.stdout.split())
    assert given > 40  # of 61 MiB, of which .6 stay
    assert total == 80_000


REUSED = """
import resource
import numpy as np
from steelyard.processes.heap import keep_for_reuse

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(100):
        np.ones(100_000)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

faults()
before = faults()
keep_for_reuse()
faults()
print(before, faults())
"""


@pytest.mark.skipif(
    platform.libc_ver()[0] != "glibc", reason="what other C libraries keep is theirs"
)
def test_memory_is_kept_for_the_next_matrix():
    """As workers of Dask begin."""
    found = finished(
        [sys.executable, "-c", REUSED],
        capture_output=True,
        text=True,
        env={**os.environ, "MALLOC_TRIM_THRESHOLD_": "65536"},
    )
    before, after = (int(each) for each in found.stdout.split())
    assert before > 10_000  # pages of 4 KiB, of 80 MB
    assert after < before / 100
