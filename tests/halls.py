"""Halls with cables: poses at rest of known truth, by plain vector algebra."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.instruments import Attitude, Length, Position, Tension
from steelyard.robot.model import Robot

NOISE = 5e-4  # [m], of lengths and of the tracker
TARGET = np.array([0.1, 0.2, 1.1])
MASS, CENTRE, G = 100.0, np.array([0.05, -0.03, -0.1]), 9.81
POSES = 40
EXACT_PLACE = {"target": 0, "frame": {"position": 0, "rotation": 0}}


def hall(m, rng):
    """A robot of m cables from points, on two heights."""
    turn = np.linspace(0, 2 * np.pi, m, endpoint=False)
    anchors = np.column_stack([6 * np.cos(turn), 5 * np.sin(turn), 5 + 0.5 * (np.arange(m) % 2)])
    attachments = np.column_stack(
        [0.5 * np.cos(1.3 * turn + 0.4), 0.5 * np.sin(1.3 * turn + 0.4), 0.6 * (np.arange(m) % 2)]
    )
    return Robot("hall", anchors + 0.05 * rng.standard_normal((m, 3)), attachments)


def recorded(seed=0, m=8, poses=40, off=0.3, scale=1.0, attitude=True, flat=False, **uncertainty):
    """An experiment whose robot file is off, and the robot as it is."""
    rng = np.random.default_rng(seed)
    true = hall(m, rng)
    place = rng.uniform([-2.5, -2, 1], [2.5, 2, 3], (poses, 3))
    if flat:
        place[:, 2] = 2.0
    turned = Rotation.from_rotvec(rng.uniform(-0.4, 0.4, (poses, 3)))
    R = turned.as_matrix()
    points = place[:, None] + np.einsum("nij,mj->nmi", R, true.attachments)
    length = np.linalg.norm(points - true.anchors, axis=2)
    offset = rng.normal(0, 0.5, m)
    tracker = place + R @ TARGET + NOISE * rng.standard_normal((poses, 3))
    noisy = turned * Rotation.from_rotvec(1e-3 * rng.standard_normal((poses, 3)))
    number = np.arange(poses, dtype=float)
    streams = {
        "tracker": Stream(number, {"position": tracker}, "tracker"),
        "lengths": Stream(
            number,
            {"length": scale * length + offset + NOISE * rng.standard_normal(length.shape)},
            "lengths",
        ),
    }
    instruments = {
        "tracker": Position.model_validate(
            {
                "kind": "position",
                "target": tuple(TARGET.tolist()),
                "noise": NOISE,
                "calibration": EXACT_PLACE,
            }
        ),
        "lengths": Length.model_validate({"kind": "length", "noise": NOISE}),
    }
    if attitude:
        streams["attitude"] = Stream(number, {"orientation": noisy.as_matrix()}, "attitude")
        instruments["attitude"] = Attitude.model_validate(
            {"kind": "attitude", "noise": 1e-3, "calibration": {"misalignment": 0, "reference": 0}}
        )
    # Drawn with the 1-sigma that is stated, so that the priors are true.
    stated = {"anchor": off, "attachment": 0.03, **uncertainty}
    drawn = replace(
        true,
        anchors=true.anchors + stated["anchor"] * rng.standard_normal((m, 3)),
        attachments=true.attachments + stated["attachment"] * rng.standard_normal((m, 3)),
    )
    runs = (Run("poses", streams, static=True),)
    return Experiment("calibration", drawn, instruments, runs, uncertainty=stated), true


def errors(found, true):
    points = found.points
    return np.concatenate(
        [
            (points["anchor"] - true.anchors).ravel(),
            (points["attachment"] - true.attachments).ravel(),
        ]
    )


def hung(seed, *, off=0.05, tracker=False, force=1.0, cells=None):
    """Lengths and forces of a platform of a hundred kilograms on eight cables that pull at 400 N;
    gains and offsets of the cells are drawn unless they are given."""
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
    drawn = 1 + 0.005 * noise(8), 2.0 * noise(8)
    gain, offset = cells or drawn
    reading = tension * gain + offset + force * noise(tension.shape)
    streams = {
        "cables": Stream(number, {"tension": reading}, "cables"),
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
