"""Size of the forces that were read: the scale of what else may pull, and of bodies."""

from __future__ import annotations

import numpy as np

from steelyard.experiment.model import Experiment


def usual_tensions(experiment: Experiment) -> float:
    """Sum of the median tensions of the first run that has any [N]; 1 where there are none."""
    for run in experiment.runs:
        force = experiment.force_instrument(run)
        values = None if force is None else run.streams[force].values.get("tension")
        if values is not None and np.any(np.abs(values) > 0):
            return float(np.nanmedian(np.abs(values))) * values.shape[1] or 1.0
    return 1.0


def usual_forces(experiment: Experiment) -> float:
    """What the largest load weighs at most, roughly [N]: tensions that pull aside are in it."""
    if experiment.robot.m:
        return usual_tensions(experiment)
    forces = [
        np.linalg.norm(run.streams[name].values["force"], axis=1)
        for run in experiment.runs
        if (name := experiment.force_instrument(run)) is not None
        and "force" in run.streams[name].values
    ]
    return float(np.nanmedian(np.concatenate(forces))) if forces else 1.0
