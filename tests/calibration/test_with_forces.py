"""Poses at rest with forces: how a platform hangs tells where its cables are fixed, and its body."""

from dataclasses import replace

import numpy as np
import pytest
from halls import NOISE, TARGET, errors, hall
from scipy.spatial.transform import Rotation

from steelyard.calibration.calibrate import calibrate
from steelyard.experiment.model import Experiment, Run, Stream
from steelyard.instruments import Length, Position, Tension

MASS, CENTRE, G = 100.0, np.array([0.05, -0.03, -0.1]), 9.81
POSES = 40


def hung(seed, *, off=0.05, tracker=False, force=1.0):
    """Lengths and forces of a platform of a hundred kilograms on eight cables that pull at 400 N."""
    rng = np.random.default_rng(seed)
    true = hall(8, rng)
    place = rng.uniform([-2.5, -2, 1], [2.5, 2, 3], (POSES, 3))
    turned = Rotation.from_rotvec(rng.uniform(-0.4, 0.4, (POSES, 3))).as_matrix()
    arms = np.einsum("nij,mj->nmi", turned, true.attachments)
    along = true.anchors - (place[:, None] + arms)
    length = np.linalg.norm(along, axis=2)
    pull = along / length[:, :, None]
    # Wrench in the world about the origin of the platform.
    W = np.concatenate([pull, np.cross(arms, pull)], axis=2).transpose(0, 2, 1)
    weight = np.array([0.0, 0.0, -MASS * G])
    needed = -np.concatenate(
        [np.tile(weight, (POSES, 1)), np.cross(turned @ CENTRE, weight)], axis=1
    )
    even = np.full(8, 400.0)
    tension = even + np.einsum("nmk,nk->nm", np.linalg.pinv(W), needed - W @ even)
    number = np.arange(POSES, dtype=float)
    noise = rng.standard_normal
    streams = {
        "cables": Stream(
            number,
            {
                "tension": tension * (1 + 0.005 * noise(8))
                + 2.0 * noise(8)
                + force * noise(tension.shape)
            },
            "cables",
        ),
        "lengths": Stream(
            number,
            {"length": length + rng.normal(0, 0.5, 8) + NOISE * noise(length.shape)},
            "lengths",
        ),
    }
    instruments = {
        "cables": Tension.model_validate(
            {
                "kind": "tension",
                "noise": force,
                "calibration": {"offset": 2.0, "gain": 0.005, "common_gain": 0.0},
            }
        ),
        "lengths": Length.model_validate({"kind": "length", "noise": NOISE}),
    }
    if tracker:
        streams["tracker"] = Stream(
            number,
            {"position": place + turned @ TARGET + NOISE * noise((POSES, 3))},
            "tracker",
        )
        exact = {"target": 0, "frame": {"position": 0, "rotation": 0}}
        instruments["tracker"] = Position.model_validate(
            {
                "kind": "position",
                "target": tuple(TARGET.tolist()),
                "noise": NOISE,
                "calibration": exact,
            }
        )
    stated = {"anchor": off, "attachment": 0.01, "gravity": 0.0}
    drawn = replace(
        true,
        anchors=true.anchors + off * noise((8, 3)),
        attachments=true.attachments + 0.01 * noise((8, 3)),
    )
    runs = (Run("poses", streams, static=True),)
    return Experiment("hanging", drawn, instruments, runs, uncertainty=stated), true


def test_lengths_and_forces_alone_tell_the_shape():
    experiment, _ = hung(0)
    found = calibrate(experiment)
    assert not found.reasons
    assert found.gauges["anchor"].untied == ("x", "y", "z", "rotation about z")
    # Up is told by the weight.
    assert "rotation about x" not in found.gauges["anchor"].untied


def test_intervals_cover_up_to_the_gauge():
    chi = []
    for seed in range(10):
        experiment, true = hung(seed)
        off = errors(found := calibrate(experiment), true)
        assert not found.reasons
        chi.append(off @ np.linalg.solve(found.covariance, off) / len(off))
    assert 0.8 < np.mean(chi) < 1.25


@pytest.mark.parametrize("seed", range(3))
def test_forces_beside_a_tracker_tell_the_body(seed):
    experiment, true = hung(seed, tracker=True, off=0.3)
    found = calibrate(experiment)
    assert not found.reasons
    body, sigma = found.body
    assert abs(body[0] - MASS) < 4 * sigma[0] < 0.02 * MASS
    assert (np.abs(body[1:4] - CENTRE) < 4 * sigma[1:4]).all()
    # At rest nothing tells how a body turns.
    assert np.isnan(body[4:]).all()
    assert found.to_dict()["body"]["inertia"][0][0] is None
    assert np.abs(found.points["anchor"] - true.anchors).max() < 0.05


def test_a_sign_that_is_wrong_is_rejected():
    experiment, _ = hung(1, tracker=True)
    (run,) = experiment.runs
    cables = run.streams["cables"]
    values = cables.values["tension"] * np.array([1, 1, -1, 1, 1, 1, 1, 1])
    streams = {**run.streams, "cables": replace(cables, values={"tension": values})}
    assert calibrate(replace(experiment, runs=(replace(run, streams=streams),))).reasons
