"""Least squares with the regressor of independent kinematics in the products, so that noise in the
own one does not bias.

Instruments come from sensors whose errors have nothing to do with those of the regressor: the
command, where the platform follows it, or else the attitude instead of the gyro and the tracker
instead of the accelerometer. The Durbin-Wu-Hausman test says whether least squares on the same data
is biased [Hausman1978]_.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.stats import chi2

from steelyard.errors import InputError
from steelyard.estimates.estimate import Estimate, nothing_told
from steelyard.experiment.model import Experiment, Run
from steelyard.identification.methods.least_squares import finished
from steelyard.identification.model.calibration_parameters import Calibration
from steelyard.identification.model.preparation import Samples, prepare
from steelyard.identification.model.sources import Sources, choose_sources
from steelyard.identification.solve.classical import NoBalanceError, study
from steelyard.identification.solve.normal_equations import TEN, Solution, solve
from steelyard.identification.solve.study import Progress, Study, plausible

_BIASED = 1e-3
"""Probability below which the two estimates differ by more than noise."""
_WEAK = 10.0
"""An estimate so many times less certain than least squares has weak instruments."""


@dataclass(frozen=True)
class InstrumentalVariables:
    """Instrumental variables from independent kinematics."""

    name: ClassVar[str] = "instrumental-variables"

    def __call__(self, experiment: Experiment, progress: Progress = None) -> Estimate:
        """Estimate; nothing is told where no run has independent kinematics.

        Raises:
            InputError: A run lacks what the method needs.
        """
        without = [
            run.name
            for run in experiment.runs
            if not run.static and independent_sources(experiment, run) is None
        ]
        if without or all(run.static for run in experiment.runs):
            where = f"run '{without[0]}'" if without else "poses at rest"
            return nothing_told(
                self.name,
                f"{where}: expected independent kinematics (a command, or a tracker or pose beside"
                " the IMU), found none; use another method",
            )
        try:
            found = study(experiment, progress, instruments=_instruments)
        except NoBalanceError as error:
            return nothing_told(self.name, str(error))
        chi, freedom = durbin_wu_hausman(found)
        probability = float(chi2.sf(chi, freedom))
        plain = _least_squares(found)
        further = []
        ratio = np.sqrt(
            np.diag(found.solution.covariance)[:TEN]
            / np.maximum(np.diag(plain.covariance)[:TEN], 1e-300)
        )
        if ratio[found.told].max(initial=0.0) > _WEAK:
            further.append(
                f"the instruments are weak: {ratio.max():.0f} times less certain than least"
                " squares; use another method"
            )
        difference = np.abs(found.solution.value - plain.value)[:TEN] / np.sqrt(
            np.diag(found.solution.covariance)[:TEN]
        )
        verb = "is" if probability < _BIASED else "is not"
        note = (
            f"plain least squares on the same data, without correction, {verb} biased beyond chance"
            f" (Durbin-Wu-Hausman chi-square {chi:.1f} on {freedom}, p = {probability:.2g}), by at"
            f" most {difference[found.told].max(initial=0.0):.2f} sigma"
        )
        return finished(
            found,
            self.name,
            further=further,
            details={
                "durbin_wu_hausman": {"chi_square": chi, "freedom": freedom, "p": probability},
                "instruments": {
                    run.name: _named(experiment, run) for run in experiment.runs if not run.static
                },
            },
            notes=[note],
        )


def independent_sources(experiment: Experiment, run: Run) -> Sources | None:
    """Kinematics whose errors have nothing to do with those of the own regressor; None where there
    are none.
    """
    own = choose_sources(experiment, run, None)

    def first(quantity: str, *, commanded: bool) -> tuple[str, str] | None:
        return next(
            (
                (name, quantity)
                for name, instrument in experiment.instruments.items()
                if name in run.streams
                and instrument.commanded == commanded
                and quantity in run.streams[name].values
            ),
            None,
        )

    used = {name for name, _ in own.used()}
    position = first("position", commanded=True)
    rotation = first("orientation", commanded=True)
    if position and rotation and position[0] not in used:
        return Sources(own.force, rotation, rotation, None, position)
    position = first("position", commanded=False)
    rotation = first("orientation", commanded=False)
    if (
        position is None
        or rotation is None
        or own.specific_force is None
        or own.omega is None
        or own.omega == rotation
    ):
        return None
    return Sources(own.force, rotation, rotation, None, position)


def _named(experiment: Experiment, run: Run) -> dict[str, str]:
    sources = independent_sources(experiment, run)
    assert sources is not None
    assert sources.rotation is not None
    assert sources.position is not None
    return {"rotation": sources.rotation[0], "position": sources.position[0]}


def _instruments(
    experiment: Experiment, run: Run, samples: Samples, calibration: Calibration
) -> Samples | None:
    """The same instants as the independent kinematics have them; poses at rest have no noise to
    speak of in their regressor.
    """
    if run.static:
        return None
    sources = independent_sources(experiment, run)
    assert sources is not None
    try:
        other = prepare(
            experiment,
            run,
            straight=True,
            calibration=calibration,
            sources=sources,
            plan=samples.plan,
            thin=True,
        )
    except InputError:
        return None
    return other if len(other) == len(samples) else None


def _least_squares(found: Study) -> Solution:
    """Least squares on the same rows."""
    total = found.total
    plain = replace(total, crossed=total.normal, squared=total.normal, right=total.plain_right)
    return solve(
        plain,
        found.prior,
        found.solution.estimated,
        plausible(found.parameters, found.size),
        correct=False,
    )


def durbin_wu_hausman(found: Study) -> tuple[float, int]:
    """Whether least squares on the same rows gives another body than noise explains: chi-square and
    its degrees of freedom.

    The covariance of the difference is that of two linear estimates from the same noise, so it
    cannot be indefinite.
    """
    total, plain, own = found.total, _least_squares(found), found.solution
    difference = (own.value - plain.value)[:TEN]
    mixed = own.gain @ total.crossed @ plain.gain.T
    covariance = (
        own.gain @ total.squared @ own.gain.T
        - mixed
        - mixed.T
        + plain.gain @ total.normal @ plain.gain.T
    )
    change = own.gain - plain.gain
    covariance = found.noise_factor * covariance + change @ found.prior.precision @ change.T
    part = np.flatnonzero(found.told)
    scale = 1 / np.maximum(np.sqrt(np.abs(np.diag(own.covariance)[part])), 1e-300)
    scaled = covariance[np.ix_(part, part)] * np.outer(scale, scale)
    values, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
    # A difference that cannot be told from rounding is none.
    kept = values > 1e-8
    along = vectors[:, kept].T @ (difference[part] * scale)
    return float(np.sum(along**2 / values[kept])), max(1, int(kept.sum()))
