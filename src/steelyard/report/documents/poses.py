"""Poses to record at rest as a document: what they will tell, what they will not, and where they
are.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.calibration.first_poses import UPRIGHT
from steelyard.calibration.geometry_calibration import GeometryCalibration
from steelyard.digits import deviation, fixed
from steelyard.excitation.poses.pose_design import PoseDesign
from steelyard.identification.model.calibration_parameters import ROBOT
from steelyard.instruments.base import TIME_CONSTANT
from steelyard.report.blocks.document import (
    Block,
    Document,
    Grid,
    Replay,
    Section,
    Statement,
    Statements,
)
from steelyard.report.blocks.robot_scene import robot_scene
from steelyard.report.evidence.gather import shape_of

_MM = 1000.0
_NOT_TOLD = "not told"


def poses_document(design: PoseDesign) -> Document:
    """Everything that there is to say and to see of poses for a calibration."""
    scene: list[Block] = []
    if (shape := shape_of(design.experiment.robot)) is not None:
        scene.append(robot_scene(shape, [_course(design)], None))
    return Document(
        f"{design.experiment.robot.name}: poses at rest for a calibration",
        _lead(design),
        (
            Section(
                "precision",
                "Expected uncertainty",
                (
                    _points(design),
                    _instruments(design.predicted),
                    _comparison(design),
                    _said(design),
                ),
            ),
            Section("poses", "The poses", (_poses(design), *scene)),
        ),
    )


def _lead(design: PoseDesign) -> Statement:
    """What is promised, in one sentence."""
    told, sigma = design.predicted.told, design.predicted.deviations
    known = {key: each[told[key]] for key, each in sigma.items()}
    if not any(each.size for each in known.values()):
        return Statement(f"{len(design.poses)} poses at rest do not tell this geometry.", "bad")
    parts = [
        f"{key}s to {deviation(_MM * np.median(each))} mm"
        for key, each in known.items()
        if each.size
    ]
    text = (
        f"{len(design.poses)} poses at rest tell {' and '.join(parts)} (1-sigma of a coordinate, in"
        " the median)."
    )
    return Statement(text, "good" if not design.predicted.unobservable else "note")


def _points(design: PoseDesign) -> Grid:
    """1-sigma of anchors and attachments."""
    told, sigma = design.predicted.told, design.predicted.deviations
    parameters = design.predicted.found.parameters
    rows = []
    for key, each in sigma.items():
        before = parameters.deviation[parameters.places[ROBOT, key, None]].reshape(-1, 3)
        for i, (own, known) in enumerate(zip(each, told[key], strict=True)):
            cells = [
                deviation(_MM * value) if there else _NOT_TOLD
                for value, there in zip(own, known, strict=True)
            ]
            rows.append((f"{key} {i + 1}", "mm", *cells, deviation(_MM * before[i].max())))
    head = ("point", "unit", "x", "y", "z", "before")
    return Grid("1-sigma of anchors and attachments", head, tuple(rows), frozenset({2, 3, 4, 5}))


def _instruments(predicted: GeometryCalibration) -> Grid:
    """1-sigma of what is uncertain about the instruments."""
    parameters, sigma = predicted.found.parameters, predicted.found.deviations
    rows = tuple(
        (
            parameters.names[place],
            entry.unit,
            deviation(sigma[place]),
            deviation(entry.deviation[i]),
        )
        for place, entry, i in parameters.components()
        if entry.owner not in {ROBOT, UPRIGHT} and entry.deviation[i] > 0 and entry.key != "delay"
    )
    head = ("instrument", "unit", "1-sigma", "before")
    return Grid("1-sigma of the instruments", head, rows, frozenset({2, 3}))


def _comparison(design: PoseDesign) -> Grid:
    """Mean 1-sigma of these poses against that of the regular grid."""
    own = design.predicted.deviations
    rows = []
    for key, each in own.items():
        ratio = design.over_grid.get(key)
        if design.grid is None or ratio is None:
            rows.append((f"{key}s", "mm", deviation(_MM * each.mean()), "-", "-"))
            continue
        other = design.grid.deviations[key].mean()
        rows.append(
            (
                f"{key}s",
                "mm",
                deviation(_MM * each.mean()),
                deviation(_MM * other),
                fixed(ratio, 2),
            )
        )
    head = ("mean 1-sigma of", "unit", "these poses", "regular grid", "ratio")
    caption = f"Against a regular grid of {len(design.poses)} poses"
    return Grid(caption, head, tuple(rows), frozenset({2, 3, 4}))


def _said(design: PoseDesign) -> Statements:
    """Gauge, what is not told, and what the prediction rests on."""
    return Statements(tuple(_statements(design)))


def _statements(design: PoseDesign) -> Iterator[Statement]:
    """One after the other."""
    predicted = design.predicted
    for gauge in predicted.gauges.values():
        yield Statement(str(gauge)[:1].upper() + str(gauge)[1:] + ".")
    if predicted.unobservable:
        yield Statement(
            "These poses will not tell, so that it stays as it is known beforehand:"
            f" {', '.join(predicted.unobservable)}.",
            "note",
        )
    if exact := _exact(predicted):
        yield Statement(f"Taken as exact, since it is stated so or not at all: {', '.join(exact)}.")
    if design.assumed:
        yield Statement(
            "Sensors were not named: a tracker of .5 mm whose target is known to a decimetre and"
            " cable lengths of .5 mm with unknown zeros are assumed; give --sensors FILE for your"
            " own.",
            "note",
        )
    if design.grid is None:
        yield Statement(
            "There is no regular grid to compare with: the cables cannot hold so many of its"
            " poses, or they leave the geometry undetermined."
        )
    if not any(each.is_force for each in design.experiment.instruments.values()):
        yield Statement(
            "No instrument reads forces: that cables sag and stretch is left out of the"
            " prediction, and will be in the lengths.",
            "note",
        )
    yield Statement(
        f"Chosen out of {design.candidates} poses that the cables can hold, so that the volume of"
        " the uncertainty of anchors and attachments is least. 1-sigma are those of the noise of"
        " one row a pose as it is stated; the mean of many readings in a pose has less, if it is"
        " stated so."
    )


def _exact(predicted: GeometryCalibration) -> list[str]:
    """Errors of instruments that a prediction does not reckon with, by name."""
    return [
        f"{entry.owner}.{entry.key}"
        for entry in predicted.found.parameters.entries
        if entry.owner not in {ROBOT, UPRIGHT}
        and not entry.deviation.any()
        and not entry.is_absent
        and entry.key not in {TIME_CONSTANT, "delay"}
    ]


def _poses(design: PoseDesign) -> Grid:
    """The poses themselves."""
    rows = tuple(
        (
            str(i + 1),
            *(fixed(value, 3) for value in pose[:3]),
            *(fixed(value, 1) for value in np.degrees(pose[3:])),
        )
        for i, pose in enumerate(design.poses)
    )
    head = ("pose", "x [m]", "y [m]", "z [m]", "roll [°]", "pitch [°]", "yaw [°]")
    return Grid("In the order in which to go there", head, rows, frozenset(range(1, 7)))


def _course(design: PoseDesign) -> Replay:
    """Pose after pose, one a second."""
    poses = design.poses
    turned = Rotation.from_euler("ZYX", poses[:, :2:-1])
    rotation = turned.as_quat(scalar_first=True, canonical=True)
    return Replay("poses", np.arange(len(poses), dtype=np.float64), poses[:, :3], rotation)
