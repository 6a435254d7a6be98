"""Experiments without some of their instruments."""

import pytest
from recordings import RUN, simulated, write_small

from steelyard.errors import InputError


def test_what_an_instrument_has_recorded_is_left_out():
    whole = simulated()
    less = whole.without("tracker", "imu")
    assert set(whole.run(RUN).streams) - set(less.run(RUN).streams) == {"tracker", "imu"}
    assert whole.without() is not whole
    assert whole.without().run(RUN).streams == whole.run(RUN).streams


def test_forces_and_names_that_are_none_are_not_left_out():
    with pytest.raises(InputError, match="found 'cables', which measures the forces"):
        simulated().without("cables")
    with pytest.raises(InputError, match=r"without: expected one of cables.*found 'camera'"):
        simulated().without("camera")


@pytest.mark.integration
def test_identify_leaves_it_out(run, tmp_path):
    path = write_small(tmp_path)
    status, out, _ = run("identify", path, "--without", "tracker", "--json")
    assert status in {0, 3}
    assert '"tracker"' not in out
    assert run("identify", path, "--without", "camera")[0] == 2
