"""Equations of a segment whose rows are too many to be kept."""

import numpy as np
import pytest
from places import DATA

from steelyard.experiment.read import read_experiment
from steelyard.identification.model.balance import Forces
from steelyard.identification.recursive.follow import begin
from steelyard.identification.solve import segment_equations as module
from steelyard.identification.solve.segment_equations import segment_equations


def in_parts(forces, size):
    """The same forces, so many samples at a time."""
    for start in range(0, len(forces.time), size):
        own = slice(start, start + size)
        yield Forces(
            **{
                **vars(forces),
                "time": forces.time[own],
                "readings": {name: each[own] for name, each in forces.readings.items()},
                "left_out": forces.left_out[own],
                "late": None if forces.late is None else forces.late[own],
            }
        )


@pytest.mark.integration
def test_rows_that_are_made_twice_say_what_rows_that_are_kept_say(monkeypatch):
    found = begin(read_experiment(DATA / "points-00" / "experiment.yaml"))
    fitted = found.begun
    (segment,), (forces,) = fitted.fit.state.segments, fitted.force_samples
    given = (fitted.task, fitted.fit.state, segment, forces, None)
    kept = segment_equations(*given, run=0)
    monkeypatch.setattr(module, "AT_ONCE", 10)
    monkeypatch.setattr(Forces, "parts", lambda self: in_parts(self, 40))
    again = segment_equations(*given, run=0)
    assert len(kept.balances) == 1
    assert len(again.balances) > 1
    for one, other in (
        (kept.equations.normal, again.equations.normal),
        (kept.equations.right, again.equations.right),
        (kept.equations.noise, again.equations.noise),
        (kept.blocks.normal, again.blocks.normal),
        (kept.blocks.right, again.blocks.right),
        (kept.covariance, again.covariance),
        (kept.followed, again.followed),
    ):
        assert np.abs(other - one).max() < 1e-9 * np.abs(one).max()
    assert again.by_source.keys() == kept.by_source.keys()
    for source, matrix in kept.by_source.items():
        assert np.abs(again.by_source[source] - matrix).max() < 1e-9 * np.abs(matrix).max()
    assert again.tally.count == pytest.approx(kept.tally.count)
    assert again.tally.cost == pytest.approx(kept.tally.cost)
    for label, freedom in kept.spent.items():
        assert again.spent[label] == pytest.approx(freedom)
