"""Where a body comes to rest on cables of given lengths, and which of them are taut."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize, nnls

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.inertia import Inertia
from steelyard.natural_frequencies.hanging_body import HangingForces, Place, forces
from steelyard.robot.model import Robot

_SLACK = 1e-4
"""Part of the largest tension below which a cable is slack."""
_TIGHT = 1e-5
"""Length that a taut cable may lack after the search [m]; the steps that follow make it exact."""
_STEPS = 60
"""Newton steps, at most."""
_ARRIVED = 1e-10
"""Of forces over the weight, and of lengths [m]."""
_LARGEST_STEP = 0.1
"""Of the pose [m], [rad]: springs and pendulums are not linear further on."""
_REBASED = 4
"""Searches in turn, each with rotations about the place of the last one."""
_DEPTHS = (0.3, 0.6, 0.9)
"""Where the platform may hang below its anchors to begin with, in parts of the shortest cable."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A body at rest."""

    place: Place
    tension: Array
    """At the platform [N], 0 of slack cables, shape (m,)."""

    @property
    def taut(self) -> NDArray[np.intp]:
        """Numbers of the taut cables, from 0."""
        return np.asarray(np.flatnonzero(self.tension > 0))


def at_rest(
    robot: Robot, body: Inertia, lengths: Array, start: Place | None, *, elastic: bool
) -> Equilibrium:
    """Where a body comes to rest.

    Args:
        robot: Its cables; elastic ones stretch.
        body: That hangs on them.
        lengths: Unstrained, of all cables [m], shape (m,).
        start: Where to look first; None: below the anchors.
        elastic: Whether the cables stretch and sag; else they keep their length.

    Raises:
        InputError: There is no such place, or cables of given lengths leave the body no choice.
    """
    rigid = rigid_cables(robot)
    best: Equilibrium | None = None
    least = np.inf
    for each in [start] if start is not None else _below(robot, lengths):
        found = _lowest(rigid, body, lengths, each)
        if found is not None and elastic:
            found = _stretched(robot, body, lengths, found)
        if found is not None:
            found = settled(robot if elastic else rigid, body, lengths, found)
        if found is None:
            continue
        height = forces(rigid, body, found.place, found.tension, np.zeros(6)).potential
        if height < least:
            best, least = found, height
    if best is None:
        raise InputError(
            "expected lengths on which the platform comes to rest below its anchors, found none"
            f" for {', '.join(f'{v:.4g}' for v in lengths)} m; check the lengths or the pose"
        )
    return best


def rigid_cables(robot: Robot) -> Robot:
    """The same robot, whose cables neither stretch nor sag."""
    straight = robot.with_straight_cables()
    return replace(straight, cable=replace(straight.cable, axial_stiffness=None))


def settled(robot: Robot, body: Inertia, lengths: Array, found: Equilibrium) -> Equilibrium | None:
    """The exact place near one that is about right, on its taut cables; None: there is none.

    Newton's method on pose and tensions: the forces vanish, the taut cables have their lengths.
    """
    taut, place, tension = found.taut, found.place, found.tension.copy()
    weight = body.mass * float(np.linalg.norm(robot.gravity))
    if not len(taut):
        return None
    for _ in range(_STEPS):
        at = forces(robot, body, place, tension, np.zeros(6))
        lack = np.concatenate([at.force / weight, (at.length - lengths)[taut]])
        if np.abs(lack).max() < _ARRIVED:
            return Equilibrium(place, tension) if (tension[taut] > 0).all() else None
        matrix = np.block(
            [
                [at.by_pose / weight, at.by_tension[:, taut] / weight],
                [at.length_by_pose[taut], at.length_by_tension[np.ix_(taut, taut)]],
            ]
        )
        scale = np.concatenate([np.ones(6), np.full(len(taut), weight)])
        step, *_ = np.linalg.lstsq(matrix * scale, -lack, rcond=1e-13)
        step *= min(1.0, _LARGEST_STEP / max(float(np.abs(step[:6]).max()), 1e-300))
        place = place.moved(step[:6])
        pulled = tension[taut] + weight * step[6:]
        # A cable cannot push: half of what it had is as far as a step goes.
        tension[taut] = np.maximum(pulled, tension[taut] / 2)
    return None


def _lowest(rigid: Robot, body: Inertia, lengths: Array, start: Place) -> Equilibrium | None:
    """The lowest place near a start that cables of these lengths allow, and how hard they pull
    there, about; None: there is none.
    """
    place, ones = start, np.ones(rigid.m)
    weight = body.mass * float(np.linalg.norm(rigid.gravity))

    latest: list[tuple[Array, HangingForces]] = []

    def at(change: Array) -> HangingForces:
        # The search asks for potential, lengths and their derivatives of one change in turn.
        if not latest or not np.array_equal(latest[0][0], change):
            latest[:] = [(change.copy(), forces(rigid, body, place, ones, change))]
        return latest[0][1]

    change = np.zeros(6)
    for _ in range(_REBASED):
        found = minimize(
            lambda x: at(x).potential / weight,
            np.zeros(6),
            jac=lambda x: at(x).potential_by_pose / weight,
            method="SLSQP",
            bounds=[(-5.0, 5.0)] * 3 + [(-1.0, 1.0)] * 3,
            constraints={
                "type": "ineq",
                "fun": lambda x: lengths - at(x).length,
                "jac": lambda x: -at(x).length_by_pose,
            },
            options={"maxiter": 200, "ftol": 1e-11},
        )
        change = np.asarray(found.x)
        place = place.moved(change)
        latest.clear()
        if np.abs(change).max() < 1e-6:
            break
    now = at(np.zeros(6))
    tight = np.flatnonzero(now.length - lengths > -_TIGHT)
    if not len(tight) or (now.length - lengths > _TIGHT).any():
        return None
    # What the taut cables have to pull: none of them pushes.
    pulls = -now.length_by_pose[tight].T
    tension = np.zeros(rigid.m)
    tension[tight], lack = nnls(pulls, now.potential_by_pose)
    tension[tension < _SLACK * weight] = 0.0
    return Equilibrium(place, tension) if lack < 0.05 * weight else None


def _stretched(
    robot: Robot, body: Inertia, lengths: Array, found: Equilibrium
) -> Equilibrium | None:
    """The same on straight springs, by the least of the energy: more than six cables share what
    they carry by how they stretch.
    """
    rigid, ones = rigid_cables(robot), np.ones(robot.m)
    assert robot.cable.axial_stiffness is not None  # frequencies() has made sure
    stiffness = robot.cable.axial_stiffness / lengths
    weight = body.mass * float(np.linalg.norm(rigid.gravity))

    def energy(change: Array) -> tuple[float, Array]:
        at = forces(rigid, body, found.place, ones, change)
        stretch = np.maximum(at.length - lengths, 0.0)
        whole = at.potential + 0.5 * float(stiffness @ stretch**2)
        return whole / weight, (
            at.potential_by_pose + (stiffness * stretch) @ at.length_by_pose
        ) / weight

    change = np.asarray(minimize(energy, np.zeros(6), jac=True, method="BFGS").x)
    place = found.place.moved(change)
    stretch = forces(rigid, body, place, ones, np.zeros(6)).length - lengths
    tension = np.maximum(stiffness * stretch, 0.0)
    tension[tension < _SLACK * weight] = 0.0
    return Equilibrium(place, tension) if tension.any() else None


def _below(robot: Robot, lengths: Array) -> list[Place]:
    """Level places below the middle of the anchors."""
    middle = robot.anchors.mean(axis=0)
    return [Place(middle - part * float(lengths.min()) * robot.up, np.eye(3)) for part in _DEPTHS]
