"""Motion, body and calibration parameters at once, from the raw readings of all instruments.

First the motion alone, then motion and forces; force readings that stand alone and stretches in
which something touches the platform are left out; where forces and accelerometer feel a vibration
that the knots do not follow, finer knots do, and where forces resolve more of the motion than its
own instruments ask for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.calibration_parameters import CalibrationValues
from steelyard.identification.samples.dense_streams import average_dense
from steelyard.identification.solve.beginning.begin import Beginning, begin, with_body
from steelyard.identification.solve.beginning.readings import Readings, Tell, read
from steelyard.identification.solve.between_fits.cuts import (
    cut,
    cut_anew,
    joined_contacts,
    without_standing_out,
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
from steelyard.identification.solve.conclusion import concluded, sound
from steelyard.identification.solve.fit_state import FitState, Task, linearise, smooth
from steelyard.identification.solve.fitted import (
    Fitted,
    FittedStretch,
    handed_on,
    stretch_of,
    without_knots,
)
from steelyard.identification.solve.joint_fit import fit
from steelyard.identification.solve.long_recording import (
    lively_parts,
    moving_length,
    window_about,
    windows,
)
from steelyard.identification.solve.misfits.disturbances import with_disturbances
from steelyard.identification.solve.misfits.jitter import with_jitter, with_jitter_found
from steelyard.identification.solve.misfits.late_or_filtered import with_twins_settled
from steelyard.identification.solve.misfits.suspicions import with_suspicions, without_needless
from steelyard.identification.solve.misfits.undisturbed_swings import undisturbed_swings
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.identification.solve.stated_processes import with_stated
from steelyard.inertia import TEN
from steelyard.processes.heap import give_back

_SAME_TENSION = 0.01
"""Part of the usual tension by which one may move without lengths being looked at again."""
_EXPLANATIONS = 2
"""Times that priors and disturbances are looked at in turn: one may have stood in for the other."""


def fit_jointly(
    experiment: Experiment,
    progress: Progress = None,
    start: CalibrationValues | None = None,
    settings: FitSettings = FIT,
    *,
    vibrating: float = 0.0,
) -> Posterior:
    """Fit an experiment as a whole.

    Args:
        experiment: With at least one run.
        progress: Is called with what is being done and the fraction that is done.
        start: Values of the calibration parameters to begin with; None: as known beforehand.
        settings: How to fit.
        vibrating: Frequency at which motions are to be followed too, as far as their instruments
            resolve it [Hz].

    Raises:
        InputError: A run lacks what the method needs.
        NoBalanceError: Forces and motion cannot be fitted.
    """

    def tell(what: str, fraction: float) -> None:
        if progress is not None:
            progress(f"maximum-likelihood: {what}", fraction)

    def posterior() -> Posterior:
        dense = average_dense(experiment, settings.motion)
        if moving_length(dense) > settings.long_jointly:
            found = fit_by_windows(dense, start, tell, settings, vibrating)
            # What is looked at of it takes memory of its own.
            give_back()
            return found
        return concluded([stretch_of(*_whole(dense, start, tell, settings, vibrating))])

    return sound(posterior)


def _whole(
    experiment: Experiment,
    start: CalibrationValues | None,
    tell: Tell,
    settings: FitSettings,
    vibrating: float,
) -> tuple[Readings, Fitted]:
    """All of an experiment at once; arguments as of :func:`fit_jointly`."""
    readings = read(experiment, start, tell, settings=settings)
    begun = begin(readings, tell, thorough=False)
    return readings, fit_readings(readings, begun, tell, vibrating=vibrating)


def fit_by_windows(
    experiment: Experiment,
    start: CalibrationValues | None,
    tell: Tell,
    settings: FitSettings,
    vibrating: float,
) -> Posterior:
    """A long recording, window by window about what a part of it tells, and again about what the
    whole does where that is far away; arguments as of :func:`fit_jointly`.

    Motion and forces of a window are linearised and looked at for what stands out about body,
    calibration, noise and disturbances that are given; what they say of these is added up.
    """
    lively = lively_parts(experiment, settings.part_jointly, settings)
    part, finer = _part_of(
        lively, start, lambda what, done: tell(what, 0.2 * done), settings, vibrating
    )
    if finer:
        # What vibrates asks for knots that windows do not choose by themselves.
        return concluded([stretch_of(*_whole(experiment, start, tell, settings, vibrating))])
    # Fewer stretches tell the scatter between them as well, and matrices of each take memory.
    longest = moving_length(experiment) / settings.most_long_blocks
    wide = replace(settings, block=max(settings.long_block, longest))
    part = replace(part, task=replace(part.task, settings=wide))
    runs = list(windows(experiment, settings))
    for _ in range(settings.most_passes):
        whole = concluded(_windows_about(part, experiment, runs, tell))
        about, there = part.fit.state, whole.fit.state
        assert about.parameters is not None
        deviation = np.sqrt(np.maximum(np.diag(whole.solution.covariance)[:TEN], 0.0))
        moved = np.abs(whole.parameters - about.parameters)
        if np.all(moved <= settings.small_step * deviation):
            break
        about = replace(about, calibration=there.calibration, parameters=there.parameters)
        part = replace(part, fit=replace(part.fit, state=about))
    return whole


def _windows_about(
    part: Fitted, experiment: Experiment, runs: Sequence[Run], tell: Tell
) -> list[FittedStretch]:
    """Windows of a long recording about what a part of it tells; the last one has what was left out of
    all of them.
    """
    found: list[FittedStretch] = []
    for i, run in enumerate(runs):
        tell("window by window", 0.2 + 0.75 * i / len(runs))
        # What stays of each window is made between large matrices.
        give_back()
        for window in _about(part, experiment, run):
            if found:
                found[-1], window = handed_on(found[-1], window)
            found.append(window)
    found[-1] = _with_all_contacts(found)
    give_back()
    return found


def _part_of(
    lively: Experiment,
    start: CalibrationValues | None,
    tell: Tell,
    settings: FitSettings,
    vibrating: float,
) -> tuple[Fitted, bool]:
    """The fit of a part, without the large matrices of its knots, and whether it has taken finer
    knots than its readings begin with; arguments as of :func:`fit_jointly`.
    """
    readings, fitted = _whole(lively, start, tell, settings, vibrating)
    own, first = (
        min((each.spacing for each in segments if not each.static), default=np.inf)
        for segments in (fitted.fit.state.segments, readings.segments)
    )
    return fitted.without_equations(), own < settings.much_finer * first


def _about(part: Fitted, experiment: Experiment, run: Run) -> list[FittedStretch]:
    """A window of a long recording, without the readings that stand out of it."""
    begun = window_about(part, experiment, run)
    if begun is None:
        return []
    readings, state = begun
    fitted = replace(part, force_samples=readings.force_samples, lost=(), contacts={}, spikes={})
    for turn in range(readings.settings.cuts):
        task = replace(part.task, experiment=experiment, force_samples=fitted.force_samples)
        state = _with_forces(task, state)
        fitted = replace(fitted, task=task, fit=replace(part.fit, state=state))
        if turn == readings.settings.cuts - 1:
            break
        fewer = without_standing_out(fitted, readings.settings)
        if fewer is None:
            break
        fitted = fewer
    return [without_knots(stretch_of(readings, fitted))]


def _with_forces(task: Task, state: FitState) -> FitState:
    """The motion that the forces tell too, with body and calibration held."""
    for _ in range(task.settings.stretch_iterations):
        parts, _ = linearise(task, state)
        equations = smooth(state, [each.all for each in parts])
        segments = tuple(
            replace(
                segment,
                coefficients=segment.coefficients + each.settled.reshape(-1, segment.block),
            )
            for segment, each in zip(state.segments, equations, strict=True)
        )
        state = replace(state, segments=segments)
        if sum(float(each.motion_gradient @ each.settled) for each in equations) < (
            task.settings.arrived
        ):
            break
    return state


def _with_all_contacts(found: Sequence[FittedStretch]) -> FittedStretch:
    """The last window with what was left out of all of them."""
    contacts: Mapping[str, Sequence[tuple[float, float]]] = {}
    spikes: dict[str, int] = {}
    for each in found:
        contacts = joined_contacts(contacts, each.fitted.contacts)
        for run, count in each.fitted.spikes.items():
            spikes[run] = spikes.get(run, 0) + count
    last = found[-1]
    return replace(last, fitted=replace(last.fitted, contacts=contacts, spikes=spikes))


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
    """Finer knots that explain what is left of the forces, and the beginning on them; None: there are
    no such ones.

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
    """Motion and forces, leaving out what stands alone; and the readings on the knots that it took."""
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
