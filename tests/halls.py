"""Halls with cables: poses at rest of known truth, by plain vector algebra."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.experiment.model import Experiment, Run, Stream
from steelyard.instruments import Attitude, Length, Position
from steelyard.robot.model import Robot

NOISE = 5e-4  # [m], of lengths and of the tracker
TARGET = np.array([0.1, 0.2, 1.1])
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
