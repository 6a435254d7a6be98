"""Motion, body and calibration parameters of readings at once, and what their residuals ask for.

Force readings that stand alone and stretches in which something touches the platform are left out;
where forces and accelerometer feel a vibration that the knots do not follow, finer knots do, and
where forces resolve more of the motion than its own instruments ask for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from steelyard.identification.solve.beginning.begin import Beginning, with_body
from steelyard.identification.solve.beginning.readings import Readings, Tell
from steelyard.identification.solve.between_fits.cuts import (
    cut,
    cut_anew,
    joined_contacts,
    without_touched,
)
from steelyard.identification.solve.between_fits.finer_knots import (
    FinerKnots,
    begun_again,
    coarse_runs,
    finer_explain,
    on_finer_knots,
    scatter_of_forces,
    unfollowed,
    vibrations_of,
)
from steelyard.identification.solve.between_fits.lengths_by_tensions import (
    seen_with_tensions,
    with_tensions,
)
from steelyard.identification.solve.fit_state import FitState
from steelyard.identification.solve.fitted import (
    Fitted,
)
from steelyard.identification.solve.joint_fit import fit
from steelyard.identification.solve.misfits.disturbances import with_disturbances
from steelyard.identification.solve.misfits.jitter import with_jitter, with_jitter_found
from steelyard.identification.solve.misfits.late_or_filtered import with_twins_settled
from steelyard.identification.solve.misfits.suspicions import with_suspicions, without_needless
from steelyard.identification.solve.misfits.undisturbed_swings import undisturbed_swings
from steelyard.identification.solve.stated_processes import with_stated

_SAME_TENSION = 0.01
"""Part of the usual tension by which one may move without lengths being looked at again."""
_EXPLANATIONS = 2
"""Times that priors and disturbances are looked at in turn: one may have stood in for the other."""


def fit_readings(
    readings: Readings, begun: Beginning, tell: Tell, *, vibrating: float = 0.0
) -> Fitted:
    """Fit motion and forces, with what vibrates followed more closely, and what nothing explains.

    Args:
        readings: Of the experiment.
        begun: Where to begin.
        tell: Is called with what is being done and the fraction that is done.
        vibrating: See :func:`fit_jointly`.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    readings, begun = undisturbed_swings(readings, begun)
    readings, found = _fitted(readings, begun, tell, {})
    if vibrations := vibrations_of(readings, found) or unfollowed(readings, found, vibrating):
        tell("following a vibration", 0.4)
        readings = on_finer_knots(readings, vibrations)
        begun = with_body(readings, begun_again(readings, found, vibrations))
        readings, begun = undisturbed_swings(readings, begun)
        readings, found = _fitted(readings, begun, tell, vibrations)
    found = _as_forces_ask(readings, found, tell)
    tell("what nothing explains", 0.8)
    usual = found.task.calibration_parameters
    for turn in range(_EXPLANATIONS):
        task, own = with_suspicions(*with_jitter_found(found.task, found.fit))
        if turn and task is found.task:
            break
        explained = replace(found, task=task, fit=own)
        if task is not found.task:
            explained = cut_anew(readings, begun, explained, tell)
        task, own = explained.task, explained.fit
        before, found = found, replace(explained, fit=with_disturbances(task, own))
        if found.fit is before.fit:
            # Nothing is asked for, and would not be a second time.
            break
    if any(segment.processes for segment in found.fit.state.segments):
        task, own = without_needless(found.task, found.fit, usual)
        found = replace(found, task=task, fit=own)
    task, own = with_twins_settled(found.task, found.fit, usual)
    if task is not found.task:
        found = replace(found, task=task, fit=with_disturbances(task, own))
    # Gains that were far off then have stretched cables by what they do not.
    return seen_with_tensions(found, _SAME_TENSION)


def _as_forces_ask(readings: Readings, found: Fitted, tell: Tell) -> Fitted:
    """On finer knots where forces whose noise is stated resolve more of the motion than its own
    instruments ask for, as those of a large or heavy platform do; the very same where these explain
    none of what is left of the forces.
    """
    for _ in range(readings.settings.finer_turns if found.fit.converged else 0):
        closer = _closer(readings, found, tell, found)
        if closer is None:
            break
        finer, tried = _fitted(*closer, tell, {})
        if not tried.fit.converged or _scatter(tried) >= _scatter(found):
            break
        readings, found = finer, tried
    return found


def _scatter(found: Fitted) -> float:
    """Of the forces that scatter most, see :func:`scatter_of_forces`; 1 at least."""
    return max((1.0, *scatter_of_forces(found, found.fit.ratios).values()))


def _closer(
    readings: Readings, found: Fitted, tell: Tell, *beginnings: Fitted
) -> tuple[Readings, Beginning] | None:
    """Finer knots that explain what is left of the forces, and the beginning on them; None: there
    are no such ones.

    Args:
        readings: Of the experiment.
        found: A fit, with what is left.
        tell: Is called with what is being done and the fraction that is done.
        *beginnings: Where to begin, the first that explains it.
    """
    coarse = coarse_runs(readings, found)
    if not coarse:
        return None
    finer = on_finer_knots(readings, coarse)
    for before in beginnings:
        begun = with_body(finer, begun_again(finer, before, coarse))
        if finer_explain(begun, found):
            tell("following what the forces resolve", 0.5)
            return undisturbed_swings(finer, begun)
    return None


def _fitted(
    readings: Readings, begun: Beginning, tell: Tell, vibrations: Mapping[str, FinerKnots]
) -> tuple[Readings, Fitted]:
    """Motion and forces, leaving out what stands alone; and the readings on the knots that it
    took.
    """
    tell("motion and forces", 0.5)
    task = replace(begun.task, force_samples=readings.force_samples)
    task, state = with_jitter(task, with_stated(task, begun.state))
    if vibrations:
        # The vibration first, by these clocks: before it is there, nothing holds them.
        active = task.active.copy()
        for run, vibrating in vibrations.items():
            active[task.calibration_parameters.place(vibrating.clock, "delay", run)] = False
        state = fit(replace(task, active=active), state).state
    fitted = cut(readings, begun, task, state, tell, vibrations)
    if fitted.fit.converged:
        return readings, seen_with_tensions(fitted, 0.0)
    # Knots that are too wide for precise forces bend the motion, and it does not settle.
    start = replace(fitted, fit=replace(fitted.fit, state=state))
    if (closer := _closer(readings, fitted, tell, fitted, start)) is not None:
        return _fitted(*closer, tell, {})
    return readings, _with_what_nothing_explains(readings, begun, fitted, state, vibrations, tell)


def _with_what_nothing_explains(
    readings: Readings,
    begun: Beginning,
    fitted: Fitted,
    state: FitState,
    vibrations: Mapping[str, FinerKnots],
    tell: Tell,
) -> Fitted:
    """Motion and forces where these alone do not arrive.

    Args:
        readings: Of the experiment.
        begun: Where to begin.
        fitted: What did not arrive.
        state: From where.
        vibrations: See :func:`.on_finer_knots`.
        tell: Is called with what is being done and the fraction that is done.
    """
    # Noise that is not stated and what nothing explains pull at each other: first the one, by a
    # noise that is left as it is, then both.
    tell("what nothing explains", 0.6)
    # What touched the platform stands out even there.
    task, before = replace(fitted.task, force_samples=fitted.force_samples), fitted.contacts
    fitted = cut(readings, begun, task, state, tell, vibrations, levels=False)
    fitted = with_tensions(replace(fitted, contacts=joined_contacts(before, fitted.contacts)))
    fitted = replace(fitted, fit=with_disturbances(fitted.task, fitted.fit))
    for _ in range(readings.settings.cuts):
        # What touches the platform is in the level of what nothing explains: smaller without.
        touched, changed = without_touched(fitted, settings=readings.settings)
        if not changed:
            break
        again = fit(touched.task, touched.fit.state)
        fitted = replace(touched, fit=with_disturbances(touched.task, again, anew=True))
    return fitted
