"""Units that give themselves away by size alone, before anything is compared: a robot in
millimetres, forces that no such robot has.

Forces and the body that they carry scale together: no motion tells their unit. What does is what
the robot file says of tensions, the air that a platform of its size displaces, and noise that was
stated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from steelyard.experiment.model import Experiment
from steelyard.inspection.mistakes.amendment import (
    ROBOT,
    SIMPLE,
    Amendment,
    Subject,
    other_units,
    scale_key,
    units_key,
)
from steelyard.inspection.mistakes.columns import LIKELY_UNITS
from steelyard.inspection.mistakes.geometry import in_millimetres
from steelyard.inspection.mistakes.search import Mistake
from steelyard.inspection.mistakes.settings import SIZES, SizeSettings
from steelyard.inspection.settings import STREAMS
from steelyard.inspection.streams import white_noise
from steelyard.units import FACTORS


def size_mistakes(experiment: Experiment, settings: SizeSettings = SIZES) -> list[Mistake]:
    """What cannot be in the unit that is stated, each with the first run that shows it.

    Args:
        experiment: With its recordings.
        settings: How large robots and forces are.
    """
    of_robot = list(_of_robot(experiment, settings))
    # Nothing that is compared with such a robot means anything.
    return of_robot or list(_of_forces(experiment, settings))


def _mistake(experiment: Experiment, amendment: Amendment, run: str, said: str) -> Mistake:
    """One that no comparison has shown."""
    return Mistake(amendment, run, (), (), np.inf, (), said)


def _of_robot(experiment: Experiment, settings: SizeSettings) -> Iterator[Mistake]:
    """Anchors or attachments in millimetres."""
    found = in_millimetres(experiment, settings)
    if found is None:
        return
    which = found.which
    amendment = Subject(ROBOT, "anchors, attachments").amendment(
        "unit of the geometry",
        f"has {which} in mm, not in m",
        f"write {which} in metres in the robot file: every coordinate divided by 1000",
        lambda excerpt: excerpt,
        SIMPLE,
    )
    yield _mistake(experiment, amendment, experiment.runs[0].name, found.said)


def _of_forces(experiment: Experiment, settings: SizeSettings) -> Iterator[Mistake]:
    """Tensions in a unit that neither robot nor noise allow."""
    robot = experiment.robot
    for name, instrument in experiment.instruments.items():
        own = [run for run in experiment.runs if name in run.streams]
        if instrument.measured_force != "tension" or instrument.stands_in(robot.m) or not own:
            continue
        readings = np.concatenate([run.streams[name].values["tension"] for run in own])
        size = float(np.nanmedian(np.abs(readings)))
        known = FACTORS["N"]
        table = {unit: known[unit] for unit in ("N", *LIKELY_UNITS["N"])}
        candidates = list(other_units(table))
        said, otherwise = _beyond(experiment, size, settings), list[str]()
        if said:
            possible = [c for c in candidates if not _beyond(experiment, size * c[2], settings)]
            usual = replace(settings, beyond=1.0, air=settings.usual)
            fitting = [c for c in possible if not _beyond(experiment, size * c[2], usual)]
            fitting = fitting or possible
        else:
            stated, seen = _noise(experiment, name, settings)
            fitting = [
                c
                for c in candidates
                if seen
                and c[2] > settings.noise_factor
                and abs(np.log(c[2] * seen / stated)) < settings.noise_near
            ]
            said = f"its noise is {seen:.2g} N, {stated:.2g} N was stated"
            otherwise = [f"{name}: has less noise than stated: {seen:.2g} N"]
        if not fitting:
            continue
        unit, what, factor = fitting[0]
        names = instrument.quantity("tension", robot.m).forms[0]
        amendment = Subject(name, "tension").amendment(
            "unit",
            what,
            units_key(names, unit),
            lambda excerpt: excerpt,
            SIMPLE,
            keys=[scale_key(float(factor))],
        )
        others = (*(f"{name}: {each[1]}" for each in fitting[1:3]), *otherwise)
        yield replace(
            _mistake(experiment, amendment, own[0].name, said),
            others=others,
            is_doubtful=bool(otherwise),
        )


def _beyond(experiment: Experiment, size: float, settings: SizeSettings) -> str:
    """Why tensions of a median size [N] are impossible on a robot; empty: they are possible."""
    robot = experiment.robot
    low, high = robot.tension_limits
    if low > settings.beyond * size:
        return (
            f"the median tension is {size:.3g} N, where the robot file asks for {low:g} N at least"
        )
    if np.isfinite(high) and size > settings.beyond * high:
        return f"the median tension is {size:.3g} N, where the robot file allows {high:g} N"
    if robot.gravity.any() and not 0 < low <= size:
        # Who says of how few newtons these cables are tight enough knows them. Else: every cable as
        # if it pulled upwards: no mass could be larger.
        most = size * robot.m / float(np.linalg.norm(robot.gravity))
        air = settings.air * robot.size**3
        if most < air:
            return (
                f"cables that pull {size:.3g} N carry at most {most:.2g} kg, less than the air that"
                f" a platform of this size displaces ({air:.2g} kg)"
            )
    return ""


def _noise(experiment: Experiment, name: str, settings: SizeSettings) -> tuple[float, float]:
    """1-sigma of the noise as stated and as seen [N]; (1, 0) where nothing is stated, or where what
    is seen is not white.
    """
    stated = experiment.instruments[name].quantity("tension", experiment.robot.m).noise
    if not stated:
        return 1.0, 0.0
    seen = []
    for run in experiment.runs[: settings.noise_runs]:
        if name in run.streams and not run.static:
            found = white_noise(run.streams[name], "tension", STREAMS)
            seen += [found] if found else []
    return (stated, float(np.median(seen))) if seen else (1.0, 0.0)
