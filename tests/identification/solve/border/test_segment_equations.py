"""Equations of a segment whose rows are too many to be kept."""

import numpy as np
import pytest
from places import DATA

from steelyard.experiment.read import read_experiment
from steelyard.identification.model.accumulation import accumulate
from steelyard.identification.model.balance import Forces
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import POSE, WIDTH, Rows
from steelyard.identification.recursive.follow import begin
from steelyard.identification.solve.border import segment_equations as module
from steelyard.identification.solve.border import stretches
from steelyard.identification.solve.border.segment_equations import segment_equations
from steelyard.smoothing import DEGREE, knots


def in_parts(forces, size):
    """The same forces, so many samples at a time."""
    for start in range(0, len(forces.time), size):
        yield forces.part(slice(start, start + size))


@pytest.mark.integration
def test_rows_that_are_made_twice_say_what_rows_that_are_kept_say(monkeypatch):
    found = begin(read_experiment(DATA / "points-00" / "experiment.yaml"))
    fitted = found.begun
    (segment,), (forces,) = fitted.fit.state.segments, fitted.force_samples
    given = (fitted.task, fitted.fit.state, segment, forces, None)
    kept = segment_equations(*given, run=0)
    monkeypatch.setattr(module, "_KEPT", 10)
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


@pytest.mark.parametrize("most", [1, 40, 10_000])
def test_stretches_say_what_their_rows_say_once_the_motion_has_followed(most, monkeypatch, rng):
    functions, border = 11, 4
    instants = functions - DEGREE

    def rows(n, k, columns, label):
        first = rng.integers(0, instants, n)
        first[first == 2] = 3  # nothing is read in one of them
        derivatives = rng.normal(size=(n, k, WIDTH)), rng.normal(size=(n, k, len(columns)))
        return Rows(first, rng.normal(size=(n, k)), *derivatives, columns, label)

    one, other = ("imu", "rates"), ("tracker", "position")
    parts = [
        rows(50, 3, np.arange(border), one),
        rows(30, 2, np.array([3, 1]), other),
        rows(5, 1, np.array([0]), None),  # readings of nothing
    ]
    knotted = Segment("run", knots(0.0, instants * 0.5, 0.5), (), np.zeros((functions, POSE)))
    every = accumulate(functions, border, parts)
    number = np.array([0, 0, 0, 1, 1, 2])
    monkeypatch.setattr(stretches, "_ROWS_AT_ONCE", most)
    normal, right, by_source = stretches.by_stretches(knotted, parts, every, number)
    expected, expected_right = np.zeros((3, border, border)), np.zeros((3, border))
    sums = {one: np.zeros((border, border)), other: np.zeros((border, border))}
    for part in parts[:2]:
        for sample, first in enumerate(part.first):
            followed = every.followed[first * POSE : first * POSE + WIDTH]
            for row in range(part.residual.shape[1]):
                line = -part.by_motion[sample, row] @ followed
                line[part.columns] += part.by_errors[sample, row]
                expected[number[first]] += np.outer(line, line)
                sums[part.label] += np.outer(line, line)
                expected_right[number[first]] -= part.residual[sample, row] * line
    assert normal == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert right == pytest.approx(expected_right, rel=1e-9, abs=1e-9)
    assert by_source.keys() == sums.keys()
    for source, matrix in sums.items():
        assert by_source[source] == pytest.approx(matrix, rel=1e-9, abs=1e-9)
