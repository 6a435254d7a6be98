"""Free swings to record as a document: on which cables, where, how to push, and what they will
tell.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.digits import LABELS, deviation, figures, fixed
from steelyard.estimates.per_mass import PerMass
from steelyard.excitation.swings.candidate_swings import Swing
from steelyard.excitation.swings.swing_design import SwingDesign
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


def free_swings_document(design: SwingDesign) -> Document:
    """Everything that there is to say and to see of swings that are to be recorded."""
    scene: list[Block] = []
    if (shape := shape_of(design.experiment.robot)) is not None:
        scene.append(robot_scene(shape, [_course(design)], None))
    return Document(
        f"{design.experiment.robot.name}: free swings",
        _lead(design),
        (
            Section("swings", "What to record", (_where(design), _pushes(design), *scene)),
            Section(
                "precision",
                "Expected uncertainty",
                (_told(design), _comparison(design), Statements(tuple(_statements(design)))),
            ),
        ),
    )


def _lead(design: SwingDesign) -> Statement:
    """What is promised, in one sentence."""
    found = design.predicted.per_mass
    count = f"{len(design.swings)} swing{'' if len(design.swings) == 1 else 's'}"
    text = f"{count} of {design.duration:g} s on {_cables(design.cables)}"
    if found is None or not np.isfinite(found.standard_deviation).all():
        return Statement(f"{text} do not tell the whole of the inertia per mass.", "note")
    return Statement(
        f"{text} tell the centre of gravity to"
        f" {deviation(_MM * found.standard_deviation[:3].max())} mm and the moments per mass to"
        f" {deviation(100 * _share(found))} % (1-sigma, the largest).",
        "good",
    )


def _cables(cables: tuple[int, ...]) -> str:
    """Numbers in words."""
    if len(cables) == 1:
        return f"cable {cables[0]}"
    return f"cables {', '.join(map(str, cables[:-1]))} and {cables[-1]}"


def _share(found: PerMass) -> float:
    """Largest 1-sigma of a moment per mass over the largest moment per mass."""
    return float(found.standard_deviation[3:6].max() / found.value[3:6].max())


def _where(design: SwingDesign) -> Grid:
    """Places of rest and what the cables measure there."""
    rows = tuple(
        (
            str(i + 1),
            *(fixed(value, 3) for value in each.pose[:3]),
            *(fixed(value, 1) for value in np.degrees(each.pose[3:])),
            ", ".join(fixed(value, 3) for value in each.modes.lengths),
        )
        for i, each in enumerate(design.swings)
    )
    head = ("swing", "x [m]", "y [m]", "z [m]", "roll [°]", "pitch [°]", "yaw [°]", "lengths [m]")
    caption = (
        f"Where the platform hangs at rest on {_cables(design.cables)}, and the unstrained lengths"
        " that lock it there"
    )
    return Grid(caption, head, rows, frozenset(range(1, 7)))


def _pushes(design: SwingDesign) -> Grid:
    """How to push, what that swings with, and what is known by then."""
    rows = []
    for i, (each, step) in enumerate(zip(design.swings, design.best.steps, strict=True)):
        rows.append(
            (
                str(i + 1),
                each.push,
                _frequency(each),
                figures(_MM * each.amplitude, 2),
                deviation(_MM * step.standard_deviation[:3].max()),
                deviation(100 * _share(step)),
            )
        )
    head = (
        "swing",
        "push",
        "frequency [Hz]",
        "amplitude [mm]",
        "cog [mm]",
        "moments / mass [%]",
    )
    return Grid(
        "How to push, and the largest 1-sigma with this swing and those before it",
        head,
        tuple(rows),
        frozenset({2, 3, 4, 5}),
    )


def _frequency(swing: Swing) -> str:
    """Of the modes that are pushed."""
    if swing.frequency is not None:
        return figures(swing.frequency, 3)
    return ", ".join(figures(value, 3) for value in swing.modes.frequencies)


def _told(design: SwingDesign) -> Grid:
    """1-sigma of the nine, of all swings together."""
    found = design.predicted.per_mass
    rows = []
    for i, (name, unit, factor) in enumerate(LABELS[1:]):
        sigma = np.nan if found is None else found.standard_deviation[i]
        label, scale, unit = (name, factor, unit) if i < 3 else (f"{name} / mass", 1.0, "m²")
        text = deviation(scale * sigma) if np.isfinite(sigma) else _NOT_TOLD
        rows.append((label, unit, text))
    return Grid("All swings together", ("", "unit", "1-sigma"), tuple(rows), frozenset({2}))


def _comparison(design: SwingDesign) -> Grid:
    """What the platform would tell on other cables."""
    rows = tuple(
        (
            ", ".join(map(str, each.cables)),
            str(len(each.swings)),
            deviation(_MM * each.steps[-1].standard_deviation[:3].max()),
            deviation(100 * _share(each.steps[-1])),
        )
        for each in design.sets
    )
    head = ("cables", "swings", "cog [mm]", "moments / mass [%]")
    return Grid(
        "Sets of cables compared, pushed in all directions at once at every place",
        head,
        rows,
        frozenset({1, 2, 3}),
    )


def _statements(design: SwingDesign) -> Iterator[Statement]:
    """What the prediction rests on."""
    if design.assumed:
        yield Statement(
            "Sensors were not named: motion capture of .3 mm and .5 mrad at 100 Hz is assumed, its"
            " frame and its place on the platform known to some millimetres; give --sensors FILE"
            " for your own.",
            "note",
        )
    yield Statement(
        "Lock the winches, push by hand, step back, then record. The centre of gravity is as"
        " uncertain as the attachments that it is measured from; mass and inertia follow once the"
        " platform is weighed."
    )
    yield Statement(
        f"Chosen out of {design.candidates} swings in which all cables stay taut, so that the"
        " volume of the uncertainty of centre of gravity and inertia per mass is least. Smaller"
        " swings tell less, in proportion; damping shortens them."
    )


def _course(design: SwingDesign) -> Replay:
    """One swing after the other."""
    steps = np.linspace(0.0, min(design.duration, 5.0), 100)
    poses = np.concatenate([each.trajectory.derivative(steps, 0) for each in design.swings])
    times = np.concatenate([steps + i * (steps[-1] + 0.5) for i in range(len(design.swings))])
    turned = Rotation.from_euler("ZYX", poses[:, :2:-1])
    rotation = turned.as_quat(scalar_first=True, canonical=True)
    return Replay("swings", times, poses[:, :3], rotation)
