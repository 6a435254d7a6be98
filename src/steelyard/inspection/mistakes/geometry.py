"""Points of a robot file in millimetres: told by how large frame and platform are beside each other
and beside what the cables carry, and by the readings, which agree with one of both.

No size alone says so: a frame of 1500 m may be meant. A platform that is typed a thousand times too
large is a thousand million times too light for its size, and where it moves, its cables hardly
turn.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.inspection.agreements.excerpt import Excerpt, excerpts
from steelyard.inspection.agreements.judgement import judged
from steelyard.inspection.mistakes.settings import SizeSettings
from steelyard.robot.model import Robot

_MM = 1e-3
_POINTS = (("anchors", "attachments"), ("anchors",), ("attachments",))
"""What may be in millimetres, both first."""


@dataclass(frozen=True)
class Millimetres:
    """Points that are in millimetres."""

    which: str
    """``anchors``, ``attachments`` or both."""
    said: str
    """Why they are."""


def in_millimetres(experiment: Experiment, settings: SizeSettings) -> Millimetres | None:
    """Which points of the robot are in millimetres; None: none.

    Args:
        experiment: With its recordings.
        settings: How large robots are, and how dense.
    """
    robot = experiment.robot
    if not robot.m or not experiment.runs:
        return None
    carried = most_carried(experiment)
    evidence = list(_too_large(experiment, carried, settings))
    if not evidence:
        return None
    shown = _excerpts(experiment)
    written = _unlikeliness(robot, carried, settings)
    scores: dict[tuple[str, ...], tuple[float, float]] = {}
    for names in _POINTS:
        other = _divided(robot, names)
        then_shown = _excerpts(replace(experiment, robot=other))
        by_readings = _gain(shown, then_shown, settings)
        by_size = written - _unlikeliness(other, carried, settings)
        scores[names] = (by_readings / settings.decade + by_size, by_readings)
    best = max(scores, key=lambda names: scores[names][0])
    score, by_readings = scores[best]
    if score < settings.clear:
        return None
    if by_readings > settings.decade:
        evidence.append("readings agree better with a thousandth")
    return Millimetres(" and ".join(best), "; ".join(evidence))


def most_carried(experiment: Experiment) -> float | None:
    """What cables can carry at most [kg], each as if it pulled upwards; without readings of them
    what is known of the body; None: nothing.
    """
    robot = experiment.robot
    gravity = float(np.linalg.norm(robot.gravity))
    for name, instrument in experiment.instruments.items():
        own = [run.streams[name] for run in experiment.runs if name in run.streams]
        if instrument.measured_force != "tension" or instrument.stands_in(robot.m) or not own:
            continue
        readings = np.concatenate([np.abs(stream.values["tension"]).ravel() for stream in own])
        if gravity and np.isfinite(readings).any():
            return float(np.nanmedian(readings)) * robot.m / gravity or None
    known = experiment.known.get("mass")
    if known is not None:
        return float(known[0])
    return None if robot.platform is None else float(robot.platform.mass)


def _sizes(robot: Robot) -> tuple[float, float]:
    """Mean distance of anchors and of attachments from their middles [m]."""
    hall, platform = (
        max(float(np.linalg.norm(points - points.mean(axis=0), axis=1).mean()), 1e-12)
        for points in (robot.anchors, robot.attachments)
    )
    return hall, platform


def _too_large(
    experiment: Experiment, carried: float | None, settings: SizeSettings
) -> Iterator[str]:
    """What of the points is larger than usual, in words."""
    hall, platform = _sizes(experiment.robot)
    if hall > settings.largest_hall:
        yield f"anchors lie {hall:.4g} m about their middle"
    if platform > settings.largest_platform:
        yield f"attachments lie {platform:.4g} m about theirs"
    low, _ = experiment.robot.tension_limits
    air = settings.air * experiment.robot.size**3
    if carried is not None and carried < air and not low:
        yield f"at most {carried:.2g} kg are less than the air of that size ({air:.2g} kg)"


def _unlikeliness(robot: Robot, carried: float | None, settings: SizeSettings) -> float:
    """Decades by which sizes lie beyond what is usual, summed up."""
    hall, platform = _sizes(robot)
    beyond = [
        _beyond(hall, (settings.smallest_hall, settings.largest_hall)),
        _beyond(platform, (settings.smallest_platform, settings.largest_platform)),
        _beyond(hall / platform, settings.hall_to_platform),
    ]
    if carried is not None:
        density = carried / max(robot.size, 1e-12) ** 3
        beyond.append(_beyond(density, (settings.air, settings.densest)))
    return sum(beyond)


def _beyond(value: float, limits: tuple[float, float]) -> float:
    """Decades beyond the nearer of two limits; 0 between them."""
    low, high = limits
    return float(max(np.log10(low / value), np.log10(value / high), 0.0))


def _divided(robot: Robot, names: Sequence[str]) -> Robot:
    """With some points as millimetres."""
    anchors, attachments = (
        _MM * points if name in names else points
        for name, points in (("anchors", robot.anchors), ("attachments", robot.attachments))
    )
    return replace(robot, anchors=anchors, attachments=attachments)


def _excerpts(experiment: Experiment) -> Sequence[Excerpt]:
    """A run in motion and poses at rest, where the clocks are known."""
    if any(run.unsynchronised for run in experiment.runs):
        return ()
    alone = next((experiment.alone(load) for load in experiment.loads), experiment)
    with np.errstate(all="ignore"):
        try:
            return excerpts(alone, 1)
        except InputError:
            # What cannot be read is said by those who need it.
            return ()


def _gain(
    now_shown: Sequence[Excerpt], then_shown: Sequence[Excerpt], settings: SizeSettings
) -> float:
    """By how much better readings agree with another robot file, as costs of agreements.

    Args:
        now_shown: With the robot as it is described.
        then_shown: The same parts with the other one.
        settings: With the cost of what cannot be.
    """
    gain = 0.0
    with np.errstate(all="ignore"):
        for excerpt, changed in zip(now_shown, then_shown, strict=True):
            now, then = (
                {key: each.cost for key, each in judged(one).agreements.items() if each.robot}
                for one in (excerpt, changed)
            )
            for relation in {*now, *then}:
                # What is missing could not be: cables that end where they begin, for instance.
                gain += now.get(relation, settings.impossible)
                gain -= then.get(relation, settings.impossible)
    return gain
