"""Fits again without the force readings that stand out: single ones, and stretches in which
something touches the platform.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from steelyard.identification.model.balance import balance_of
from steelyard.identification.solve.beginning.begin import Beginning
from steelyard.identification.solve.beginning.readings import Readings, Tell
from steelyard.identification.solve.between_fits.finer_knots import FinerKnots, vibrations_of
from steelyard.identification.solve.between_fits.lengths_by_tensions import seen_with_tensions
from steelyard.identification.solve.fit_state import FitState, Task
from steelyard.identification.solve.fitted import Fitted
from steelyard.identification.solve.joint_fit import fit
from steelyard.identification.solve.misfits.disturbances import as_noise
from steelyard.identification.solve.misfits.outliers import look
from steelyard.identification.solve.settings import FitSettings


def cut(
    readings: Readings,
    begun: Beginning,
    task: Task,
    state: FitState,
    tell: Tell,
    vibrations: Mapping[str, FinerKnots],
    *,
    levels: bool = True,
) -> Fitted:
    """A fit, again without the readings that stand out of it, until none does or it does not
    arrive.
    """
    settings = readings.settings
    force_samples = tuple(each for each in task.force_samples if each is not None)
    contacts: Mapping[str, Sequence[tuple[float, float]]] = begun.touched
    spikes: Mapping[str, int] = {}
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
        if last or (not vibrations and vibrations_of(readings, fitted)):
            # What is to be followed more closely need not be looked at for what stands out of it.
            break
        fewer = without_standing_out(fitted, settings)
        if fewer is None:
            break
        force_samples, contacts, spikes = fewer.force_samples, fewer.contacts, fewer.spikes
    return fitted


def without_standing_out(fitted: Fitted, settings: FitSettings) -> Fitted | None:
    """Fitted without the force readings that stand out of it; None: none does."""
    state = fitted.fit.state
    looked = [
        look(
            at,
            forces,
            forces.sigmas(segment, state.factors),
            _cutting(fitted.task, segment.run, settings),
        )
        for segment, at, forces in zip(
            state.segments, fitted.balances, fitted.force_samples, strict=True
        )
    ]
    if not any(each.changed for each in looked):
        return None
    contacts = {run: list(each) for run, each in fitted.contacts.items()}
    spikes = dict(fitted.spikes)
    for segment, each in zip(state.segments, looked, strict=True):
        contacts.setdefault(segment.run, []).extend(each.contacts)
        spikes[segment.run] = spikes.get(segment.run, 0) + len(each.spikes)
    samples = tuple(each.force_samples for each in looked)
    return replace(fitted, force_samples=samples, contacts=contacts, spikes=spikes)


def cut_anew(readings: Readings, begun: Beginning, found: Fitted, tell: Tell) -> Fitted:
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
    given_back = tuple(replace(own, left_out=first.left_out) for own, first in pairs)
    task = replace(found.task, force_samples=given_back)
    again = cut(readings, begun, task, found.fit.state, tell, {})
    return seen_with_tensions(again, 0.0) if again.fit.converged else found


def without_touched(fitted: Fitted, settings: FitSettings) -> tuple[Fitted, bool]:
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
        limits = _cutting(task, segment.run, settings)
        looked = look(at, own, own.sigmas(segment, state.factors), limits)
        contacts.setdefault(segment.run, []).extend(looked.contacts)
        force_samples.append(replace(forces, left_out=looked.force_samples.left_out))
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


def _cutting(task: Task, run: str, settings: FitSettings) -> FitSettings:
    """What may be cut of a run: nothing of one in which something moves in the load, and pulls all
    along.
    """
    return replace(settings, most_cut=0.0) if task.experiment.moves_within(run) else settings


def joined_contacts(
    one: Mapping[str, Sequence[tuple[float, float]]],
    other: Mapping[str, Sequence[tuple[float, float]]],
) -> dict[str, list[tuple[float, float]]]:
    """Contacts of both, run by run."""
    return {
        run: list(dict.fromkeys([*one.get(run, ()), *other.get(run, ())]))
        for run in {**one, **other}
    }
