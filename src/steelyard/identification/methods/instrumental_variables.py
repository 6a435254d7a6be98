"""Least squares with the regressor of independent kinematics in the products, so that noise in the
own one does not bias.

Instruments come from sensors whose errors have nothing to do with those of the regressor: the
command, where the platform follows it, or else the attitude and the tracker, where gyro and
accelerometer tell the own motion. The Durbin-Wu-Hausman test says whether least squares on the same
data is biased [Hausman1978]_.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.estimates.estimate import Estimate, no_estimate
from steelyard.estimates.quantiles import chi2_tail
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.known_body import plausible
from steelyard.identification.methods.from_posterior.finished import finished
from steelyard.identification.methods.loads import drawn
from steelyard.identification.methods.method import PosteriorMethod
from steelyard.identification.model.balance import Forces, parts_of, regressor_at
from steelyard.identification.model.force_residuals import WhitenedBalance, whitened_balance
from steelyard.identification.model.motion_residuals import motion_residuals
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.segment import Rows
from steelyard.identification.model.sources import Sources, choose_sources
from steelyard.identification.solve.beginning.motion_task import motion_task
from steelyard.identification.solve.beginning.readings import read
from steelyard.identification.solve.border.directions import inverse_of
from steelyard.identification.solve.border.normal_equations import Solution, solve
from steelyard.identification.solve.fit_state import FitState
from steelyard.identification.solve.joint_fit import fit
from steelyard.identification.solve.posterior import Posterior
from steelyard.inertia import TEN
from steelyard.instruments import Pose
from steelyard.instruments.pose import PoseNoise

_BIASED = 1e-3
"""Probability below which the two estimates differ by more than noise."""
_WEAK = 10.0
"""An estimate so many times less certain than least squares has weak instruments."""
_COMMAND = Pose(kind="pose", noise=PoseNoise(position=1e-4, rotation=1e-4))
"""A command as independent kinematics, with how closely they follow it [m], [rad]."""


@dataclass(frozen=True)
class InstrumentalVariables(PosteriorMethod):
    """Instrumental variables from independent kinematics."""

    name: ClassVar[str] = "instrumental-variables"

    def lack(self, experiment: Experiment) -> str:
        """Which run has no independent kinematics, in words; nothing where all have."""
        moving = [run for run in experiment.runs if not run.static]
        without = [run.name for run in moving if independent_sources(experiment, run) is None]
        if moving and not without:
            return ""
        where = f"run '{without[0]}'" if without else "poses at rest"
        return (
            f"{where}: expected independent kinematics (a command, or a tracker or pose beside the"
            " IMU), found none; use another method"
        )

    def of(self, posterior: Posterior) -> Estimate:
        """Estimate from a posterior of :attr:`fit`."""
        lack = self.lack(posterior.experiment)
        if lack:
            return no_estimate(self.name, lack)
        found, difference = self._compared(posterior)
        return self._said(found, difference)

    def drawn(self, posterior: Posterior) -> Estimate:
        """See :meth:`.PosteriorMethod.drawn`: all loads are solved for at once."""
        if not posterior.experiment.loads or self.lack(posterior.experiment):
            return super().drawn(posterior)
        found, difference = self._compared(posterior)
        return drawn(lambda each: self._said(each, difference), found)

    def _compared(self, posterior: Posterior) -> tuple[Posterior, Difference]:
        """The posterior with the solution by instrumental variables, and how that differs from
        least squares without correction on the same data.
        """
        products = _products(posterior)
        plain = solve(
            posterior.total,
            posterior.prior,
            posterior.solution.estimated,
            plausible(posterior.parameters, posterior.size),
            settings=self.settings,
            loads=posterior.further_loads,
        )
        found = replace(posterior, solution=solved(posterior, products), by_source={})
        return found, difference_of(found, products, plain)

    def _said(self, found: Posterior, difference: Difference) -> Estimate:
        """The estimate of the load that a posterior is seen from."""
        experiment = found.experiment
        seen = difference.of_body(found.joint_change[found.load_number])
        chi, freedom = durbin_wu_hausman(found, seen)
        probability = float(chi2_tail(chi, freedom))
        deviation = np.sqrt(np.diag(found.solution.covariance)[:TEN])
        ratio = deviation / np.sqrt(np.maximum(np.diag(seen.plain), 1e-300))
        further = []
        if ratio[found.identifiable].max(initial=0.0) > _WEAK:
            further.append(
                f"the instruments are weak: {ratio.max():.0f} times less certain than least"
                " squares; use another method"
            )
        most = (np.abs(seen.value) / deviation)[found.identifiable].max(initial=0.0)
        verb = "is" if probability < _BIASED else "is not"
        note = (
            f"plain least squares on the same data, without correction, {verb} biased beyond chance"
            f" (Durbin-Wu-Hausman chi-square {chi:.1f} on {freedom}, p = {probability:.2g}), by at"
            f" most {most:.2f} sigma"
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
            settings=self.verdict,
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


@dataclass(frozen=True, eq=False)
class Products:
    """Products of the instruments with the columns of the border, motion eliminated."""

    crossed: Array
    """Instruments (and the other columns) with the columns, shape (k, k)."""
    squared: Array
    """Instruments (and the other columns) with each other, shape (k, k)."""
    right: Array
    """Instruments (and the other columns) with the target, shape (k,)."""
    taken_off: Array
    """What noise of the motion does to these in the mean, with the opposite sign, shape (k,):
    nothing where there are instruments, what least squares takes off in the other columns."""


def _independent_motion(experiment: Experiment) -> dict[str, list[Segment]]:
    """Run -> the motion as the independent kinematics alone have it."""
    instruments = dict(experiment.instruments)
    runs = []
    for run in experiment.runs:
        sources = None if run.static else independent_sources(experiment, run)
        if sources is None:
            continue
        names = {sources.force, *(name for name, _ in sources.used())}
        for name in names:
            if instruments[name].commanded:
                instruments[name] = _COMMAND
        streams = {}
        for name in names:
            stream = run.streams[name]
            wanted = {quantity for source, quantity in sources.used() if source == name}
            kept = stream.values if name == sources.force else {q: stream.values[q] for q in wanted}
            streams[name] = replace(stream, values=kept)
        runs.append(replace(run, streams=streams))
    alone = replace(experiment, instruments=instruments, runs=tuple(runs))
    readings = read(alone, None, lambda what, fraction: None)
    task = motion_task(readings)
    # Errors of its calibration do no harm: it need only be like the motion, and independent.
    task = replace(task, active=np.zeros_like(task.active))
    state = fit(task, FitState(readings.segments, readings.calibration, None), beginning=True).state
    found: dict[str, list[Segment]] = {}
    for segment in state.segments:
        found.setdefault(segment.run, []).append(segment)
    return found


def _products(posterior: Posterior) -> Products:
    """Products of all runs."""
    state = posterior.fit.state
    parameters = state.calibration.calibration_parameters
    k = TEN + len(parameters)
    motions = posterior.fit.motions
    independent = _independent_motion(posterior.experiment)
    bodies = np.concatenate([np.arange(TEN), *(each.columns for each in posterior.further_loads)])
    size = k + len(bodies)
    normal, gradient = np.zeros((size, size)), np.zeros(size)
    for segment, forces, motion in zip(
        state.segments, posterior.force_samples, motions, strict=True
    ):
        rows = _rows(posterior, segment, forces, motion, independent.get(segment.run, ()))
        equations = segment.equations(size, rows)
        own, toward = segment.smooth(equations).reduced()
        normal, gradient = normal + own, gradient + toward
    assert state.parameters is not None
    at = np.concatenate([state.parameters, np.zeros(k - TEN)])
    order = np.arange(k)
    order[bodies] = np.arange(k, size)
    crossed = normal[np.ix_(order, np.arange(k))]
    plain, total = posterior.solution, posterior.total
    taken_off = plain.scores - (total.right - total.normal @ plain.value)
    taken_off[bodies] = 0.0
    return Products(
        crossed, normal[np.ix_(order, order)], gradient[order] + crossed @ at, taken_off
    )


def _rows(
    posterior: Posterior,
    segment: Segment,
    forces: Forces,
    motion: Array | None,
    independent: Sequence[Segment],
) -> list[Rows]:
    """Rows of a segment over the border, and behind it the instruments of the bodies: those of the
    first load, of which every other one is the sum with a difference, and of that difference.
    """
    state, experiment = posterior.fit.state, posterior.experiment
    assert state.parameters is not None
    k = TEN + len(state.calibration.calibration_parameters)
    column_of = np.arange(TEN, k, dtype=np.intp)
    shared = experiment, segment
    rows = list(motion_residuals(*shared, state.calibration, column_of, state.factors, None))
    for part in parts_of(*shared, forces, state.calibration):
        balance = whitened_balance(
            *shared,
            part,
            state.calibration,
            column_of,
            state.parameters,
            state.factors,
            None,
            motion,
        )
        instruments = _instruments(posterior, segment, balance, independent)
        number = posterior.number_of_load(segment.run)
        behind = [k + np.arange(TEN), k + TEN * number + np.arange(TEN)][: 2 if number else 1]
        for own, toward in zip(balance.rows, balance.by_origin(instruments), strict=True):
            columns = np.concatenate([_columns(own, k), *behind])
            by_errors = np.concatenate([own.by_errors, *(toward for _ in behind)], axis=2)
            rows.append(replace(own, by_errors=by_errors, columns=columns))
    return rows


def _columns(rows: Rows, k: int) -> NDArray[np.intp]:
    """Columns of the border that rows have."""
    return np.arange(k, dtype=np.intp) if rows.columns is None else rows.columns


def _instruments(
    posterior: Posterior,
    segment: Segment,
    balance: WhitenedBalance,
    independent: Sequence[Segment],
) -> Array:
    """Whitened regressor of the independent kinematics, zero where there are none, shape (n, 6,
    10); poses at rest have no noise to speak of in their own.
    """
    times, calibration = balance.at.time, posterior.fit.state.calibration
    regressor = np.zeros((len(times), 6, TEN))
    for each in [segment] if segment.static else independent:
        inside = each.holds(times)
        if inside.any():
            regressor[inside] = regressor_at(posterior.experiment, each, times[inside], calibration)
    return -(balance.at.whitener * balance.root[:, None, None]) @ regressor


def solved(posterior: Posterior, products: Products) -> Solution:
    """The estimate, with directions that are not identifiable held as in least squares."""
    plain, prior = posterior.solution, posterior.prior
    use = np.flatnonzero(plain.estimated)
    size = plausible(posterior.parameters, posterior.size)
    gain = np.zeros_like(plain.gain)
    matrix = (products.crossed + prior.precision + plain.held)[np.ix_(use, use)]
    gain[np.ix_(use, use)] = inverse_of(matrix, size)
    shift = gain @ products.taken_off
    value = gain @ (products.right + prior.pull + plain.held_pull) + shift
    noise_part = gain @ products.squared @ gain.T
    covariance = posterior.noise_factor * noise_part + gain @ prior.precision @ gain.T
    covariance += plain.wide @ plain.wide.T + np.outer(shift, shift)
    total = posterior.total
    return replace(
        plain,
        value=value,
        covariance=(covariance + covariance.T) / 2,
        gain=gain,
        noise_part=noise_part,
        bias=shift,
        scores=total.right - total.normal @ value,
    )


@dataclass(frozen=True, eq=False)
class Difference:
    """An estimate by instrumental variables less that by least squares without correction."""

    value: Array
    """Shape (k,)."""
    covariance: Array
    """Shape (k, k)."""
    plain: Array
    """Covariance of least squares, shape (k, k)."""

    def of_body(self, pick: Array) -> Difference:
        """The same of the ten linear parameters of a load.

        Args:
            pick: How they follow the border, shape (10, k).
        """
        return Difference(
            pick @ self.value, pick @ self.covariance @ pick.T, pick @ self.plain @ pick.T
        )


def difference_of(found: Posterior, products: Products, plain: Solution) -> Difference:
    """By how much both estimates differ; the covariance is that of two linear estimates from the
    same noise, so it cannot be indefinite.

    Args:
        found: With the estimate by instrumental variables.
        products: That it was solved from.
        plain: Least squares, without correction.
    """
    own = found.solution
    mixed = own.gain @ products.crossed @ plain.gain.T
    of_both = (
        own.gain @ products.squared @ own.gain.T + plain.gain @ found.total.normal @ plain.gain.T
    )
    change = own.gain - plain.gain
    covariance = found.noise_factor * (of_both - mixed - mixed.T)
    covariance = covariance + change @ found.prior.precision @ change.T
    return Difference(own.value - plain.value, covariance, plain.covariance)


def durbin_wu_hausman(found: Posterior, difference: Difference) -> tuple[float, int]:
    """Whether least squares on the same data gives another body than noise explains: chi-square and
    its degrees of freedom.

    Args:
        found: With the estimate by instrumental variables.
        difference: Of the ten.
    """
    part = np.flatnonzero(found.identifiable)
    scale = 1 / np.maximum(np.sqrt(np.abs(np.diag(found.solution.covariance)[part])), 1e-300)
    scaled = difference.covariance[np.ix_(part, part)] * np.outer(scale, scale)
    values, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
    # A difference that cannot be told from rounding is none.
    kept = values > 1e-8
    along = vectors[:, kept].T @ (difference.value[part] * scale)
    return float(np.sum(along**2 / values[kept])), max(1, int(kept.sum()))
