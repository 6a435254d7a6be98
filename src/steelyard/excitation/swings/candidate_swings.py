"""Swings that may be recorded: on which cables the platform hangs, where, and how it is pushed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.excitation.limits.rest_poses import workspace_grid
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.inertia import Inertia
from steelyard.motion.trajectory import Sampled
from steelyard.natural_frequencies.free_swing import free_swing
from steelyard.natural_frequencies.modes import NaturalModes, natural, sensitivity
from steelyard.robot.model import DIRECTIONS, Robot

_ALONG = ("along x", "along y", "along z", "about x", "about y", "about z")


@dataclass(frozen=True, eq=False)
class Swing:
    """A push at a place of rest, and the swing that follows."""

    modes: NaturalModes
    """Where the platform rests, and how it may swing."""
    pushed: int | None
    """Number of the mode that is pushed, from 0; None: all together."""
    amplitude: float
    """Largest displacement of the platform origin and of its attachments, about [m]."""
    trajectory: Sampled
    """Of the swing."""
    least_tension: float
    """Of the taut cables on the way [N]."""

    @property
    def pose(self) -> Array:
        """At rest: x, y, z [m], roll, pitch, yaw [rad], shape (6,)."""
        place = self.modes.rest.place
        rpy = Rotation.from_matrix(place.rotation).as_euler("ZYX")[::-1]
        return np.concatenate([place.position, rpy])

    @property
    def frequency(self) -> float | None:
        """Of the mode that is pushed [Hz]; None: all are."""
        return None if self.pushed is None else float(self.modes.frequencies[self.pushed])

    @property
    def push(self) -> str:
        """In words: along or about which axes of the world."""
        if self.pushed is None:
            return "in all directions at once"
        shape = self.modes.shapes[self.pushed].copy()
        shape[3:] *= self.modes.cables.size
        share = np.abs(shape) / np.abs(shape).max()
        main = [i for i in np.argsort(-share, kind="stable") if share[i] > 0.5][:2]
        return " and ".join(_ALONG[i] for i in main)


def cable_sets(robot: Robot, settings: DesignSettings = DEFAULT) -> Iterator[NDArray[np.intp]]:
    """Sets of cables on which a platform may hang and swing, large ones first; each an array of
    numbers from 0.
    """
    for size in range(min(robot.m, DIRECTIONS - 1), settings.fewest_swing_cables - 1, -1):
        for each in combinations(range(robot.m), size):
            yield np.array(each, dtype=np.intp)


def places_of_rest(
    robot: Robot, body: Inertia, settings: DesignSettings = DEFAULT
) -> list[NaturalModes]:
    """Where a body may hang on all cables of a robot, each taut, from lengths of level poses of the
    workspace.

    Args:
        robot: With fewer than six cables.
        body: That hangs on it.
        settings: Of the swings.
    """
    poses = workspace_grid(robot, settings)
    # The middle and the places farthest from it, where directions of the cables differ most.
    far = np.linalg.norm(poses[:, :3] - poses[0, :3], axis=1)
    order = np.concatenate([[0], np.argsort(-far, kind="stable")])
    found: list[NaturalModes] = []
    for pose in poses[order[: settings.swing_places_tried]]:
        modes = _hanging(robot, body, pose, settings)
        if modes is not None:
            found.append(modes)
        if len(found) == settings.swing_places:
            break
    return found


def swings_at(
    modes: NaturalModes,
    duration: float,
    settings: DesignSettings = DEFAULT,
    *,
    alone: bool = True,
) -> Iterator[Swing]:
    """All modes pushed together, and each alone, as far as all cables stay taut.

    Args:
        modes: A place of rest.
        duration: Of the swing [s].
        settings: Of the swings.
        alone: Whether each is pushed alone, too.
    """
    size = modes.cables.size
    amplitude = min(
        settings.swing_of_length * float(modes.lengths.min()), settings.swing_of_size * size
    )
    count = len(modes.frequencies)
    pushes: list[int | None] = [None, *range(count if alone and count > 1 else 0)]
    for pushed in pushes:
        for halving in range(settings.swing_halvings):
            swing = _swing(modes, pushed, amplitude / 2**halving, duration)
            if swing.least_tension > settings.swing_taut * modes.rest.tension.max():
                yield swing
                break


def frequency_value(modes: NaturalModes, settings: DesignSettings = DEFAULT) -> float:
    """What the natural frequencies at a place tell of first moment and inertia, a first guess by
    which sets of cables are compared: the logarithm of the volume by which they shrink what is
    plausible.

    Raises:
        InputError: A cable is at the edge of slack.
    """
    body, size = modes.body, modes.cables.size
    sizes = np.array([*[size] * 3, *[body.mass * size**2] * 6])
    follows = (
        sensitivity(modes)[:, 1:] * sizes / (settings.frequency_share * modes.frequencies[:, None])
    )
    return float(np.linalg.slogdet(np.eye(len(follows)) + follows @ follows.T)[1])


def _hanging(
    robot: Robot, body: Inertia, pose: Array, settings: DesignSettings
) -> NaturalModes | None:
    """On the lengths of a pose; None: not all cables are taut, or it hangs askew or elsewhere."""
    try:
        modes = natural(robot, body, pose=pose)
    except (InputError, np.linalg.LinAlgError):
        return None
    tension, place = modes.rest.tension, modes.rest.place
    upright = float(place.rotation[:, 2] @ robot.up)
    if tension.min() <= settings.swing_taut * tension.max() or upright < settings.swing_upright:
        return None
    box = robot.limits.position
    if box is not None and not ((place.position > box[0]) & (place.position < box[1])).all():
        return None
    return modes


def _swing(modes: NaturalModes, pushed: int | None, amplitude: float, duration: float) -> Swing:
    """Pushed so that each mode goes about so far."""
    own = range(len(modes.frequencies)) if pushed is None else [pushed]
    rate = np.zeros(DIRECTIONS)
    for i in own:
        rate += 2 * np.pi * modes.frequencies[i] * amplitude / np.sqrt(len(own)) * modes.shapes[i]
    found = free_swing(modes, rate, duration)
    return Swing(modes, pushed, amplitude, found.trajectory, float(found.tension.min()))
