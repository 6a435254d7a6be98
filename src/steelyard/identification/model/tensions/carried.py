"""Tensions by which cables stretch, where readings of the forces follow the motion: those that
carry the moving body, and how they follow all that is fitted.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance import (
    Forces,
    balance_times,
    part_of,
)
from steelyard.identification.model.balance.linearised import BalancePoint, point_of
from steelyard.identification.model.balance.linearised_in_time import delays, place_of_filter
from steelyard.identification.model.balance.slopes import AROUND, slopes
from steelyard.identification.model.border import Border
from steelyard.identification.model.calibration_parameters import (
    DRAG,
    ROBOT,
    CalibrationValues,
)
from steelyard.identification.model.motion_segment import CarriedTensions, Segment
from steelyard.identification.model.segment import (
    POSE,
)
from steelyard.identification.model.sources import Source
from steelyard.identification.model.tensions.followed import Carried
from steelyard.inertia import TEN


def carried_tensions(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces | None,
    calibration: CalibrationValues,
    column_of: NDArray[np.intp],
    parameters: Array | None,
    factors: Mapping[Source, float],
    *,
    narrow: bool = False,
) -> Carried | None:
    """Tensions by which cables stretch: those of the readings, corrected so that they carry the
    moving body, and how they follow all that is fitted; None: no reading follows them.

    Readings r give tensions t and leave the wrench w of the balance over; the least correction of
    the readings takes K w from the tensions, so that t - K w changes with t and with w. What is
    left of the noise of r in t - K w is independent of w, which tells the body.

    Args:
        experiment: With robot and instruments.
        segment: With its motion.
        force_samples: Force readings within it; None: not looked at.
        calibration: Present values of the systematic errors.
        column_of: Column of each systematic error in the border; -1: not there; shape (u,).
        parameters: Of the body, whose ten columns are the first of the border, shape (10,); None:
            forces are not looked at.
        factors: Quantity -> by how much its noise exceeds what the readings say.
        narrow: See :func:`.motion_residuals`.
    """
    if not any(each.follows for each in segment.readings):
        return None
    if force_samples is None or parameters is None:
        return None
    forces, body = force_samples, parameters

    def at_times(times: Array) -> CarriedTensions:
        whole = balance_times(experiment, segment, forces, calibration)
        around = 0.0 if segment.static else AROUND
        first, last = np.searchsorted(whole, [times.min() - around, times.max() + around])
        own = slice(max(0, int(first) - 1), int(last) + 2)
        part = part_of(experiment, segment, forces, calibration, own)
        asked = column_of if narrow else None
        point = point_of(experiment, segment, part, calibration, body, factors, asked)
        return _interpolated(_carried_of(point, column_of, body), point.at.time, times)

    return at_times


def _carried_of(
    point: BalancePoint, column_of: NDArray[np.intp], parameters: Array
) -> CarriedTensions:
    """Tensions at the times of the force readings."""
    at, forces = point.at, point.force_samples
    n, m = at.measured.values.shape
    touched, unread = forces.touched, forces.guessed
    # Where something touches the platform, the readings know and the balance does not.
    sigmas = np.where(touched[:, None], forces.sigma, at.sigmas)
    by_reading = np.broadcast_to(at.measured.by_reading, (n, *at.measured.by_reading.shape[1:]))
    shares = at.noise.shares[:, :, : at.noise.readings].transpose(0, 2, 1)
    corrections = sigmas[:, :, None] * (shares @ at.whitener)
    if unread.any():
        corrections[:, unread] = at.noise.pulled
    K = by_reading @ corrections
    K[touched] = 0.0
    # Cables stretch by the tensions before the filter.
    left_over = at.left_over if at.off is None else at.left_over - at.off
    values = np.asarray(at.measured.values - np.einsum("nkj,nj->nk", K, left_over))

    def following_balance(change: Array) -> Array:
        return -K @ change

    by = point.by_motion()
    by_state = following_balance(point.by_state(by[0]))
    by_rate, by_acceleration = (following_balance(each) for each in by[1:])
    moved = point.followed_by_readings()
    if moved is not None:
        by_state[:, :, :POSE] += moved[0]
        by_rate = by_rate + moved[1]
    for each, place, own in point.of_readings():
        by_state[:, :, place] -= by_reading[:, :, own] * each.sizes
    border, gains = Border(column_of, n, m), Border(column_of, n, m)
    border.extend(np.arange(TEN), following_balance(point.by_body(parameters)))
    terms = list(point.terms_of_readings(at.asked))
    for place, own_gain in point.by_gains(terms):
        gains.put(place, own_gain)
    for place, change in terms:
        by_wrench = at.measured.changes_of_wrench(change)
        border.put(place, change + following_balance(by_wrench))
    for place, derivative in point.by_robot():
        border.put(place, following_balance(derivative))
    kept = np.eye(m) + following_balance(at.measured.changes_of_wrench(np.eye(m)[None]))
    rate, bend, feed = _changes(point, values)
    if not point.segment.static:
        # The motion tells what carries the body at a given time. Beside that pulls what is read
        # then,
        # which is another reading where clocks have another delay.
        later = kept @ rate[:, :, None]
        for place, sign in delays(point):
            border.put(place, sign * later)
        if (of_filter := place_of_filter(point)) is not None:
            border.put(of_filter, later)
    drag = point.calibration.calibration_parameters.places[ROBOT, DRAG, None]
    if not point.segment.static and point.asks(drag):
        border.put(drag, following_balance(point.derivatives["by_drag"][:, :, None]))
    by_border, columns = border.collected()
    noise = np.zeros((n, m, at.noise.parts.shape[2]))
    noise[:, :, : at.noise.readings] = by_reading * np.where(unread, 0.0, sigmas)[:, None, :]
    noise += following_balance(at.noise.parts)
    return CarriedTensions(
        values,
        by_state,
        by_rate,
        by_acceleration,
        by_border,
        columns,
        noise,
        kept,
        *gains.collected(),
        rate,
        bend,
        feed,
    )


def _changes(point: BalancePoint, tension: Array) -> tuple[Array, Array, Array]:
    """How fast tensions change [N/s], how fast that does [N/s^2], and how fast they would change if
    what is fed left the stretch as it is [N/s], shape (n, m) each; none at rest.
    """
    if point.segment.static:
        still = np.zeros_like(tension)
        return still, still, still
    at, geometry = point.at, point.calibration.geometry
    anchors, attachments = (geometry[f"{key}s"].reshape(-1, 3) for key in ("anchor", "attachment"))
    turned = np.einsum("nij,mj->nmi", at.motion["rotation"], attachments)
    length = np.linalg.norm(anchors - at.motion["position"][:, None] - turned, axis=2)
    rate = slopes(at.time, tension)
    return rate, slopes(at.time, rate), tension * slopes(at.time, length) / length


def _interpolated(found: CarriedTensions, own: Array, times: Array) -> CarriedTensions:
    """At other times, linearly; before the first and after the last they are as at these, and do
    not follow the motion: what it does there does not change them.

    Readings that are more than the tensions have their noise in common: its variance counts as
    often as that.
    """
    left = np.clip(np.searchsorted(own, times, side="right") - 1, 0, max(0, len(own) - 2))
    right = np.minimum(left + 1, len(own) - 1)
    step = np.where(right > left, own[right] - own[left], 1.0)
    share = (times - own[left]) / step
    inside = (share >= 0.0) & (share <= 1.0) | (len(own) == 1)
    share = np.clip(share, 0.0, 1.0)

    def between(values: Array) -> Array:
        weight = share.reshape(-1, *([1] * (values.ndim - 1)))
        return np.asarray(values[left] * (1 - weight) + values[right] * weight)

    def by_motion(values: Array) -> Array:
        return between(values) * inside.reshape(-1, *([1] * (values.ndim - 1)))

    return CarriedTensions(
        between(found.values),
        by_motion(found.by_state),
        by_motion(found.by_rate),
        by_motion(found.by_acceleration),
        between(found.by_border),
        found.columns,
        between(found.noise) * np.sqrt(max(1.0, len(times) / len(own))),
        between(found.kept),
        between(found.by_gain),
        found.gains,
        by_motion(found.rate),
        by_motion(found.bend),
        by_motion(found.feed),
    )
