"""What the linear methods share: from an experiment to normal equations over the body and every
systematic error.

The motion instruments are compared first (kinematics alone), then forces and motion are balanced
over samples that are filtered alike, with the body, the errors of the force instrument and what
kinematics left open as unknowns. Anchors and attachments are not estimated; their uncertainty is
passed on.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from steelyard.experiment.model import Experiment
from steelyard.identification.model.calibration_parameters import Calibration, gather
from steelyard.identification.model.preparation import prepare
from steelyard.identification.solve.iteration import balanced
from steelyard.identification.solve.kinematic_fit import fit_kinematics
from steelyard.identification.solve.long_recording import extended, lively_parts
from steelyard.identification.solve.study import Instruments, Progress, Study


class NoBalanceError(ArithmeticError):
    """Forces and motion have nothing to do with each other, so that there is no estimate to speak
    of.
    """


def study(
    experiment: Experiment,
    progress: Progress = None,
    instruments: Instruments | None = None,
    held_out: frozenset[str] = frozenset(),
) -> Study:
    """Balance an experiment.

    Args:
        experiment: With at least one run.
        progress: Is told what is being done and the fraction that is done.
        instruments: Gives the samples whose regressor stands in for the own one in the products
            (instrumental variables).
        held_out: Runs whose forces are not looked at; their motion is.

    Raises:
        InputError: A run lacks what the methods need.
        NoBalanceError: The numbers end in nothing.
    """
    try:
        # Numbers that end in nothing are looked at in the end, once.
        with np.errstate(all="ignore"):
            found = _study(
                experiment, progress or (lambda what, fraction: None), instruments, held_out
            )
            sound = bool(found.parameters[0]) and np.isfinite(found.body_covariance).all()
    except np.linalg.LinAlgError:
        sound = False
    if not sound:
        raise NoBalanceError(
            "forces and motion cannot be balanced at all; check the force columns, their units and"
            " signs, and the geometry of the robot"
        )
    return found


def _study(
    experiment: Experiment,
    tell: Callable[[str, float], None],
    instruments: Instruments | None,
    held_out: frozenset[str],
) -> Study:
    calibration_parameters = gather(experiment)
    known = Calibration(calibration_parameters, calibration_parameters.mean)
    runs = lively_parts(experiment)
    samples = []
    for i, run in enumerate(runs):
        tell(f"preparing {run.name}", 0.3 * i / len(runs))
        samples.append(prepare(experiment, run, thin=True, calibration=known))
    tell("comparing the motion instruments", 0.3)
    kinematics = fit_kinematics(
        experiment, calibration_parameters, [s for s in samples if not s.static]
    )
    tell("balancing forces and motion", 0.5)
    part = balanced(
        experiment, runs, samples, calibration_parameters, kinematics, instruments, held_out
    )
    if all(run is whole for run, whole in zip(runs, experiment.runs, strict=True)):
        return part
    tell("balancing the whole recording", 0.7)
    return extended(part, experiment, held_out)
