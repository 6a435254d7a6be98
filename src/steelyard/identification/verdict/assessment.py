"""Whether an estimate can be relied on: motion instruments against each other, residuals against
noise, runs against each other, and what the other modules of this room say.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.quantiles import chi2_below, chi2_tail
from steelyard.experiment.faults.of_streams import channels, clipped
from steelyard.experiment.model import Experiment
from steelyard.identification.model.sources import Source
from steelyard.identification.samples.motion_noise import stands_still
from steelyard.identification.samples.turned_winches import turned_winches
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.verdict.clock_changes import set_clocks
from steelyard.identification.verdict.diagnosis import diagnose
from steelyard.identification.verdict.directed_tests import Finding, directed_tests, of_description
from steelyard.identification.verdict.known_values import against_readings
from steelyard.identification.verdict.resonance import resonance
from steelyard.identification.verdict.seen_frequencies import of_frequencies
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings
from steelyard.identification.verdict.unmodelled import (
    of_contacts,
    of_disturbances,
    of_imitations,
    scatter_beside,
)
from steelyard.identification.verdict.vibrations import vibrations
from steelyard.inertia import TEN, body_jacobian
from steelyard.instruments.base import LATENCY


def reasons(
    posterior: Posterior,
    tests: Sequence[Finding] | None = None,
    settings: VerdictSettings = VERDICT,
    shaken: Container[Source] | None = None,
) -> list[str]:
    """Why not to rely on an estimate, in words and numbers; none for a sound recording.

    Args:
        posterior: What the estimate stands on.
        tests: Its :func:`directed_tests`, where they have been made already.
        settings: Levels.
        shaken: Of its :func:`vibrations`, where they have been looked for already.
    """
    tests = directed_tests(posterior, settings) if tests is None else tests
    shaken = vibrations(posterior, settings) if shaken is None else shaken
    contradictions = [
        *_of_motion(posterior, shaken, settings),
        *_of_forces(posterior, shaken, settings),
    ]
    moving = resonance(posterior, settings)
    weighed = posterior.calibration.calibration_parameters.weighed
    return [
        *contradictions,
        *of_disturbances(posterior, settings),
        *of_imitations(posterior),
        *of_contacts(posterior, settings),
        *_of_clipped(posterior, settings),
        *_of_latencies(posterior, settings),
        *([] if moving is None else [str(moving)]),
        *(diagnose(posterior, settings) if contradictions else ()),
        *_of_runs(posterior, settings),
        *(
            text
            for each in posterior.samples
            for text in turned_winches(posterior.experiment, each)
        ),
        *(str(each) for each in set_clocks(posterior, settings)),
        *of_description(tests, 1 if contradictions else settings.most_named, settings),
        *of_frequencies(posterior.experiment, posterior.parameters, posterior.size, settings),
        *against_readings(posterior, settings),
        *([] if weighed is None else weighed.reasons),
        *_of_nominal(posterior, settings),
        *_of_bias(posterior, settings),
    ]


def _of_motion(
    posterior: Posterior, shaken: Container[Source], settings: VerdictSettings
) -> Iterator[str]:
    """Motion instruments against each other and their stated noise."""
    for name in posterior.left_out:
        yield (
            f"with {name} the estimate does not settle: it contradicts the other instruments, and"
            " this estimate is without it; check its axes, signs, units and 'sync', or leave it"
            f" out yourself ('--without {name}')"
        )
    if not posterior.motion_converged:
        yield (
            "the motion instruments contradict each other beyond repair; check their axes, signs,"
            " units and 'sync'"
        )
    elif not posterior.fit.converged:
        worst = posterior.by_contradiction[:1]
        yield (
            f"the estimate did not settle in {posterior.fit.turns} steps: the description is far"
            " from what the data show; check axes, signs, units and 'sync'"
            + (
                f", first of all of {worst[0]}, which departs from the motion by"
                f" {posterior.departure(worst[0]):.1f} times its noise, or leave it out"
                f" ('--without {worst[0]}')"
                if worst
                else ""
            )
        )
    for (name, quantity), ratio in posterior.motion_ratios.items():
        own = [
            q
            for q in posterior.experiment.instruments[name].quantities(
                posterior.calibration.calibration_parameters.m
            )
            if q.name == quantity
        ]
        stated = any(q.noise for q in own)
        what = f"{quantity.replace('_', ' ')} of {name}"
        instrument = posterior.experiment.instruments[name]
        if instrument.stands_in(posterior.calibration.calibration_parameters.m):
            if ratio**2 > settings.twice:
                yield (
                    f"cables change their lengths by {ratio:.1f} times 'length_noise' though"
                    " winches are locked; leave the part in which winches turn or ropes slip out"
                    f" with 'window', or state a larger 'uncertainty: {{length_noise: …}}', or none"
                )
        elif stated and ratio**2 > settings.twice and (name, quantity) not in shaken:
            yield (
                f"{what} departs from the motion that all instruments show by {ratio:.1f} times its"
                " stated noise; check its axes, signs, units, 'sync' and 'noise'"
            )
        # What is stated of disturbances may be less than stated.
        elif stated and not any(q.disturbed for q in own) and ratio**2 < settings.much_less:
            if _always_still(posterior.experiment, name, quantity):
                continue
            yield (
                f"{what} scatters by only {ratio:.2g} of its stated noise; check its unit and"
                " 'noise'"
            )


def _of_latencies(posterior: Posterior, settings: VerdictSettings) -> Iterator[str]:
    """Instruments that are later than is stated of them: what else was stated may be wrong as
    well.
    """
    parameters = posterior.calibration.calibration_parameters
    for each in parameters.entries:
        if each.key != LATENCY or each.is_absent:
            continue
        stated = posterior.experiment.instruments[each.owner].calibration.delay
        if stated is not None:
            place = parameters.places[each.owner, LATENCY, None]
            (late,), (sigma,) = posterior.calibration.values[place], posterior.deviations[place]
            # Beside a filter that nothing tells from it, it is not sure.
            if late > settings.surely_late * sigma:
                yield (
                    f"{each.owner} reads {1e3 * late:.2g} ms later than the clock says that it"
                    " shares, though its 'delay' is stated; correct 'delay', or give it a 'clock'"
                    " of its own"
                )


def _always_still(experiment: Experiment, name: str, quantity: str) -> bool:
    """Whether nothing moves what an instrument reads, as encoders of locked winches: its noise does
    not show.
    """
    return all(
        stands_still(run.streams[name].values[quantity])
        for run in experiment.runs
        if not run.static and name in run.streams and quantity in run.streams[name].values
    )


def _is_disturbed(posterior: Posterior) -> bool:
    """Whether it is stated that force readings are disturbed: their noise may be less than that."""
    experiment = posterior.experiment
    forces = {experiment.force_instrument(run) for run in experiment.runs} - {None}
    return any(
        quantity.disturbed
        for name in forces
        if name is not None
        for quantity in experiment.instruments[name].quantities(experiment.robot.m)
    )


def _more_equations(posterior: Posterior, settings: VerdictSettings) -> str:
    """What to do for more of them: where nobody reads the cables, slack ones may have left none."""
    left_out = [each.touched for each in posterior.force_samples if each.guessed.all()]
    if left_out and np.concatenate(left_out).mean() > settings.mostly_left_out:
        return (
            "the notes say what is left out of the swings; push less, or hang the platform where"
            " all its cables pull"
        )
    return "record longer"


def _of_forces(
    posterior: Posterior, shaken: Container[Source], settings: VerdictSettings
) -> Iterator[str]:
    """Forces against the motion: size and drift of the residual, samples that stand out."""
    total, solution = posterior.total, posterior.solution
    freedom = max(1.0, 6 * total.freedom - solution.spent)
    # Few equations scatter widely without anything being wrong.
    large, small = (
        chance(solution.ratio * freedom, freedom) < settings.by_chance
        for chance in (chi2_tail, chi2_below)
    )
    if not posterior.stated and 6 * total.freedom < 2 * solution.spent:
        yield (
            f"too short: {6 * total.freedom:.0f} independent equations for {solution.spent:.0f}"
            f" unknowns; {_more_equations(posterior, settings)}"
        )
    # What is faster than the motion is noise, and counts as the noise that it is.
    hums = any((each.name, q) in shaken for each in posterior.force_samples for q in each.places)
    if posterior.stated and solution.ratio > settings.twice and large and not hums:
        yield (
            f"forces and motion do not balance: the residual is {np.sqrt(solution.ratio):.1f}"
            " times what the stated noise explains; check the order and the unit of the force"
            " sensors, the geometry of the robot, whether anything touched the platform, and"
            " 'noise' (where it is left out, it is estimated)"
        )
    elif (
        posterior.stated
        and solution.ratio < settings.much_less
        and small
        and not _is_disturbed(posterior)
        and solution.ratio + scatter_beside(posterior) < settings.much_less
    ):
        yield (
            "forces and motion balance better than the stated noise allows"
            f" ({np.sqrt(max(solution.ratio, 0.0)):.2g} of it); check the unit of the forces and"
            " 'noise'"
        )
    else:
        for name, factor in solution.inflation.items():
            if factor > settings.twice and not (hums and name == "noise"):
                yield _INFLATED[name].format(factor=factor)
    for run, weights in posterior.weights.items():
        outliers = float(np.mean(weights < 1))
        if outliers > settings.most_outliers:
            yield (
                f"run '{run}': {outliers:.0%} of the samples stand out ({_when(posterior, run)});"
                " check whether anything touched the platform"
            )


def _of_clipped(posterior: Posterior, settings: VerdictSettings) -> Iterator[str]:
    """Force sensors at the end of their range: what they did not read is no noise."""
    for run in posterior.experiment.runs:
        name = posterior.experiment.force_instrument(run)
        if name is None or run.name in posterior.held_out:
            continue
        for channel, _, component, values in channels(run.streams[name]):
            share = float(np.mean(clipped(values[:, 0]))) if component is not None else 0.0
            if share > settings.clipped:
                yield (
                    f"run '{run.name}': {channel} of {name} is at the end of its range in"
                    f" {share:.0%} of its samples; take a sensor with a larger range, or set its"
                    " amplifier"
                )


_INFLATED = {
    "noise": (
        "forces and motion do not balance: the residual has {factor:.1f} times the variance of the"
        " noise"
    ),
    "blocks": (
        "the residual drifts: stretches of the recording contradict each other by {factor:.1f}"
        " times the variance that noise explains; check whether anything touched the platform or a"
        " sensor changed"
    ),
    "runs": (
        "the runs contradict each other by {factor:.1f} times the variance that noise explains;"
        " check whether the load, a sensor or the robot changed between them"
    ),
}


def _when(posterior: Posterior, run: str) -> str:
    samples = next(s for s in posterior.samples if s.run == run)
    out = samples.time[posterior.weights[run] < 1]
    return f"between {out[0]:.2f} and {out[-1]:.2f} s"


def _of_runs(posterior: Posterior, settings: VerdictSettings) -> Iterator[str]:
    """Runs whose own estimates do not agree."""
    names = [run.name for run in posterior.experiment.runs]
    own = [
        name
        for name in posterior.equations
        if name not in posterior.held_out and posterior.carries(name)
    ]
    sums = [posterior.equations[name] for name in own]
    if len(sums) < 2 or posterior.solution.inflation:
        return
    # The scores of a run are what it would move the estimate by; they add up to what the priors
    # pull.
    scores = posterior.blocks.scores(posterior.solution.value)
    by_run = np.array(
        [scores[posterior.blocks.run == names.index(name)].sum(axis=0) for name in own]
    )
    use = np.flatnonzero(posterior.told)
    if not len(use):
        return
    chi, freedom = 0.0, 0.0
    # In units of what is known of all, so that a direction has the share that a run tells of it.
    root = _root_of(posterior.solution.covariance[np.ix_(use, use)])
    for own_scores, each in zip(by_run - by_run.mean(axis=0), sums, strict=True):
        # Noise of a motion gives its scores a mean where it tells hardly more than noise would:
        # unknown, since the motion follows the readings, up to what it takes of each parameter.
        taken = each.noise[np.ix_(use, use)] * posterior.parameters[use]
        variance = root.T @ (each.normal[np.ix_(use, use)] + taken @ taken.T) @ root
        share, direction = np.linalg.eigh(variance)
        tells = share > settings.tells
        along = (own_scores[use] @ root @ direction)[tells]
        chi += float(np.sum(along**2 / share[tells]))
        freedom += float(np.sum(tells)) * (len(sums) - 1) / len(sums)
    if not freedom:
        return
    if chi2_tail(chi / posterior.noise_factor, freedom) < settings.family / 10:
        yield (
            f"the runs contradict each other (chi-square {chi:.0f} on {freedom:.0f}); check"
            " whether the load or a sensor changed between them"
        )


def _root_of(covariance: Array) -> Array:
    """A matrix whose product with its transpose this is, also where it is singular."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    square, direction = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * direction * np.sqrt(np.maximum(square, 0.0)))


def _of_nominal(posterior: Posterior, settings: VerdictSettings) -> Iterator[str]:
    """The mass against the nominal one: a matter of units."""
    nominal = posterior.experiment.robot.platform
    if nominal is None or posterior.parameters[0] <= 0:
        return
    factor = posterior.parameters[0] / nominal.mass
    if not 1 / settings.factor_of_mass < factor < settings.factor_of_mass:
        yield (
            f"the mass is {factor:.3g} times the nominal one ({posterior.parameters[0]:.4g} and"
            f" {nominal.mass:.4g} kg); check the unit of the forces, or correct 'platform' in the"
            " robot file"
        )


def _of_bias(posterior: Posterior, settings: VerdictSettings) -> Iterator[str]:
    """A bias by noise in the regressor that is no longer small."""
    bias = body_jacobian(posterior.parameters) @ posterior.solution.bias[:TEN]
    told = posterior.identifiable
    rest = np.diag(posterior.body_covariance) - bias**2
    worst = float(
        np.max(
            np.abs(bias) / np.sqrt(np.maximum(rest, 1e-300)), where=told & (rest > 0), initial=0.0
        )
    )
    if worst > settings.biased:
        yield (
            f"noise in the motion biases least squares by {worst:.1f} sigma before correction; use"
            " better motion data or the method maximum-likelihood"
        )
