"""Lengths seen with the stretch and the sag that cables have by the tensions of a fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from steelyard.identification.model.reading_times import reference_clocks, time_of
from steelyard.identification.solve.fitted import Fitted
from steelyard.identification.solve.joint_fit import fit
from steelyard.identification.solve.misfits.undisturbed_swings import slowly


def with_tensions(fitted: Fitted) -> Fitted:
    """With the stretch and the sag of cables, where lengths are read, by tensions as they are by
    now: at first they are those of the readings, with all their gains and offsets; the very same
    where no instrument looks at them. Where cables stretch, lengths follow the tensions from here
    on.
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


def seen_with_tensions(fitted: Fitted, least: float) -> Fitted:
    """Fitted again, lengths being seen with tensions as they are by now; the very same where none
    has moved by more than a part of the usual one.
    """
    followed = with_tensions(fitted)
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
