"""Motion, body and calibration parameters at once, from the raw readings of all instruments.

First the motion alone, then motion and forces; force readings that stand alone and stretches in
which something touches the platform are left out; where forces and accelerometer feel a vibration
that the knots do not follow, finer knots do, and where forces resolve more of the motion than its
own instruments ask for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance import balance_of
from steelyard.identification.model.calibration_parameters import CalibrationValues, clock_of
from steelyard.identification.model.motion_residuals import reference_clocks, time_of
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.samples.dense_streams import average_dense
from steelyard.identification.samples.segmentation import recorded
from steelyard.identification.samples.spline_through_poses import resampled
from steelyard.identification.solve.beginning import (
    Beginning,
    Readings,
    Tell,
    begin,
    motion_task,
    read,
    with_body,
)
from steelyard.identification.solve.conclusion import Fitted, concluded, sound, stretch_of
from steelyard.identification.solve.fit_state import FitState, Task, linearise, smooth
from steelyard.identification.solve.joint_fit import fit
from steelyard.identification.solve.misfits.coherence import coherence
from steelyard.identification.solve.misfits.disturbances import as_noise, with_disturbances
from steelyard.identification.solve.misfits.jitter import with_jitter, with_jitter_found
from steelyard.identification.solve.misfits.outliers import look
from steelyard.identification.solve.misfits.suspicions import (
    with_suspicions,
    without_needless,
)
from steelyard.identification.solve.misfits.undisturbed_swings import slowly, undisturbed_swings
from steelyard.identification.solve.newton_step import step_of
from steelyard.identification.solve.noise_levels import ratios_of, spent_by
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.identification.solve.stated_processes import with_stated
from steelyard.smoothing import DEGREE

_SAME_TENSION = 0.01
"""Part of the usual tension by which one may move without lengths being looked at again."""
_EXPLANATIONS = 2
"""Times that priors and disturbances are looked at in turn: one may have stood in for the other."""


@dataclass(frozen=True)
class _FinerKnots:
    """How a run is to be followed more closely."""

    spacing: float
    """Of the knots [s]."""
    clock: str
    lag: float
    """By how much that clock is later than thought [s]."""


def fit_jointly(
    experiment: Experiment,
    progress: Progress = None,
    start: CalibrationValues | None = None,
    settings: FitSettings = FIT,
) -> Posterior:
    """Fit an experiment as a whole.

    Args:
        experiment: With at least one run.
        progress: Is called with what is being done and the fraction that is done.
        start: Values of the calibration parameters to begin with; None: as known beforehand.
        settings: How to fit.

    Raises:
        InputError: A run lacks what the method needs.
        NoBalanceError: Forces and motion cannot be fitted.
    """

    def tell(what: str, fraction: float) -> None:
        if progress is not None:
            progress(f"maximum-likelihood: {what}", fraction)

    def posterior() -> Posterior:
        dense = average_dense(experiment, settings.motion)
        readings = read(dense, start, tell, settings=settings)
        found = fit_readings(readings, begin(readings, tell, thorough=False), tell)
        return concluded([stretch_of(readings, found)])

    return sound(posterior)


def fit_readings(readings: Readings, begun: Beginning, tell: Tell) -> Fitted:
    """Fit motion and forces, with what vibrates followed more closely, and what nothing explains.

    Args:
        readings: Of the experiment.
        begun: Where to begin.
        tell: Is called with what is being done and the fraction that is done.

    Raises:
        numpy.linalg.LinAlgError: The motion is not determined.
    """
    readings, begun = undisturbed_swings(readings, begun)
    found = _fitted(readings, begun, tell, {})
    if vibrations := _vibrations(readings, found):
        tell("following a vibration", 0.4)
        readings = _finer(readings, vibrations)
        begun = with_body(readings, _again(readings, found, vibrations))
        readings, begun = undisturbed_swings(readings, begun)
        found = _fitted(readings, begun, tell, vibrations)
    found = _as_forces_ask(readings, found, tell)
    tell("what nothing explains", 0.8)
    usual = found.task.calibration_parameters
    for turn in range(_EXPLANATIONS):
        task, own = with_suspicions(*with_jitter_found(found.task, found.fit))
        if turn and task is found.task:
            break
        explained = replace(found, task=task, fit=own)
        if task is not found.task:
            explained = _cut_anew(readings, begun, explained, tell)
        task, own = explained.task, explained.fit
        before, found = found, replace(explained, fit=with_disturbances(task, own))
        if found.fit is before.fit:
            # Nothing is asked for, and would not be a second time.
            break
    if any(segment.processes for segment in found.fit.state.segments):
        task, own = without_needless(found.task, found.fit, usual)
        found = replace(found, task=task, fit=own)
    # Gains that were far off then have stretched cables by what they do not.
    return _seen_with_tensions(found, _SAME_TENSION)


def _finer(readings: Readings, vibrations: Mapping[str, _FinerKnots]) -> Readings:
    """The readings on finer knots where something vibrates."""
    experiment = readings.experiment
    records = tuple(
        recorded(
            experiment,
            run,
            each,
            readings.calibration,
            vibrations[run.name].spacing,
            readings.settings.motion,
        )
        if run.name in vibrations
        else record
        for run, each, record in zip(readings.runs, readings.samples, readings.records, strict=True)
    )
    return replace(readings, records=records)


def _as_forces_ask(readings: Readings, found: Fitted, tell: Tell) -> Fitted:
    """On finer knots where forces whose noise is stated resolve more of the motion than its own
    instruments ask for, as those of a large or heavy platform do; the very same where these explain
    none of what is left of the forces.
    """
    for _ in range(readings.settings.finer_turns):
        coarse = _coarse(readings, found)
        if not coarse:
            break
        finer = _finer(readings, coarse)
        begun = with_body(finer, _again(finer, found, coarse))
        if not _explain(begun, found):
            break
        tell("following what the forces resolve", 0.5)
        finer, begun = undisturbed_swings(finer, begun)
        tried = _fitted(finer, begun, tell, {})
        if not tried.fit.converged or _force_level(tried) >= _force_level(found):
            break
        readings, found = finer, tried
    return found


def _coarse(readings: Readings, found: Fitted) -> dict[str, _FinerKnots]:
    """Runs whose forces scatter more than their stated noise does and whose instruments resolve
    finer knots, with knots half as far apart.
    """
    settings, experiment = readings.settings, readings.experiment
    if not found.fit.converged:
        return {}
    closest = {segment.run: each.closest for each in readings.records for segment in each.segments}
    coarse = {}
    for segment, forces in zip(found.fit.state.segments, found.force_samples, strict=True):
        if segment.static or not _larger_noise(found, forces.name):
            continue
        spacing = float(segment.knots[DEGREE + 1] - segment.knots[DEGREE])
        if closest[segment.run] < settings.much_finer * spacing:
            finer = max(closest[segment.run], spacing / 2)
            coarse[segment.run] = _FinerKnots(finer, clock_of(experiment, forces.name), 0.0)
    return coarse


def _larger_noise(found: Fitted, name: str) -> bool:
    """Whether an instrument scatters more than its stated noise does."""
    factors, stated = found.fit.state.factors, found.fit.stated
    return any(own[0] == name and own in stated and f > 1.0 for own, f in factors.items())


def _force_level(found: Fitted) -> float:
    """Largest factor of the stated noise of the forces."""
    names = {forces.name for forces in found.force_samples}
    return max((f for own, f in found.fit.state.factors.items() if own[0] in names), default=1.0)


def _explain(begun: Beginning, found: Fitted) -> bool:
    """Whether one step of the motion on other knots takes most of what is left of the forces, its
    freedom counted: noise, and errors of the description, stay.
    """
    task = replace(begun.task, force_samples=found.force_samples)
    task, state = with_jitter(task, with_stated(task, begun.state))
    parts, _ = linearise(task, state)
    state = step_of(task, state, smooth(state, [each.all for each in parts])).along(
        task, state, 1.0
    )
    parts, tally = linearise(task, state)
    ratios = ratios_of(task, spent_by(smooth(state, [each.all for each in parts])), tally)
    names = {forces.name for forces in found.force_samples}
    return any(
        ratios[own] < task.settings.explained * before
        for own, before in found.fit.ratios.items()
        if own[0] in names and own in ratios and _larger_noise(found, own[0])
    )


def _vibrations(readings: Readings, fitted: Fitted) -> dict[str, _FinerKnots]:
    """Runs in which forces and accelerometer both feel what the knots do not follow."""
    settings = readings.settings
    finest = {segment.run: each.finest for each in readings.records for segment in each.segments}
    state = fitted.fit.state
    assert state.parameters is not None
    found = {}
    for segment, at in zip(state.segments, fitted.balances, strict=True):
        if segment.static:
            continue
        spacing = float(segment.knots[DEGREE + 1] - segment.knots[DEGREE])
        if finest[segment.run] >= settings.much_finer * spacing:
            continue
        mass = float(state.parameters[0])
        own = coherence(readings.experiment, segment, at, state.calibration, mass, settings)
        if own.correlation > settings.coherent:
            clock = clock_of(readings.experiment, own.instrument)
            found[segment.run] = _FinerKnots(finest[segment.run], clock, own.lag)
    return found


def _fitted(
    readings: Readings, begun: Beginning, tell: Tell, vibrations: Mapping[str, _FinerKnots]
) -> Fitted:
    """Motion and forces, leaving out what stands alone."""
    tell("motion and forces", 0.5)
    task = replace(begun.task, force_samples=readings.force_samples)
    task, state = with_jitter(task, with_stated(task, begun.state))
    if vibrations:
        # The vibration first, by these clocks: before it is there, nothing holds them.
        active = task.active.copy()
        for run, vibrating in vibrations.items():
            active[task.calibration_parameters.place(vibrating.clock, "delay", run)] = False
        state = fit(replace(task, active=active), state).state
    fitted = _cut(readings, begun, task, state, tell, vibrations)
    if fitted.fit.converged:
        return _seen_with_tensions(fitted, 0.0)
    # Noise that is not stated and what nothing explains pull at each other: first the one, by a
    # noise that is left as it is, then both.
    tell("what nothing explains", 0.6)
    # What touched the platform stands out even there.
    task, before = replace(task, force_samples=fitted.force_samples), fitted.contacts
    fitted = _cut(readings, begun, task, state, tell, vibrations, levels=False)
    fitted = _with_tensions(replace(fitted, contacts=_joined(before, fitted.contacts)))
    fitted = replace(fitted, fit=with_disturbances(fitted.task, fitted.fit))
    for _ in range(readings.settings.cuts):
        # What touches the platform is in the level of what nothing explains: smaller without.
        touched, changed = _touched(fitted, settings=readings.settings)
        if not changed:
            break
        again = fit(touched.task, touched.fit.state)
        fitted = replace(touched, fit=with_disturbances(touched.task, again, anew=True))
    return fitted


def _with_tensions(fitted: Fitted) -> Fitted:
    """With the stretch and the sag of cables, where lengths are read, by tensions as they are by
    now: at first they are those of the readings, with all their gains and offsets; the very same
    where no instrument looks at them. Where cables stretch, lengths follow the tensions from here on.
    """
    task, state = fitted.task, fitted.fit.state
    if not any(r.tension is not None for segment in state.segments for r in segment.readings):
        return fitted
    segments = []
    for segment, at, forces in zip(
        state.segments, fitted.balances, fitted.force_samples, strict=True
    ):
        # Where something touches the platform, the readings know and the balance does not.
        carried = np.where(forces.touched[:, None], at.measured.values, at.carried)
        references = reference_clocks(task.experiment, task.calibration_parameters, segment)
        stretching = bool(task.experiment.robot.cable.axial_stiffness)
        follows = stretching and not bool(forces.touched.all())
        readings = []
        for each in segment.readings:
            alone = False
            if each.tension is not None:
                # Nobody reads what would let these follow more than a swing.
                alone = task.experiment.instruments[each.source[0]].tells_stretch
                each = replace(each, follows=follows and not alone)
            if each.tension is not None and not segment.static:
                name, clock = each.source[0], each.time
                times, *_ = time_of(
                    task.experiment, segment, state.calibration, references, name, clock
                )
                own = slowly(at.time, at.carried) if alone else carried
                columns = [np.interp(times, at.time, column) for column in own.T]
                each = replace(each, tension=np.column_stack(columns))
            readings.append(each)
        segments.append(replace(segment, readings=tuple(readings)))
    state = replace(state, segments=tuple(segments))
    return replace(fitted, fit=replace(fitted.fit, state=state))


def _seen_with_tensions(fitted: Fitted, least: float) -> Fitted:
    """Fitted again, lengths being seen with tensions as they are by now; the very same where none has
    moved by more than a part of the usual one.
    """
    followed = _with_tensions(fitted)
    if followed is fitted:
        return fitted
    pairs = [
        (new.tension, old.tension)
        for after, before in zip(
            followed.fit.state.segments, fitted.fit.state.segments, strict=True
        )
        for new, old in zip(after.readings, before.readings, strict=True)
        if new.tension is not None and old.tension is not None
    ]
    moved = max(float(np.max(np.abs(new - old), initial=0.0)) for new, old in pairs)
    usual = max(float(np.median(np.abs(new))) for new, _ in pairs)
    if moved < least * usual:
        return fitted
    return replace(followed, fit=fit(followed.task, followed.fit.state))


def _joined(
    one: Mapping[str, Sequence[tuple[float, float]]],
    other: Mapping[str, Sequence[tuple[float, float]]],
) -> dict[str, list[tuple[float, float]]]:
    """Contacts of both, run by run."""
    return {
        run: list(dict.fromkeys([*one.get(run, ()), *other.get(run, ())]))
        for run in {**one, **other}
    }


def _touched(fitted: Fitted, settings: FitSettings) -> tuple[Fitted, bool]:
    """Without the forces in which something touches the platform, and whether these are more than
    before: what stands out of all that an unmodelled wrench does elsewhere.
    """
    task, state = fitted.task, fitted.fit.state
    assert state.parameters is not None
    contacts = {run: list(each) for run, each in fitted.contacts.items()}
    force_samples = []
    for segment, forces, before in zip(
        state.segments, fitted.force_samples, fitted.balances, strict=True
    ):
        plain, own = as_noise(segment, forces, before.time, state.factors)
        at = balance_of(
            task.experiment, plain, own, state.calibration, state.parameters, state.factors
        )
        looked = look(at, own, own.sigmas(segment, state.factors), settings)
        contacts.setdefault(segment.run, []).extend(looked.contacts)
        force_samples.append(forces.leaving_out(looked.force_samples.left_out))
    changed = any(
        bool(np.any(new.left_out != old.left_out))
        for new, old in zip(force_samples, fitted.force_samples, strict=True)
    )
    samples = tuple(force_samples)
    return (
        replace(
            fitted,
            task=replace(task, force_samples=samples),
            force_samples=samples,
            contacts=contacts,
        ),
        changed,
    )


def _cut(
    readings: Readings,
    begun: Beginning,
    task: Task,
    state: FitState,
    tell: Tell,
    vibrations: Mapping[str, _FinerKnots],
    *,
    levels: bool = True,
) -> Fitted:
    """A fit, again without the readings that stand out of it, until none does or it does not
    arrive.
    """
    settings = readings.settings
    force_samples = tuple(each for each in task.force_samples if each is not None)
    contacts = {run: list(each) for run, each in begun.touched.items()}
    spikes: dict[str, int] = {}
    first = state
    for turn in range(settings.cuts):
        task = replace(task, force_samples=force_samples)
        found = fit(
            task,
            state,
            lambda part: tell("motion and forces", 0.5 + 0.3 * part),
            levels=levels,
        )
        # What has not arrived is no better a beginning than that which it had.
        state = found.state if found.converged else first
        fitted = Fitted(
            task,
            found,
            begun.motion,
            force_samples,
            begun.lost,
            contacts,
            spikes,
            slack=begun.slack,
        )
        # What does not arrive may do without what touched the platform; once more it does not.
        last = turn == settings.cuts - 1 or (levels and turn > 0 and not found.converged)
        if last or (not vibrations and _vibrations(readings, fitted)):
            # What is to be followed more closely need not be looked at for what stands out of it.
            break
        looked = [
            look(at, forces, forces.sigmas(segment, found.state.factors), settings)
            for segment, at, forces in zip(
                found.state.segments, fitted.balances, force_samples, strict=True
            )
        ]
        if not any(each.changed for each in looked):
            break
        for segment, each in zip(state.segments, looked, strict=True):
            contacts.setdefault(segment.run, []).extend(each.contacts)
            spikes[segment.run] = spikes.get(segment.run, 0) + len(each.spikes)
        force_samples = tuple(each.force_samples for each in looked)
    return fitted


def _cut_anew(readings: Readings, begun: Beginning, found: Fitted, tell: Tell) -> Fitted:
    """Fitted with the readings that stood out before errors of the devices explained what is left,
    and without those that stand out even then; the very same where none was left out.
    """
    pairs = [
        (own, first)
        for own, first in zip(found.task.force_samples, readings.force_samples, strict=True)
        if own is not None
    ]
    if all(np.array_equal(own.left_out, first.left_out) for own, first in pairs):
        return found
    given_back = tuple(own.leaving_out(first.left_out) for own, first in pairs)
    task = replace(found.task, force_samples=given_back)
    again = _cut(readings, begun, task, found.fit.state, tell, {})
    return _seen_with_tensions(again, 0.0) if again.fit.converged else found


def _again(readings: Readings, before: Fitted, vibrations: Mapping[str, _FinerKnots]) -> Beginning:
    """What was found, on other knots; clocks where forces and accelerometers go together best, since
    what vibrates fits at many lags.
    """
    state, parameters = before.fit.state, before.task.calibration_parameters
    values = state.calibration.values.copy()
    for run, each in vibrations.items():
        place = parameters.place(each.clock, "delay", run)
        values[place] += np.where(parameters.deviation[place] > 0, each.lag, 0.0)
    moved = [
        _on_knots_of(new, old) for old, new in zip(state.segments, readings.segments, strict=True)
    ]
    state = replace(
        state, calibration=replace(state.calibration, values=values), segments=tuple(moved)
    )
    return Beginning(motion_task(readings), before.motion, state, before.lost, slack=before.slack)


def _on_knots_of(new: Segment, old: Segment) -> Segment:
    """The motion and the readings of a segment on the knots of another."""
    if len(old.knots) == len(new.knots):
        return old
    return resampled(old, replace(new, reference=old.reference, readings=old.readings))
