"""Whether an estimate can be relied on: residuals against noise, runs against each other, and one
test for each part of the description.

Residuals as a whole do not see wrong geometry, since offsets absorb it. So the residual is also
asked for every single number of the description (where a cable is fixed, a gain, a delay, an axis)
whether a different value would explain it better than noise does: a score test [Rao1948]_,
two-sided, corrected for the number of tests [Dunn1961]_. Only what also moves the estimate counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from steelyard.arrays import Array
from steelyard.experiment.faults import channels, clipped
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance import UNMODELLED_PARTS
from steelyard.identification.model.calibration_parameters import DRAG, ROBOT
from steelyard.identification.solve.posterior import Posterior, plausible
from steelyard.identification.verdict.diagnosis import diagnose
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings
from steelyard.identification.verdict.swinging import swinging
from steelyard.identification.verdict.winches import turned_winches
from steelyard.inertia import TEN, Inertia, body_jacobian
from steelyard.instruments.base import TIME_CONSTANT
from steelyard.natural_frequencies.information import frequency_information

_INSTANTS = 500
"""Along a segment, at which disturbances are looked at."""


@dataclass(frozen=True)
class Finding:
    """What one directed test says."""

    name: str
    z: float
    """Standard normal where the description is right."""
    size: float
    """The error that would explain the residual."""
    sigma: float
    """Its 1-sigma."""
    unit: str
    shift: float
    """How far the estimate moves with it, in its 1-sigma."""
    proposal: str
    negligible: bool = False
    """Whether it would be smaller than that of any device."""

    def __str__(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        return (
            f"{self.name} seems to be off by {self.size:+.3g} ± {self.sigma:.2g}{unit} (z ="
            f" {self.z:.1f}, it moves the estimate by {self.shift:.1f} sigma): {self.proposal}"
        )


def directed_tests(
    posterior: Posterior, settings: VerdictSettings = VERDICT
) -> tuple[Finding, ...]:
    """A score test for every number of the description that acts on the balance, largest first."""
    found = [*_of_fixed(posterior, settings), *_of_priors(posterior, settings)]
    return tuple(sorted(found, key=lambda each: -abs(each.z)))


def _of_fixed(posterior: Posterior, settings: VerdictSettings) -> Iterator[Finding]:
    """Numbers of the description that were taken as exact."""
    solution, calibration_parameters = (
        posterior.solution,
        posterior.calibration.calibration_parameters,
    )
    total = posterior.total
    tested = np.flatnonzero(~solution.estimated & (np.diag(total.normal) > 0))
    tested = tested[tested >= TEN]
    if not len(tested):
        return
    use = np.flatnonzero(solution.estimated)
    follow = total.normal[np.ix_(tested, use)] @ solution.gain[np.ix_(use, use)]
    information = total.normal[np.ix_(tested, tested)] - follow @ total.normal[np.ix_(use, tested)]
    score = solution.scores[tested]
    # What the priors of the estimated pull is no evidence against those that are not.
    pulled = (
        solution.scores[use]
        - (posterior.prior.precision @ solution.value - posterior.prior.pull)[use]
    )
    score = score - follow @ pulled
    diagonal, own = np.diag(information), np.diag(total.normal)[tested]
    noise = posterior.noise_factor * diagonal
    noise = np.maximum(
        noise,
        _by_blocks(
            posterior,
            tested,
            use,
            follow,
            np.where(diagonal > settings.its_own * own, score / np.maximum(diagonal, 1e-300), 0.0),
            settings,
        ),
    )
    z = score / np.sqrt(np.maximum(noise, 1e-300))
    components = {TEN + place: unknown for place, unknown, _ in calibration_parameters.components()}
    moves = -solution.gain[:TEN][:, use] @ total.normal[np.ix_(use, tested)]
    for i, column in enumerate(tested):
        if diagonal[i] < settings.its_own * own[i]:
            continue
        unknown, size = components[int(column)], score[i] / diagonal[i]
        yield Finding(
            name=calibration_parameters.names[column - TEN],
            z=float(z[i]),
            size=float(size),
            sigma=float(np.sqrt(noise[i]) / diagonal[i]),
            unit=unknown.unit,
            shift=_shift(posterior, moves[:, i] * size),
            proposal=_proposal(unknown.owner, unknown.key),
            negligible=bool(abs(size) < unknown.negligible),
        )


def _by_blocks(
    posterior: Posterior,
    tested: NDArray[np.intp],
    use: NDArray[np.intp],
    follow: Array,
    size: Array,
    settings: VerdictSettings,
) -> Array:
    """Variance of the scores as stretches of the recording show it, shape (t,).

    An error of the description is there throughout; a misfit of the model comes and goes, and must
    not be taken for one.
    """
    blocks = posterior.blocks
    if len(blocks.right) < settings.fewest_blocks:
        return np.zeros(len(tested))
    scores = blocks.scores(posterior.solution.value)
    scores = scores[:, tested] - scores[:, use] @ follow.T
    # What an error of the size found would have put into each of them.
    own = np.einsum("btt->bt", blocks.normal[:, tested[:, None], tested])
    shared = np.einsum("tu,but->bt", follow, blocks.normal[:, use[:, None], tested])
    estimated = np.einsum(
        "tu,buv,tv->bt", follow, blocks.normal[:, use[:, None], use], follow, optimize=True
    )
    explained = own - 2 * shared + estimated
    rest = scores - explained * size
    rest = rest - rest.mean(axis=0)
    count = len(rest)
    return np.asarray(np.sum(rest**2, axis=0) * count / (count - 1))


def _of_priors(posterior: Posterior, settings: VerdictSettings) -> Iterator[Finding]:
    """Calibration parameters that were estimated: whether they came out where their prior has them."""
    calibration_parameters, values = (
        posterior.calibration.calibration_parameters,
        posterior.calibration.values,
    )
    variance = np.diag(posterior.solution.covariance)[TEN:]
    moves = posterior.solution.covariance[:TEN, TEN:]
    for place, unknown, component in calibration_parameters.components():
        prior = unknown.deviation[component] ** 2
        if (
            not posterior.solution.estimated[TEN + place]
            or variance[place] > settings.informed * prior
        ):
            continue
        size = values[place] - unknown.mean[component]
        yield Finding(
            name=calibration_parameters.names[place],
            z=float(size / np.sqrt(prior - variance[place])),
            size=float(size),
            sigma=float(np.sqrt(variance[place])),
            unit=unknown.unit,
            # Held at its prior, the estimate would move by so much.
            shift=_shift(posterior, moves[:, place] / variance[place] * size),
            proposal=_proposal(unknown.owner, unknown.key),
        )


def _shift(posterior: Posterior, change: Array) -> float:
    """Length of a change of the ten linear parameters in the 1-sigma of what is told."""
    told = posterior.identifiable
    if not told.any():
        return 0.0
    moved = (body_jacobian(posterior.parameters) @ change)[told]
    covariance = posterior.body_covariance[np.ix_(told, told)]
    scale = 1 / np.sqrt(np.diag(covariance))
    inverse = np.linalg.pinv(covariance * np.outer(scale, scale), hermitian=True)
    return float(np.sqrt(np.abs((moved * scale) @ inverse @ (moved * scale))))


def _proposal(owner: str, key: str) -> str:
    """What to do about a number of the description that seems to be off."""
    if owner == ROBOT:
        head = key.partition(".")[0]
        return {
            "attached": "look for a hose or a cable that pulls at the platform, or hold it differently",
            "hose": "check this number of the hose under 'attached', or state a larger 'sigma' there",
            "damping": (
                "swings decay faster than is plausible; look for what rubs at cables or rollers"
            ),
            "drag": "the air seems to slow the platform; move it more slowly, or make it smaller",
            "anchor": "measure this anchor again, or state a larger 'uncertainty: {anchor: …}'",
            "attachment": (
                "measure this attachment again, or state a larger 'uncertainty: {attachment: …}'"
            ),
            "gravity": "check the sign, size and direction of 'gravity' in the robot file",
            DRAG: "check 'linear_density' of the cables in the robot file",
        }[head]
    where = f"'instruments: {{{owner}: {{calibration: {{{key}: …}}}}}}'"
    return {
        "gain": f"check this sensor's gain and unit, or state a larger {where}",
        "common_gain": (
            f"check the unit and the calibration of the force sensors, or state a larger {where}"
        ),
        "friction": f"check this roller, its bearing and its swivel, or state a larger {where}",
        "offset": f"check the zero of this sensor, or state a larger {where}",
        TIME_CONSTANT: (
            f"check 'sync' and 'clock' of {owner} against those of the motion instruments, or state"
            f" the time constant of its amplifier's filter under {where}"
        ),
        "delay": (
            "check 'sync' and 'clock', or state a larger 'delay' of the instruments of this clock"
        ),
        "misalignment": (
            f"check the axes, signs and 'rpy_deg' of {owner}, or state a larger {where}"
        ),
    }.get(key, f"check how {owner} is described and mounted, or state a larger {where}")


def reasons(
    posterior: Posterior,
    tests: Sequence[Finding] | None = None,
    settings: VerdictSettings = VERDICT,
) -> list[str]:
    """Why not to rely on an estimate, in words and numbers; none for a sound recording.

    Args:
        posterior: What the estimate stands on.
        tests: Its :func:`directed_tests`, where they have been made already.
        settings: Levels.
    """
    tests = directed_tests(posterior, settings) if tests is None else tests
    contradictions = [*_of_motion(posterior, settings), *_of_forces(posterior, settings)]
    load = swinging(posterior)
    return [
        *contradictions,
        *_of_disturbances(posterior, settings),
        *_of_clipped(posterior, settings),
        *([] if load is None else [str(load)]),
        *(diagnose(posterior, settings) if contradictions else ()),
        *_of_runs(posterior, settings),
        *(
            text
            for each in posterior.samples
            for text in turned_winches(posterior.experiment, each)
        ),
        *_of_description(tests, 1 if contradictions else settings.most_named, settings),
        *_of_contacts(posterior, settings),
        *of_frequencies(posterior.experiment, posterior.parameters, posterior.size, settings),
        *_of_nominal(posterior, settings),
        *_of_bias(posterior, settings),
    ]


def _of_motion(posterior: Posterior, settings: VerdictSettings) -> Iterator[str]:
    """Motion instruments against each other and their stated noise."""
    for name in posterior.left_out:
        yield (
            f"with {name} the estimate does not settle: it contradicts the other instruments, and"
            f" this estimate is without it; check its axes, signs, units and 'sync', or leave it out"
            f" yourself ('--without {name}')"
        )
    if not posterior.motion_converged:
        yield (
            "the motion instruments contradict each other beyond repair; check their axes, signs,"
            " units and 'sync'"
        )
    elif not posterior.fit.converged:
        worst = posterior.by_contradiction[:1]
        yield (
            f"the estimate did not settle in {posterior.fit.turns} steps: the description is far from"
            " what the data show; check axes, signs, units and 'sync'"
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
        if stated and ratio**2 > settings.twice:
            yield (
                f"{what} departs from the motion that all instruments show by {ratio:.1f} times its"
                " stated noise; check its axes, signs, units, 'sync' and 'noise'"
            )
        # What is stated of disturbances may be less than stated.
        elif stated and not any(q.disturbed for q in own) and ratio**2 < settings.much_less:
            yield (
                f"{what} scatters by only {ratio:.2g} of its stated noise; check its unit and"
                " 'noise'"
            )


def _of_disturbances(posterior: Posterior, settings: VerdictSettings) -> Iterator[str]:
    """Disturbances that nobody has stated and that are larger than devices and surroundings make."""
    robot = posterior.experiment.robot
    weight = abs(float(posterior.parameters[0])) * float(np.linalg.norm(robot.gravity))
    for segment in posterior.fit.state.segments:
        local = segment.basis(np.linspace(*segment.span, _INSTANTS))
        for process in () if segment.static else segment.processes:
            if process.is_stated:
                continue
            rms = np.sqrt(np.mean(segment.disturbance(process, local) ** 2, axis=0))
            owner, name = process.disturbs
            part = UNMODELLED_PARTS.get(process.source)
            if part is None:
                quantity = posterior.experiment.instruments[owner].quantity(name, robot.m)
                largest = settings.largest_disturbance.get(quantity.unit, np.inf)
                if rms.max() > largest:
                    yield (
                        f"run '{segment.run}': {name.replace('_', ' ')} of {owner} departs for a"
                        f" while from what all others show, by {rms.max():.2g} {quantity.unit} rms,"
                        " which is more than devices drift; check its axes, signs, units and 'sync',"
                        " or state it under 'noise'"
                    )
                continue
            arm, unit = (1.0, "N") if part.start == 0 else (robot.size, "N m")
            if rms.max() > settings.largest_wrench * weight * arm:
                yield (
                    f"run '{segment.run}': an {name} that nothing explains is as large as"
                    f" {rms.max():.2g} {unit} rms, a large part of the weight; check the geometry of"
                    " the robot, the order and the signs of its forces, and what touches the"
                    " platform, or state it under 'uncertainty: {unmodelled: …}'"
                )
            turning = _turning(posterior, segment.run)
            if part.start == 3 and np.linalg.norm(rms) > settings.largest_torque * turning:
                # It is taken as independent of the motion. What is not is in the moments of
                # inertia, the more, the larger it is beside what they withstand.
                yield (
                    f"run '{segment.run}': an {name} that nothing explains is as large as"
                    f" {np.linalg.norm(rms) / max(turning, 1e-300):.0%} of the torque that turns the"
                    " platform, so that the inertia may be off by more than its 1-sigma; turn the"
                    " platform faster, remove what pulls at it, or state it under 'uncertainty:"
                    " {unmodelled: …}'"
                )


def _of_contacts(posterior: Posterior, settings: VerdictSettings) -> Iterator[str]:
    """What was left out as a contact and comes again with the motion: that is no hand."""
    for run, stretches in posterior.contacts.items():
        begun = np.sort([start for start, _ in stretches])
        apart = np.diff(begun)
        if len(apart) < 2 or np.ptp(apart) > settings.recurring * float(np.mean(apart)):
            continue
        yield (
            f"run '{run}': what pulls or pushes beside the body comes again every"
            f" {np.mean(apart):.2f} s ({len(begun)} times), so that it is no contact but follows the"
            " motion; look for a cable or a hose that rubs or catches, a guide, or friction that is"
            " larger than stated"
        )


def _turning(posterior: Posterior, run: str) -> float:
    """Root mean square of the torque that turns the body about its centre of gravity in a run
    [N m].
    """
    body = Inertia.from_parameters(posterior.parameters).inertia
    found = [
        each.alpha @ body + np.cross(each.omega, each.omega @ body)
        for each in posterior.samples
        if each.run == run and len(each)
    ]
    return float(np.sqrt(np.mean(np.sum(np.concatenate(found) ** 2, axis=1)))) if found else 0.0


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


def _of_forces(posterior: Posterior, settings: VerdictSettings) -> Iterator[str]:
    """Forces against the motion: size and drift of the residual, samples that stand out."""
    total, solution = posterior.total, posterior.solution
    freedom = max(1.0, 6 * total.freedom - solution.spent)
    # Few equations scatter widely without anything being wrong.
    large, small = (
        chance(solution.ratio * freedom, freedom) < settings.by_chance
        for chance in (chi2.sf, chi2.cdf)
    )
    if not posterior.stated and 6 * total.freedom < 2 * solution.spent:
        yield (
            f"too short: {6 * total.freedom:.0f} independent equations for {solution.spent:.0f}"
            " unknowns; record longer"
        )
    if posterior.stated and solution.ratio > settings.twice and large:
        yield (
            f"forces and motion do not balance: the residual is {np.sqrt(solution.ratio):.1f} times"
            " what the stated noise explains; check the order and the unit of the force sensors,"
            " the geometry of the robot, and whether anything touched the platform"
        )
    elif (
        posterior.stated
        and solution.ratio < settings.much_less
        and small
        and not _is_disturbed(posterior)
    ):
        yield (
            "forces and motion balance better than the stated noise allows"
            f" ({np.sqrt(max(solution.ratio, 0.0)):.2g} of it); check the unit of the forces and"
            " 'noise'"
        )
    else:
        for name, factor in solution.inflation.items():
            if factor > settings.twice:
                yield _INFLATED[name].format(factor=factor)
    for run, weights in posterior.weights.items():
        outliers = float(np.mean(weights < 1))
        if outliers > settings.most_outliers:
            yield (
                f"run '{run}': {outliers:.0%} of the samples stand out ({_when(posterior, run)}); check"
                " whether anything touched the platform"
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
    sums = [each for name, each in posterior.equations.items() if name not in posterior.held_out]
    if len(sums) < 2 or posterior.solution.inflation:
        return
    # The scores of a run are what it would move the estimate by; they add up to what the priors
    # pull.
    by_run = np.array(
        [
            posterior.blocks.scores(posterior.solution.value)[posterior.blocks.run == i].sum(axis=0)
            for i in np.unique(posterior.blocks.run)
        ]
    )
    use = np.flatnonzero(posterior.told)
    if not len(use):
        return
    chi = 0.0
    size = plausible(posterior.parameters, posterior.size)[use]
    for scores, each in zip(by_run - by_run.mean(axis=0), sums, strict=True):
        # Noise of a motion gives its scores a mean where it tells hardly more than noise would:
        # unknown, since the motion follows the readings, up to what it takes of each parameter.
        taken = each.noise[np.ix_(use, use)] * posterior.parameters[use]
        variance = each.normal[np.ix_(use, use)] + taken @ taken.T
        scaled = scores[use] * size
        inverse = np.linalg.pinv(variance * np.outer(size, size), rcond=1e-10, hermitian=True)
        chi += float(scaled @ inverse @ scaled)
    freedom = (len(sums) - 1) * len(use)
    if chi2.sf(chi / posterior.noise_factor, freedom) < settings.family / 10:
        yield (
            f"the runs contradict each other (chi-square {chi:.0f} on {freedom}); check whether the"
            " load or a sensor changed between them"
        )


def of_frequencies(
    experiment: Experiment, parameters: Array, size: float, settings: VerdictSettings
) -> Iterator[str]:
    """Natural frequencies that somebody has seen and a body does not have.

    Args:
        experiment: With what was seen.
        parameters: The ten linear ones of the body, shape (10,).
        size: Plausible radius of the body [m].
        settings: Levels of the verdict.
    """
    if not experiment.frequencies:
        return
    seen = frequency_information(experiment, parameters, plausible(parameters, size))
    if seen is None:
        yield (
            "the body that the recordings tell cannot hang as the natural frequencies say; check"
            " their poses or lengths"
        )
        return
    z = seen.residual(parameters) / np.sqrt(np.diag(seen.covariance))
    residual = seen.residual(parameters)
    chi = float(residual @ np.linalg.solve(seen.covariance, residual))
    if chi2.sf(chi, len(z)) < settings.family / 10:
        of_each = [each for each in experiment.frequencies for _ in each.frequency]
        worst = int(np.argmax(np.abs(z)))
        own = of_each[worst]
        yield (
            f"the natural frequencies do not fit (chi-square {chi:.0f} on {len(z)}), most in run"
            f" '{own.run}', row {own.row}: seen {seen.seen[worst]:.4g} Hz, predicted"
            f" {seen.seen[worst] - residual[worst]:.4g} Hz; check its pose or lengths, or whether"
            " the load was another"
        )


def _of_description(
    tests: Sequence[Finding], most: int, settings: VerdictSettings
) -> Iterator[str]:
    """Numbers of the description that the residual points at."""
    limit = float(norm.isf(settings.family / max(1, len(tests)) / 2))
    found = [
        test
        for test in tests
        if abs(test.z) > limit and test.shift > settings.matters and not test.negligible
    ]
    for test in found[:most]:
        yield str(test)
    if len(found) > most:
        yield (
            f"{len(found) - most} more numbers of the description seem to be off; what is named"
            " first may explain them"
        )


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
            " better motion data or the method instrumental-variables"
        )


def priors_share(posterior: Posterior) -> Array:
    """Part of the variance of each of the ten body parameters that came from priors and not from
    the data, shape (10,).
    """
    J = body_jacobian(posterior.parameters)
    whole = np.diag(posterior.body_covariance)
    noise = np.diag(J @ posterior.solution.noise_part[:TEN, :TEN] @ J.T) * posterior.noise_factor
    return np.asarray(np.clip(1 - noise / np.maximum(whole, 1e-300), 0.0, 1.0))


def label_mask(posterior: Posterior) -> NDArray[np.bool_]:
    """Which of the ten body parameters were told by what was known about the body rather than by
    the data, shape (10,).
    """
    if not posterior.experiment.known:
        return np.zeros(TEN, dtype=bool)
    size = plausible(posterior.parameters, posterior.size)
    seen = frequency_information(posterior.experiment, posterior.parameters, size)
    J = body_jacobian(posterior.parameters)
    use = np.flatnonzero(posterior.solution.estimated)
    precision = posterior.prior.precision.copy()
    # Frequencies are data.
    precision[:TEN, :TEN] = 0.0 if seen is None else seen.about()[0]
    matrix = posterior.total.normal[np.ix_(use, use)] + precision[np.ix_(use, use)]
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    alone = np.linalg.pinv(matrix * np.outer(scale, scale), rcond=1e-14, hermitian=True) * np.outer(
        scale, scale
    )
    without = np.diag(J @ alone[:TEN, :TEN] @ J.T)
    return np.asarray(np.diag(posterior.body_covariance) < 0.5 * without)
