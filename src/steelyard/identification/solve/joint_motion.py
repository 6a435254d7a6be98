"""From an experiment to a posterior, with motion, body and calibration parameters at once, from the
raw readings of all instruments: the whole of it, or a long recording window by window.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.model.calibration_parameters import CalibrationValues
from steelyard.identification.samples.dense_streams import average_dense
from steelyard.identification.solve.beginning.begin import begin
from steelyard.identification.solve.beginning.readings import Readings, Tell, read
from steelyard.identification.solve.between_fits.cuts import (
    joined_contacts,
    without_standing_out,
)
from steelyard.identification.solve.conclusion import concluded, sound
from steelyard.identification.solve.fit_readings import fit_readings
from steelyard.identification.solve.fit_state import FitState, Task, linearise, smooth
from steelyard.identification.solve.fitted import (
    Fitted,
    FittedStretch,
    stretch_of,
    without_knots,
)
from steelyard.identification.solve.long_recording import (
    fitted_windows,
    lively_parts,
    moving_length,
    window_about,
    windows,
)
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.identification.solve.settings import FIT, FitSettings
from steelyard.identification.solve.shared_windows import attempts
from steelyard.inertia import TEN
from steelyard.processes.heap import give_back


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
    settings = settings.with_looser_motion(settings.motion.looser_jointly)

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
    """Windows of a long recording about what a part of it tells; the last one has what was left out
    of all of them.
    """
    found = fitted_windows(
        runs,
        attempts(_about, part, experiment, runs, part.task.settings.jobs),
        lambda done: tell("window by window", 0.2 + 0.75 * done),
    )
    found[-1] = _with_all_contacts(found)
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
