"""What may pull at a platform on cables beside them: hoses, air, what damps swings and rubs at
anchors, parts that bend.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steelyard.experiment.model import Experiment
from steelyard.experiment.surroundings import BendingForm
from steelyard.experiment.unread import is_unread, moves_unread
from steelyard.identification.model.calibration_parameters.keys import (
    AIR,
    ATTACHED,
    BENDING,
    DAMPING,
    HOSES,
    ROBOT,
    SWIVEL,
)
from steelyard.identification.model.calibration_parameters.usual_forces import usual_tensions
from steelyard.identification.model.calibration_parameters.vector import (
    CalibrationParameter,
    CalibrationParameters,
)
from steelyard.robot.surroundings import HOSE

_DECAY = 0.2
"""1-sigma of the rate at which swings decay where no force is read [1/s]: two per cent of critical
damping at a hertz."""
_RUBBING = 0.005
"""1-sigma of the torque of dry friction at an anchor over the tension of its cable [m]: plain
bearings of some centimetres, stiff ropes."""
_PULL = 0.004
"""1-sigma of the force of a hose, as a part of all tensions; of its stiffness the same over a
metre."""
_SOFT = 0.1 / (2 * np.pi * 5.0) ** 2
"""1-sigma of what bends: a tenth of what is carried stands on springs of 5 Hz [s^2], and leans by 1
cm under its own weight."""
_BLUFF = 3.0
"""1-sigma of drag coefficients times area, and of turning, in units of the platform's size squared
and to the fifth power: frames and sheets."""


def surroundings(experiment: Experiment) -> Iterator[CalibrationParameter]:
    """What may pull at a platform on cables beside them; none, unless the readings ask for it."""
    yield from _hoses(experiment)
    if not experiment.robot.m:
        return
    size, pull = experiment.robot.size, _PULL * usual_tensions(experiment)
    units = ("N", "N/m", "N m", "N", "m^2", "m^5", "N s/m", "N m s")
    bluff = (_BLUFF * size**2, _BLUFF * size**5)
    sizes = (pull, pull, pull * size, pull * size, *bluff, None, None)
    air = experiment.surroundings.drag
    stated: dict[str, tuple[float, float]] = {}
    if air is not None:
        # Of turning nothing is said but what that area may do at its size.
        turning = (air.value + air.sigma) * size**3
        stated = {AIR[0][0]: (air.value, air.sigma), AIR[1][0]: (0.0, turning)}
    if is_unread(experiment) or moves_unread(experiment):
        # All that moves the platform there is its weight: what decays its swings matters.
        weight = usual_tensions(experiment) / float(np.linalg.norm(experiment.robot.gravity))
        stated |= _decay(experiment.known.get("mass", (weight, 0.0))[0], size)
        yield _rubbing(experiment)
        # Ropes and bearings that bear another load damp and rub otherwise.
        further = [load for load in experiment.loads[1:] if "mass" in load.known]
        for load in further:
            decay = _decay(load.known["mass"][0], size)
            for run in experiment.alone(load).runs:
                yield _rubbing(experiment, run.name)
                for (key, count), unit in zip(DAMPING, units[-2:], strict=True):
                    mean, sigma = (np.full(count, value) for value in decay[key])
                    yield CalibrationParameter(ROBOT, key, run.name, unit, mean, sigma)
    for (key, count), unit, suspected in zip((*ATTACHED, *AIR), units, sizes, strict=True):
        if key in stated:
            mean, sigma = (np.full(count, value) for value in stated[key])
            yield CalibrationParameter(ROBOT, key, None, unit, mean, sigma)
        else:
            none = np.zeros(count)
            yield CalibrationParameter(ROBOT, key, None, unit, none, none, suspected)
    if not is_unread(experiment):
        yield from _bending(experiment)


def _bending(experiment: Experiment) -> Iterator[CalibrationParameter]:
    """Parts of the platform that bend."""
    stated = experiment.surroundings.bending
    soft, known = _SOFT, 0.0
    if isinstance(stated, BendingForm):
        soft, known = stated.share / (2 * np.pi * stated.frequency) ** 2, 1.0
    size, gravity = experiment.robot.size, float(np.linalg.norm(experiment.robot.gravity))
    soft *= usual_tensions(experiment) / gravity
    units = ("kg s^2", "kg m s^2", "kg m^2 s^2")
    for power, ((key, count), unit) in enumerate(zip(BENDING, units, strict=True)):
        sigma, none = soft * size**power, np.zeros(count)
        suspected = sigma if stated is None else None
        deviation = np.full(count, known * sigma)
        yield CalibrationParameter(ROBOT, key, None, unit, none, deviation, suspected)


def _decay(mass: float, size: float) -> dict[str, tuple[float, float]]:
    """What damps swings where no force is read: key -> mean and 1-sigma.

    Args:
        mass: That swings [kg].
        size: Of the robot [m].
    """
    damping = _DECAY * mass
    return {
        key: (0.0, damping * arm) for (key, _), arm in zip(DAMPING, (1.0, size**2), strict=True)
    }


def _rubbing(experiment: Experiment, run: str | None = None) -> CalibrationParameter:
    """Friction where cables turn about their anchors, in a run or in all."""
    m = experiment.robot.m
    rubs = np.full(m, _RUBBING * usual_tensions(experiment) / m)
    return CalibrationParameter(ROBOT, SWIVEL, run, "N m", np.zeros(m), rubs)


def _hoses(experiment: Experiment) -> Iterator[CalibrationParameter]:
    """Those that are stated."""
    units = {"force": "N", "stiffness": "N/m"}
    for i, each in enumerate(experiment.surroundings.attached):
        for part, _ in HOSE:
            stated = getattr(each, part)
            numbers = stated if isinstance(stated, tuple) else (stated,)
            yield CalibrationParameter(
                ROBOT,
                f"{HOSES}.{i + 1}.{part}",
                None,
                units.get(part, "m"),
                np.array([number.value for number in numbers]),
                np.array([number.sigma for number in numbers]),
            )


def hose_keys(parameters: CalibrationParameters) -> list[tuple[str, int]]:
    """Keys and sizes of all that is stated of hoses."""
    return [
        (each.key, len(each.mean))
        for each in parameters.entries
        if each.owner == ROBOT and each.key.startswith(f"{HOSES}.")
    ]
