"""Directed tests: one for each number of the description.

Residuals as a whole do not see wrong geometry, since offsets absorb it. So the residual is also
asked for every single number of the description (where a cable is fixed, a gain, a delay, an axis)
whether a different value would explain it better than noise does: a score test [Rao1948]_,
two-sided, corrected for the number of tests [Dunn1961]_. Only what also moves the estimate counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.estimates.quantiles import normal_exceeded
from steelyard.identification.model.calibration_parameters import (
    DRAG,
    ROBOT,
    CalibrationParameter,
    element_of,
)
from steelyard.identification.solve.border.normal_equations import BorderEquations, Solution
from steelyard.identification.solve.posterior import Posterior
from steelyard.identification.verdict.settings import VERDICT, VerdictSettings
from steelyard.inertia import TEN, body_jacobian
from steelyard.instruments.base import LATENCY, TIME_CONSTANT
from steelyard.instruments.length import CABLE_DAMPING
from steelyard.instruments.unread_cables import COMPLIANCE


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
    implausible: bool = False
    """Whether nobody has stated it, and it is larger than that of any device."""

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


def of_description(tests: Sequence[Finding], most: int, settings: VerdictSettings) -> Iterator[str]:
    """Numbers of the description that the residual points at."""
    limit = float(normal_exceeded(settings.family / max(1, len(tests)) / 2))
    found = [
        test
        for test in tests
        if test.implausible
        or (abs(test.z) > limit and test.shift > settings.matters and not test.negligible)
    ]
    for test in found[:most]:
        yield str(test)
    if len(found) > most:
        yield (
            f"{len(found) - most} more numbers of the description seem to be off; what is named"
            " first may explain them"
        )


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
    follow = total.normal[np.ix_(tested, use)] @ solution.projection[np.ix_(use, use)]
    information = total.normal[np.ix_(tested, tested)] - follow @ total.normal[np.ix_(use, tested)]
    score = solution.scores[tested]
    score = score - follow @ pulled_by_priors(posterior, use)
    diagonal, own = np.diag(information), np.diag(total.normal)[tested]
    beyond, told = _by_curvature(total, solution, tested, use, follow, diagonal)
    noise = posterior.noise_factor * (diagonal + beyond)
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
    components = {
        TEN + place: (unknown, component)
        for place, unknown, component in calibration_parameters.components()
    }
    moves = -solution.gain[:TEN][:, use] @ total.normal[np.ix_(use, tested)]
    length = length_of(posterior)
    for i, column in enumerate(tested):
        if diagonal[i] < settings.its_own * own[i] or told[i] < settings.told:
            continue
        (unknown, component), size = components[int(column)], score[i] / diagonal[i]
        if unknown.bends and posterior.fit.motions:
            # Second derivatives of a held motion have its noise, as has what is left over.
            continue
        if not _may_be_alone(unknown, component, size):
            continue
        yield Finding(
            name=calibration_parameters.names[column - TEN],
            z=float(z[i]),
            size=float(size),
            sigma=float(np.sqrt(noise[i]) / diagonal[i]),
            unit=unknown.unit,
            shift=length(moves[:, i] * size),
            proposal=_proposal(unknown.owner, unknown.key),
            negligible=bool(abs(size) < unknown.negligible),
        )


def _may_be_alone(unknown: CalibrationParameter, component: int, size: float) -> bool:
    """Whether a number may be off by so much while all others of its parameter are right: of what
    bends, those on the diagonal, which are positive.
    """
    if not unknown.bends:
        return True
    i, j = element_of(unknown.key, component)
    return i == j and size > 0


def pulled_by_priors(posterior: Posterior, use: NDArray[np.intp]) -> Array:
    """Scores of what is estimated, without those of its priors: what these pull is no evidence
    against what is not estimated, shape (u,).

    Args:
        posterior: With the scores.
        use: Columns that are estimated, shape (u,).
    """
    prior = posterior.prior.precision @ posterior.solution.value - posterior.prior.pull
    return np.asarray(posterior.solution.scores[use] - prior[use])


def _by_curvature(
    total: BorderEquations,
    solution: Solution,
    tested: NDArray[np.intp],
    use: NDArray[np.intp],
    follow: Array,
    information: Array,
) -> tuple[Array, Array]:
    """What noise of the motion in the derivatives does to the tests: variance of the scores since
    the estimate is not where it would be, were the likelihood curved as the products of derivatives
    say, and the part of the information that no noise has told, shape (t,) each.

    Args:
        total: Of all runs.
        solution: Of them.
        tested: Columns that are tested, shape (t,).
        use: Columns that are estimated, shape (u,).
        follow: How scores of the former follow those of the latter, shape (t, u).
        information: Of each test, shape (t,).
    """
    if total.by_noise is None:
        return np.zeros(len(tested)), np.ones(len(tested))
    curved = (total.normal - total.by_noise)[np.ix_(tested, use)]
    further = curved @ solution.gain[np.ix_(use, use)] - follow
    across = total.by_noise[np.ix_(tested, use)]
    within = follow @ total.by_noise[np.ix_(use, use)]
    by_noise = np.diag(total.by_noise)[tested] + np.sum((within - 2 * across) * follow, axis=1)
    return (
        np.sum(further @ total.normal[np.ix_(use, use)] * further, axis=1),
        1 - by_noise / np.maximum(information, 1e-300),
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
    r"""Calibration parameters that were estimated: whether they came out where their prior has
    them.

    With an error :math:`e` of covariance :math:`P` and a gain :math:`G`, an estimate lies off its
    prior mean by a variance of :math:`P_0 + P - 2 G`, for :math:`\operatorname{cov}(e, x) = -G`.
    Where the noise of the motion makes :math:`P` larger than :math:`G`, this is more than
    :math:`P_0 - P`.
    """
    calibration_parameters, values = (
        posterior.calibration.calibration_parameters,
        posterior.calibration.values,
    )
    variance, gain = (
        np.diag(each)[TEN:] for each in (posterior.solution.covariance, posterior.solution.gain)
    )
    moves = posterior.solution.covariance[:TEN, TEN:]
    length = length_of(posterior)
    for place, unknown, component in calibration_parameters.components():
        if unknown.is_load:
            # What is known of it is held against the readings beside what is known of bodies.
            continue
        prior = unknown.deviation[component] ** 2
        if (
            not posterior.solution.estimated[TEN + place]
            or variance[place] > settings.informed * prior
        ):
            continue
        size = values[place] - unknown.mean[component]
        off = max(prior + variance[place] - 2 * gain[place], (1 - settings.informed) * prior)
        z = float(size / np.sqrt(off))
        unstated = unknown.full_key in posterior.asked_for
        yield Finding(
            name=calibration_parameters.names[place],
            z=z,
            size=float(size),
            sigma=float(np.sqrt(variance[place])),
            unit=unknown.unit,
            # Held at its prior, the estimate would move by so much.
            shift=length(moves[:, place] / variance[place] * size),
            proposal=_proposal(unknown.owner, unknown.key),
            implausible=unstated and abs(z) > settings.implausible,
        )


def length_of(posterior: Posterior) -> Callable[[Array], float]:
    """Length of a change of the ten linear parameters, shape (10,), in the 1-sigma of what is told:
    a function, since it is asked of hundreds.
    """
    told = posterior.identifiable
    J = body_jacobian(posterior.parameters)[told]
    covariance = posterior.body_covariance[np.ix_(told, told)]
    scale = 1 / np.sqrt(np.diag(covariance))
    inverse = np.linalg.pinv(covariance * np.outer(scale, scale), hermitian=True)

    def length(change: Array) -> float:
        moved = scale * (J @ change)
        return float(np.sqrt(np.abs(moved @ inverse @ moved)))

    return length


def _proposal(owner: str, key: str) -> str:
    """What to do about a number of the description that seems to be off."""
    if owner == ROBOT:
        head = key.partition(".")[0]
        return {
            "attached": (
                "look for a hose or a cable that pulls at the platform, or hold it differently"
            ),
            "hose": (
                "check this number of the hose under 'attached', or state a larger 'sigma' there"
            ),
            "damping": (
                "swings decay faster than is plausible; look for what rubs at cables or rollers"
            ),
            "swivel": (
                "swings decay by more friction than is plausible; look for what rubs at this"
                " cable's anchor"
            ),
            "bending": (
                "a part of the platform seems to bend; stiffen it, move more slowly, or state"
                " 'bending'"
            ),
            "drag": "the air seems to slow the platform; move it more slowly, or make it smaller",
            "anchor": "measure this anchor again, or state a larger 'uncertainty: {anchor: …}'",
            "attachment": (
                "measure this attachment again, or state a larger 'uncertainty: {attachment: …}'"
            ),
            "gravity": "check the sign, size and direction of 'gravity' in the robot file",
            DRAG: "check 'linear_density' of the cables in the robot file",
        }[head]
    if key == COMPLIANCE:
        return (
            "ropes seem softer than any; look for a winch that gives, or remove 'length_noise' from"
            " 'uncertainty'"
        )
    where = f"'instruments: {{{owner}: {{calibration: {{{key}: …}}}}}}'"
    return {
        "gain": f"check this sensor's gain and unit, or state a larger {where}",
        "common_gain": (
            f"check the unit and the calibration of the force sensors, or state a larger {where}"
        ),
        CABLE_DAMPING: f"ropes seem to damp by more than is usual; state a larger {where}",
        "friction": f"check this roller, its bearing and its swivel, or state a larger {where}",
        "offset": f"check the zero of this sensor, or state a larger {where}",
        TIME_CONSTANT: (
            f"check 'sync' and 'clock' of {owner} against those of the motion instruments, or state"
            f" the time constant of its amplifier's filter under {where}"
        ),
        LATENCY: f"check which clock stamps {owner}; give it a 'clock' of its own",
        "delay": (
            "check 'sync' and 'clock', or state a larger 'delay' of the instruments of this clock"
        ),
        "misalignment": (
            f"check the axes, signs and 'rpy_deg' of {owner}, or state a larger {where}"
        ),
    }.get(key, f"check how {owner} is described and mounted, or state a larger {where}")
