"""What the motion instruments say along a segment, linearised and whitened: one statement for
kinematics, estimator and bound.

What each instrument measures is said by itself (:mod:`steelyard.instruments`); here it is looked at
where the motion of a segment is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
    CalibrationParameters,
    CalibrationValues,
    clock_of,
)
from steelyard.identification.model.followed_tensions import Carried, CorrectedTensions, stretching
from steelyard.identification.model.motion_segment import (
    Reading,
    Segment,
    holding_rows,
)
from steelyard.identification.model.processes import Process
from steelyard.identification.model.segment import (
    POSE,
    Basis,
    Rows,
    motion_at,
    spread,
)
from steelyard.identification.model.sources import Source
from steelyard.identification.tally import Tally, robust_weight
from steelyard.instruments.base import TIME_CONSTANT
from steelyard.instruments.equations import linearised, without_effect

AT_ONCE = 16384
"""Samples whose rows are held at once."""
_BESIDE = {"gravity": "gravity", "anchors": "anchor", "attachments": "attachment"}
"""What readings follow beside the terms of their instrument -> key among the errors of the robot."""


def motion_residuals(
    experiment: Experiment,
    segment: Segment,
    calibration: CalibrationValues,
    column_of: NDArray[np.intp],
    factors: Mapping[Source, float],
    tally: Tally | None,
    carried: Carried | None = None,
    *,
    narrow: bool = False,
) -> Iterator[Rows]:
    """Whitened readings of a segment, then what holds the motion where no instrument does.

    Args:
        experiment: With its instruments.
        segment: With readings and present motion.
        calibration: Present values of the systematic errors.
        column_of: Column of each systematic error in the border; -1: not there; shape (u,).
        factors: Quantity -> by how much its noise exceeds what the reading says.
        tally: Is added to; None: nothing is counted.
        carried: Tensions of the cables as all that is fitted has them, for readings that follow
            these; None: they are those of the readings, taken as known.
        narrow: Whether expressions without the derivatives by what has no column are used: to build
            these takes as long as they save in some ten seconds of recording.
    """
    calibration_parameters = calibration.calibration_parameters
    references = reference_clocks(experiment, calibration_parameters, segment)
    seen = Seen()
    for reading in segment.readings:
        for start in range(0, len(reading.time), AT_ONCE):
            yield _of_reading(
                experiment,
                segment,
                reading,
                slice(start, start + AT_ONCE),
                calibration,
                column_of,
                references,
                factors,
                tally,
                carried,
                seen,
                narrow,
            )
    held = holding_rows(segment)
    if tally is not None:
        tally.cost += float(np.sum(held.residual**2))
        tally.cost += segment.prior_cost
    yield held


def time_of(
    experiment: Experiment,
    segment: Segment,
    calibration: CalibrationValues,
    references: Mapping[str, str],
    name: str,
    time: Array,
) -> tuple[Array, slice, slice]:
    """Times of an instrument's samples within a segment [s], and where the delays of its clock and of
    the reference stand.

    The motion is told in the time of one of the clocks that it was recorded by.
    """
    calibration_parameters = calibration.calibration_parameters
    own = clock_of(experiment, name)
    reference = segment.reference or references.get(own, next(iter(references.values()), own))
    clock, origin = (
        calibration_parameters.place(each, "delay", segment.run) for each in (own, reference)
    )
    delay = (
        calibration.values[clock] - calibration.values[origin] + calibration_parameters.mean[origin]
    )
    places = calibration_parameters.places
    filtered = places.get(
        (name, TIME_CONSTANT, segment.run), places.get((name, TIME_CONSTANT, None))
    )
    # A filtered force says what was a while ago, and so does what comes over a slow link.
    for place in (filtered, calibration_parameters.place_of_latency(name)):
        if place is not None:
            delay = delay + calibration.values[place]
    return time - delay[0], clock, origin


def has_column(column_of: NDArray[np.intp], place: slice) -> bool:
    """Whether any of some systematic errors is in the border.

    Args:
        column_of: Column of each systematic error in the border; -1: not there; shape (u,).
        place: Of these.
    """
    return max(column_of[place].tolist(), default=-1) >= 0


class Border:
    """Derivatives by some of the border parameters, collected column by column."""

    def __init__(self, column_of: NDArray[np.intp], n: int, k: int) -> None:
        self._column_of, self._n, self._k = column_of, n, k
        self._columns: list[NDArray[np.intp]] = []
        self._values: list[Array] = []

    def put(self, place: slice | NDArray[np.intp], derivative: Array) -> None:
        """Derivative by systematic errors, shape (n, k, c); those that have no column are left
        out.
        """
        columns = self._column_of[place]
        use = columns >= 0
        if not use.any():
            return
        whole = (self._n, self._k, len(columns))
        if derivative.shape != whole:
            derivative = np.broadcast_to(derivative, whole)
        every = bool(use.all())
        self._columns.append(columns if every else columns[use])
        self._values.append(derivative if every else derivative[:, :, use])

    def extend(self, columns: NDArray[np.intp], derivative: Array) -> None:
        """Derivative by border parameters that are no systematic errors."""
        self._columns.append(columns)
        self._values.append(derivative)

    def collected(self) -> tuple[Array, NDArray[np.intp]]:
        """Derivatives, shape (n, k, c), and their columns, each once, shape (c,)."""
        if not self._columns:
            return np.zeros((self._n, self._k, 0)), np.zeros(0, dtype=np.intp)
        columns = np.concatenate(self._columns)
        unique = np.unique(columns)
        if len(unique) == len(columns):
            return np.concatenate(self._values, axis=2), columns
        # Few stand there twice: delays of two clocks that are one.
        found = np.zeros((self._n, self._k, len(unique)))
        for own, values in zip(self._columns, self._values, strict=True):
            place = np.searchsorted(unique, own)
            if len(own) and np.all(np.diff(place) == 1):
                found[:, :, place[0] : place[-1] + 1] += values
            else:
                for column, each in zip(place, np.moveaxis(values, 2, 0), strict=True):
                    found[:, :, column] += each
        return found, unique


class Seen:
    """The motion of a segment at the times at which it was looked at last: the quantities of one
    instrument are read together.
    """

    def __init__(self) -> None:
        self._segment: Segment | None = None
        self._times = np.empty(0)

    def at(self, segment: Segment, times: Array) -> tuple[Basis, tuple[Array, Array, Array, Array]]:
        """Spline functions at times, and the motion there; see :func:`.motion_at`.

        Args:
            segment: With its motion.
            times: Within it [s], shape (n,).
        """
        if self._segment is not segment or not np.array_equal(self._times, times):
            self._segment, self._times = segment, times
            self._local = segment.basis(times)
            self._motion = motion_at(self._local, segment.coefficients)
        return self._local, self._motion


def looked_at(
    experiment: Experiment,
    segment: Segment,
    reading: Reading,
    part: slice,
    calibration: CalibrationValues,
    references: Mapping[str, str],
    carried: Carried | None = None,
    seen: Seen | None = None,
    asked: frozenset[str] | None = None,
) -> tuple[Array, Basis, tuple[Array, Array, Array, Array], Mapping[str, Array]]:
    """Readings against the motion: their times within the segment [s], the spline there, the motion,
    and the linearised difference.

    See :func:`steelyard.instruments.equations.linearised` for the last.

    Args:
        experiment: With its instruments.
        segment: With its present motion.
        reading: Within it.
        part: Of its samples.
        calibration: Present values of the systematic errors.
        references: See :func:`reference_clocks`.
        carried: See :func:`motion_residuals`.
        seen: The motion where the readings before were looked at; is changed.
        asked: By what there are derivatives, see :func:`.difference_of`; None: by all.
    """
    name, quantity = reading.source
    instrument = experiment.instruments[name]
    times = reading.time[part]
    if not segment.static:
        times, *_ = time_of(experiment, segment, calibration, references, name, times)
    local, motion = (Seen() if seen is None else seen).at(segment, times)
    errors = list(calibration.of(name, instrument, segment.run).values())
    tension = None if reading.tension is None else reading.tension[part]
    if carried is not None and reading.follows:
        tension = carried(times).values
    linear = linearised(
        instrument,
        quantity,
        experiment.robot,
        reading.values[part],
        motion[:3],
        np.concatenate(errors) if errors else np.zeros(1),
        calibration.gravity,
        tension,
        calibration.geometry,
        asked,
    )
    return times, local, motion, linear


def rate_along(by: Sequence[Array], motion: Sequence[Array]) -> Array:
    """By how much something changes in a second as the platform moves, shape (n, k).

    Args:
        by: Its derivatives by pose, rate and acceleration, shape (n, k, 7) each.
        motion: Pose and its first three time derivatives, shape (n, 7) each.
    """
    parts = [np.einsum("nki,ni->nk", j, rate) for j, rate in zip(by, motion[1:], strict=True)]
    return np.asarray(sum(parts))


def _of_reading(
    experiment: Experiment,
    segment: Segment,
    reading: Reading,
    part: slice,
    calibration: CalibrationValues,
    column_of: NDArray[np.intp],
    references: Mapping[str, str],
    factors: Mapping[Source, float],
    tally: Tally | None,
    carried: Carried | None,
    seen: Seen,
    narrow: bool,
) -> Rows:
    """Whitened rows of some samples of one quantity."""
    calibration_parameters = calibration.calibration_parameters
    name, _ = reading.source
    instrument = experiment.instruments[name]
    label = segment.label(*reading.source)
    sigma: float | Array = reading.sigma * factors.get(label, 1.0)
    followed: CorrectedTensions | None = None
    if carried is not None and reading.follows:
        if reading.late is not None:
            sigma = np.hypot(sigma, reading.late[part])
        pulling = stretching(carried, calibration, name, segment.run, column_of)
        followed = CorrectedTensions(pulling, sigma)
    places = calibration_parameters.places_of(name, instrument, segment.run)
    every = calibration_parameters.places
    beside = {
        key: every[ROBOT, own, None] for key, own in _BESIDE.items() if (ROBOT, own, None) in every
    }
    asked = None
    if narrow:
        asked = frozenset(
            key for key, place in {**places, **beside}.items() if has_column(column_of, place)
        )
    times, local, motion, linear = looked_at(
        experiment, segment, reading, part, calibration, references, followed, seen, asked
    )
    if followed is not None and followed.correct(linear):
        # Linearised about tensions that go with the lengths, as the forces are about theirs.
        *_, linear = looked_at(
            experiment, segment, reading, part, calibration, references, followed, seen, asked
        )
        linear = followed.as_carried(linear)
    by = (linear["by_pose"], linear["by_rate"], linear["by_acceleration"])
    # A channel without a number is no sample of it.
    there = np.isfinite(linear["residual"])
    found = linear["residual"]
    n, k = found.shape
    processes = segment.processes_of(reading.source)
    found = found + segment.disturbance_of(reading.source, local)
    residual = np.where(there, found, 0.0) / sigma
    border = Border(column_of, n, k)
    by_processes: Array | None = None
    if followed is not None:
        slope, tensions = linear["by_tension"], followed.about
        changes = slope @ tensions.by_state
        by_processes = changes[:, :, POSE:]
        by = (
            by[0] + changes[:, :, :POSE],
            by[1] + slope @ tensions.by_rate,
            by[2] + slope @ tensions.by_acceleration,
        )
        border.extend(tensions.columns, slope @ tensions.by_border)
        sigma = followed.deviation(slope)
        residual = np.where(there, found, 0.0) / sigma
    late = None
    if reading.late is not None and followed is None:
        late = _lateness_whitener(np.where(there, reading.late[part] / sigma, 0.0))
        residual = np.einsum("nij,nj->ni", late, residual)
    nothing = without_effect(instrument, reading.source[1], experiment.robot, asked)
    column = 0
    if "by_errors" not in nothing:
        for key, place in places.items():
            if asked is not None and key not in asked:
                continue
            size = place.stop - place.start
            border.put(place, linear["by_errors"][:, :, column : column + size])
            column += size
    own = clock_of(experiment, name)
    reference = references.get(own, own)
    latency = calibration_parameters.place_of_latency(name)
    if latency is not None and not has_column(column_of, latency):
        latency = None
    if not segment.static and (reference != own or latency is not None):
        # A later clock looks at an earlier instant of the motion.
        by_delay = -rate_along(by, motion)
        by_delay = by_delay - segment.disturbance_of(reading.source, local, 1)
        by_delay = by_delay[:, :, None]
        if reference != own:
            clock, origin = (
                calibration_parameters.place(each, "delay", segment.run)
                for each in (own, reference)
            )
            border.put(clock, by_delay)
            border.put(origin, -by_delay)
        if latency is not None:
            border.put(latency, by_delay)
    for key, place in beside.items():
        if (asked is None or key in asked) and f"by_{key}" not in nothing:
            border.put(place, linear[f"by_{key}"])
    by_errors, columns = border.collected()
    # A clock that has moved may carry samples out of the segment.
    inside = there if segment.static else there & segment.holds(times)[:, None]
    if reading.values.ndim == 3:
        size, each = np.sqrt(np.sum(residual**2, axis=1, keepdims=True)), k
        weight = inside[:, :1] * robust_weight(size, each)
    else:
        # A spike in one channel leaves the others as they are.
        size, each = np.abs(residual), 1
        weight = inside * robust_weight(size, each)
    if tally is not None:
        tally.add(label, size, weight, each)
    by_state = by
    if processes:
        by_state = _with_processes(by[0], processes, segment.block), *by[1:]
    if by_processes is not None and by_processes.shape[2]:
        whole = np.zeros((n, k, segment.block))
        whole[:, :, : by_state[0].shape[2]] = by_state[0]
        whole[:, :, POSE:] += by_processes
        by_state = whole, *by[1:]
    root, deviation = np.sqrt(weight), np.broadcast_to(sigma, residual.shape)[:, :, None]

    def whitened(jacobian: Array) -> Array:
        by_noise = jacobian / deviation
        return np.asarray(root[:, :, None] * (by_noise if late is None else late @ by_noise))

    return Rows(
        local.first,
        root * residual,
        spread(local, *(whitened(each) for each in by_state), block=segment.block),
        whitened(by_errors),
        columns,
        label,
    )


def _lateness_whitener(late: Array) -> Array:
    """What makes noise white that all channels of a sample share, beside noise of their own: one
    stamp is late for all of them, so that only one direction of them is worse known.

    Args:
        late: What one 1-sigma of it makes of each channel, in 1-sigma of their own noise, shape
            (n, k).

    Returns:
        The symmetric inverse root of I + u u^T for each sample's u, shape (n, k, k).
    """
    square = np.sum(late**2, axis=1)[:, None, None]
    outer = late[:, :, None] * late[:, None, :] / np.maximum(square, 1e-300)
    return np.asarray(np.eye(late.shape[1]) - (1 - 1 / np.sqrt(1 + square)) * outer)


def _with_processes(
    by_pose: Array, processes: Iterable[tuple[Process, slice]], block: int
) -> Array:
    """Derivative by the pose and by processes that are added to the reading, shape (n, k, block)."""
    n, k, _ = by_pose.shape
    found = np.zeros((n, k, block))
    found[:, :, :POSE] = by_pose
    for process, place in processes:
        found[:, :, place] = np.diag(process.sizes)
    return found


def reference_clocks(
    experiment: Experiment, calibration_parameters: CalibrationParameters, segment: Segment
) -> dict[str, str]:
    """Clock -> clock whose time the motion is told in, the best known one of those that can be
    compared.

    Motion and all clocks moved together read the same. Without a reference the knots, which stay,
    would seem to tell the time.
    """
    if segment.static:
        return {}
    if segment.reference is not None:
        # Where forces feel all of the motion, they tell its time.
        return {
            clock_of(experiment, reading.source[0]): segment.reference
            for reading in segment.readings
        }
    rotating, moving = dict[str, None](), dict[str, str]()
    for name, quantity in (reading.source for reading in segment.readings):
        clock = clock_of(experiment, name)
        instrument = experiment.instruments[name]
        if instrument.quantity(quantity, experiment.robot.m).determines == ("position",):
            moving[name] = clock
        else:
            rotating[clock] = None
    # Place and acceleration are compared, and attitude with both; one of them alone fits any
    # attitude.
    alone = len(moving) == 1 and not rotating.keys() & set(moving.values())
    groups = (
        [rotating.keys(), set(moving.values())]
        if alone
        else [dict.fromkeys([*rotating, *moving.values()]).keys()]
    )

    def known(clock: str) -> float:
        return float(
            calibration_parameters.deviation[
                calibration_parameters.place(clock, "delay", segment.run)
            ][0]
        )

    return {clock: min(group, key=known) for group in groups for clock in group}
