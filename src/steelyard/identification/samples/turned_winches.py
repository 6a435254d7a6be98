"""Whether winches that are said to be locked have turned: the cables of a run then have other
lengths at its end than at its beginning.

A slack cable is shorter than its length for a moment, so that the longest distances count.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steelyard.experiment.model import Experiment
from steelyard.identification.samples.prepared import Samples
from steelyard.robot.kinematics import cables_at
from steelyard.robot.model import Robot

_PARTS = 8
"""Of a run, each long enough for some swings."""
_TAUT = 0.9
"""Quantile of the distances in a part at which the cable is taut."""
_SEEN = 0.01
"""Change of a length that geometry and motion capture do not make [m]."""
_OF_GEOMETRY = 5.0
"""The same in the 1-sigma of anchors and attachments."""


def turned_winches(experiment: Experiment, samples: Samples) -> Iterator[str]:
    """A sentence on cables that change their lengths in a run of locked winches.

    Args:
        experiment: With the run.
        samples: Of it.
    """
    run = next(each for each in experiment.runs if each.name == samples.run)
    if not run.locked or samples.position is None or samples.rotation is None:
        return
    if len(samples) < _PARTS:
        return
    known = max(experiment.uncertainty.get(k, 0.0) for k in ("anchor", "attachment"))
    limit = max(_SEEN, _OF_GEOMETRY * known)
    robot: Robot = experiment.robot.with_straight_cables()
    weight = np.ones((len(samples), robot.m))
    length = cables_at(robot, samples.position, samples.rotation, weight).length
    taut = np.array([np.quantile(part, _TAUT, axis=0) for part in np.array_split(length, _PARTS)])
    change = np.ptp(taut, axis=0)
    turned = [str(i + 1) for i in np.flatnonzero(change > limit)]
    if turned:
        yield (
            f"run '{run.name}': {'cables' if len(turned) > 1 else 'cable'} {', '.join(turned)}"
            f" {'change their lengths' if len(turned) > 1 else 'changes its length'} by up to"
            f" {1e3 * change.max():.0f} mm, though the winches are said to be locked; leave the"
            " part in which they turned out with 'window', or remove 'winches: locked' and add the"
            " forces"
        )
