"""What maximum likelihood makes of the noise-free recordings of motions."""

from __future__ import annotations

from collections.abc import Mapping

from steelyard.errors import InputError
from steelyard.excitation.information.noise_free_recording import with_noise_free_runs
from steelyard.excitation.settings import DEFAULT, DesignSettings
from steelyard.experiment.model import Experiment
from steelyard.identification.solve.beginning import NoBalanceError
from steelyard.identification.solve.joint_motion import fit_jointly
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.motion.trajectory import Trajectory


def fit_noise_free(
    experiment: Experiment,
    trajectories: Mapping[str, Trajectory],
    level: float,
    progress: Progress = None,
    *,
    settings: DesignSettings = DEFAULT,
) -> Posterior:
    """The joint fit of maximum likelihood to noise-free recordings of motions.

    Raises:
        InputError: The instruments cannot identify anything, or lack a rate or a noise.
    """
    recorded = with_noise_free_runs(experiment, trajectories, level, settings)
    try:
        return fit_jointly(recorded, progress)
    except NoBalanceError as error:
        raise InputError(
            f"{experiment.source or experiment.name}: expected instruments and a motion that"
            f" identify something of the body, found that {error}"
        ) from None
