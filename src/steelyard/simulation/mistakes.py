"""Mistakes that people make in recordings and descriptions, made in a sound experiment: what a
verdict should reject.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.instruments import Instrument
from steelyard.robot.kinematics import cables_at
from steelyard.simulation.edits import (
    Edit,
    exchanged,
    instrument,
    late,
    quaternions,
    readings,
    robot,
    vector,
    with_values,
    without_sync,
    z_down,
)
from steelyard.units import FACTORS

LATE = 0.05
"""Of forces whose clock nobody has looked at [s]."""
ELSEWHERE = 0.31
"""How far from where it is said to be an instrument sits [m]."""
ATTACHMENT = 0.05
"""Error of one coordinate of one attachment [m]."""
CLIPPED = 0.8
"""Quantile of the forces of a cable beyond which its amplifier does not go."""
PUSH, PUSHED = 0.025, 2.0
"""Force of a hand as a part of the weight, and for how long it pushes [s]."""

Make = Callable[[Experiment, Mapping[str, str], np.random.Generator], Edit]
"""From an experiment, the instruments of what is needed, and a draw, to the mistake itself."""


@dataclass(frozen=True)
class MadeMistake:
    """One mistake that can be made."""

    name: str
    needs: tuple[str, ...]
    """Quantities that must be read, ``force`` standing for what forces are read by."""
    make: Make
    cables: int = 0
    """How many cables there must be."""

    def __call__(self, experiment: Experiment, rng: np.random.Generator) -> Experiment:
        """The experiment with this mistake; which cable or axis has it is drawn."""
        readers = _readers(experiment.instruments, experiment.robot.m)
        return self.make(experiment, readers, rng)(experiment)


def possible_mistakes(instruments: Mapping[str, Instrument], m: int) -> tuple[MadeMistake, ...]:
    """Those of :data:`MISTAKES` that can be made with some instruments, on a robot of m cables."""
    there = _readers(instruments, m)
    return tuple(
        each
        for each in MISTAKES.values()
        if m >= each.cables and all(need in there for need in each.needs)
    )


def _readers(instruments: Mapping[str, Instrument], m: int) -> dict[str, str]:
    """Quantity -> the first instrument that reads it; ``force`` -> the first that reads forces."""
    found: dict[str, str] = {}
    for name, each in instruments.items():
        if not each.is_measurement:
            continue
        if each.is_force:
            found.setdefault("force", name)
        for quantity in each.quantities(m):
            found.setdefault(quantity.name, name)
    return found


def _forces_in(unit: str) -> Make:
    """Everything that a force instrument reads, torques too, in another unit."""

    def make(e: Experiment, read: Mapping[str, str], rng: np.random.Generator) -> Edit:
        size = FACTORS["N"][unit]
        return lambda e: with_values(e, read["force"], lambda v: {q: v[q] / size for q in v})

    return make


def _in_unit(quantity: str, unit: str, si: str) -> Make:
    """All columns of a vector in another unit."""
    return lambda e, read, rng: vector(read[quantity], quantity, 1 / FACTORS[si][unit])


def _rotations(change: Callable[[Array], Array]) -> Make:
    return lambda e, read, rng: readings(read["orientation"], "orientation", change)


def _one_sign(quantity: str) -> Make:
    """One axis of a vector with the wrong sign."""

    def make(e: Experiment, read: Mapping[str, str], rng: np.random.Generator) -> Edit:
        signs = np.ones(3)
        signs[rng.integers(3)] = -1.0
        return vector(read[quantity], quantity, signs)

    return make


def _one_in_kgf(e: Experiment, read: Mapping[str, str], rng: np.random.Generator) -> Edit:
    """One force sensor that reads another unit."""
    size = np.ones(e.robot.m)
    size[rng.integers(e.robot.m)] = 1 / FACTORS["N"]["kgf"]
    return vector(read["tension"], "tension", size)


def _two_exchanged(e: Experiment, read: Mapping[str, str], rng: np.random.Generator) -> Edit:
    """Two force sensors whose plugs are exchanged."""
    i, k = rng.choice(e.robot.m, 2, replace=False)
    return exchanged(read["tension"], "tension", i, k)


def _clipped(e: Experiment, read: Mapping[str, str], rng: np.random.Generator) -> Edit:
    """Amplifiers that end below the largest forces."""
    return readings(
        read["tension"], "tension", lambda f: np.minimum(f, np.nanquantile(f, CLIPPED, axis=0))
    )


def _wrong_attachment(e: Experiment, read: Mapping[str, str], rng: np.random.Generator) -> Edit:
    """One coordinate of one attachment typed wrongly."""
    error = np.zeros_like(e.robot.attachments)
    error[rng.integers(e.robot.m), rng.integers(3)] = ATTACHMENT
    return robot(attachments=lambda r: r.attachments + error)


def _elsewhere(quantity: str) -> Make:
    """An instrument that is said to sit where it does not."""

    def make(e: Experiment, read: Mapping[str, str], rng: np.random.Generator) -> Edit:
        mounting = e.instruments[read[quantity]].mounting
        point = np.array(mounting.point if mounting.point is not None else np.zeros(3))
        point[rng.integers(3)] += ELSEWHERE
        return instrument(read[quantity], **{mounting.point_key: tuple(point.tolist())})

    return make


def _turned(e: Experiment, read: Mapping[str, str], rng: np.random.Generator) -> Edit:
    """An IMU screwed on a quarter turn off."""
    name = read["specific_force"]
    r, p, y = e.instruments[name].mounting.rpy_deg or (0.0, 0.0, 0.0)
    return instrument(name, rpy_deg=(r, p, y + 90.0))


def _hand(e: Experiment, read: Mapping[str, str], rng: np.random.Generator) -> Edit:
    """A hand that pushes sideways at the outside of the platform, in the middle of the recording.

    The cables bear it as they would at the pose halfway, upright.
    """
    r = e.robot
    assert r.platform is not None  # what is simulated has one
    size = PUSH * r.platform.mass * float(np.linalg.norm(r.gravity))
    reach = float(np.linalg.norm(r.attachments, axis=1).max())
    angle = rng.uniform(0, 2 * np.pi)
    wrench = size * np.array([np.cos(angle), np.sin(angle), 0.0, 0.0, 0.0, reach])

    def pushed(run: Run) -> Run:
        force, where = run.streams[read["tension"]], run.streams[read["position"]]
        middle = where.values["position"][len(where) // 2][None]
        tension = np.nanmean(force.values["tension"], axis=0)[None]
        W = cables_at(r, middle, np.eye(3)[None], tension).structure[0]
        halfway = 0.5 * (force.time[0] + force.time[-1])
        when = np.abs(force.time - halfway) < PUSHED / 2
        borne = np.outer(when, np.linalg.pinv(W) @ wrench)
        values = {**force.values, "tension": force.values["tension"] - borne}
        return replace(run, streams={**run.streams, read["tension"]: replace(force, values=values)})

    return lambda e: replace(e, runs=(pushed(e.runs[0]), *e.runs[1:]))


def _table() -> Iterator[MadeMistake]:
    """All of them: units, signs and orders, places, the robot file, clocks, what happens."""
    for unit in ("kN", "kgf", "daN", "lbf"):
        yield MadeMistake(f"forces in {unit}", ("force",), _forces_in(unit))
    for name, quantity, unit, si in (
        ("positions in mm", "position", "mm", "m"),
        ("gyro in deg/s", "angular_velocity", "deg/s", "rad/s"),
        ("accelerometer in g", "specific_force", "g", "m/s^2"),
    ):
        yield MadeMistake(name, (quantity,), _in_unit(quantity, unit, si))
    yield MadeMistake("one force sensor in kgf", ("tension",), _one_in_kgf, cables=2)
    yield MadeMistake("two cables exchanged", ("tension",), _two_exchanged, cables=2)
    yield MadeMistake(
        "one axis of the gyro reversed", ("angular_velocity",), _one_sign("angular_velocity")
    )
    yield MadeMistake(
        "one axis of the accelerometer reversed", ("specific_force",), _one_sign("specific_force")
    )
    yield MadeMistake(
        "orientation transposed", ("orientation",), _rotations(lambda R: R.transpose(0, 2, 1))
    )
    yield MadeMistake("orientation with z down", ("orientation",), _rotations(z_down))
    yield MadeMistake(
        "quaternion in the order xyzw", ("orientation",), _rotations(quaternions([1, 2, 3, 0]))
    )
    yield MadeMistake("IMU a quarter turn off", ("specific_force",), _turned)
    yield MadeMistake(
        f"IMU {100 * ELSEWHERE:.0f} cm elsewhere", ("specific_force",), _elsewhere("specific_force")
    )
    yield MadeMistake(
        f"target {100 * ELSEWHERE:.0f} cm elsewhere", ("position",), _elsewhere("position")
    )
    yield MadeMistake(
        "gravity upside down", (), lambda e, read, rng: robot(gravity=lambda r: -r.gravity)
    )
    yield MadeMistake(
        "robot file in mm",
        (),
        lambda e, read, rng: robot(
            anchors=lambda r: 1000 * r.anchors, attachments=lambda r: 1000 * r.attachments
        ),
        cables=1,
    )
    yield MadeMistake(
        f"an attachment wrong by {100 * ATTACHMENT:.0f} cm", (), _wrong_attachment, cables=1
    )
    yield MadeMistake("clocks not synchronised", (), lambda e, read, rng: without_sync)
    yield MadeMistake(
        f"forces late by {1000 * LATE:.0f} ms",
        ("force",),
        lambda e, read, rng: late(read["force"], LATE),
    )
    yield MadeMistake(f"forces clipped at their {CLIPPED:.0%} quantile", ("tension",), _clipped)
    yield MadeMistake("a hand on the platform", ("tension", "position"), _hand, cables=6)


MISTAKES: Mapping[str, MadeMistake] = {each.name: each for each in _table()}
"""By name, in the order in which they are shown."""
