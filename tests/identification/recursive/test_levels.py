"""How lively a motion is, against motions of known liveliness."""

from dataclasses import replace

import numpy as np
import pytest

from steelyard.identification.model.motion_segment import PARTS, Segment, jerk_matrices
from steelyard.identification.model.segment import POSE, NormalEquations
from steelyard.identification.recursive.window.grid import KnotGrid
from steelyard.identification.recursive.window.levels import Liveliness
from steelyard.identification.recursive.window.past import dense
from steelyard.smoothing import DEGREE

BLOCK = POSE
GRID = KnotGrid(0.0, 0.1, 8, BLOCK)
COUNT = 12  # chunks of a motion
LOOSER = 30.0
LOOSE = dict.fromkeys(PARTS, LOOSER)


WHOLE = {part: dense(band) for part, band in jerk_matrices(GRID.knots(0, COUNT), BLOCK).items()}
# Third derivatives of the spline tell nothing of its values: these are of some metres.
PLACED = 1e-2 * np.eye(len(WHOLE["position"]))


def chunks(rng, intensity, noise):
    """Chunks of a random motion of an intensity, whose coefficients are read with white noise, and the
    equations of these readings."""
    values, vectors = np.linalg.eigh(sum(WHOLE.values()) / intensity + PLACED)
    motion = vectors @ (rng.normal(size=len(values)) / np.sqrt(values))
    read = motion + noise * rng.normal(size=len(values))
    size = GRID.functions * BLOCK
    band = np.zeros((BLOCK * (DEGREE + 1), size))
    band[0] = noise**-2
    side, corner = np.zeros((size, 0)), np.zeros((0, 0))
    for number in range(COUNT):
        first = number * GRID.intervals * BLOCK
        own = read[first : first + size]
        segment = Segment(
            "run", GRID.knots(number), (), own.reshape(-1, BLOCK), jerks=GRID.jerks, looser=LOOSE
        )
        nothing = np.zeros(size)
        yield segment, NormalEquations(band, side, corner, nothing, np.zeros(0), block=BLOCK)


def followed(intensity, noise, begin, motions):
    """Level over what it begins with after each motion, shape (m, 2)."""
    rng, found = np.random.default_rng(4), []
    first = next(chunks(rng, intensity, noise))[0]
    held = dict.fromkeys(PARTS, begin * LOOSER)
    lively = Liveliness.of(replace(first, smoothness=held), GRID.intervals)
    for _ in range(motions):
        for segment, equations in chunks(rng, intensity, noise):
            there = replace(segment, smoothness=lively.smoothness)
            lively = lively.followed(there, equations, COUNT * GRID.length)
        found.append([lively.smoothness[part] / LOOSER for part in PARTS])
    return np.array(found) / begin


@pytest.mark.integration
@pytest.mark.parametrize("begin", [4.0, 100.0])
@pytest.mark.parametrize(("noise", "rel"), [(1e-6, 0.1), (1e-3, 0.1), (1e-2, 0.4), (3e-2, 0.4)])
def test_it_is_found_however_loosely_a_motion_is_held(begin, noise, rel):
    found = followed(20.0, noise, begin, 16) * begin
    assert found[8:].mean(axis=0) == pytest.approx(20.0, rel=rel)


@pytest.mark.integration
def test_what_is_not_resolved_does_not_wander_off():
    found = followed(3.0, 0.1, 3.0, 24)
    assert np.abs(np.log2(found)).max() < 2.0
