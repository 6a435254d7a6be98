"""What the motion instruments say along a segment, linearised and whitened: one statement for
kinematics, estimator and bound.

What each instrument measures is said by itself (:mod:`steelyard.instruments`); here it is looked at
where the motion of a segment is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.identification.model.border import Border, ByParameters, has_column
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
    CalibrationValues,
    clock_of,
)
from steelyard.identification.model.looked_at import Seen, looked_at, rate_along
from steelyard.identification.model.motion_segment import (
    Reading,
    Segment,
    holding_rows,
)
from steelyard.identification.model.processes import Process
from steelyard.identification.model.reading_times import reference_clocks
from steelyard.identification.model.segment import (
    POSE,
    Basis,
    Rows,
    spread,
)
from steelyard.identification.model.sources import Source
from steelyard.identification.model.tensions.followed import Carried, CorrectedTensions, stretching
from steelyard.identification.tally import Tally, robust_weight
from steelyard.instruments.equations import without_effect

AT_ONCE = 16384
"""Samples whose rows are held at once."""
_BESIDE = {"gravity": "gravity", "anchors": "anchor", "attachments": "attachment"}
"""What readings follow beside the terms of their instrument -> key among the errors of the
robot."""


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
    along = _Along(
        experiment, segment, calibration, column_of, references, factors, tally, carried, narrow
    )
    for reading in segment.readings:
        for start in range(0, len(reading.time), AT_ONCE):
            yield along.rows(reading, slice(start, start + AT_ONCE))
    held = holding_rows(segment)
    if tally is not None:
        tally.cost += float(np.sum(held.residual**2))
        tally.cost += segment.prior_cost
    yield held


@dataclass(frozen=True, eq=False)
class _Along:
    """The readings of a segment, looked at along its motion; fields as of
    :func:`motion_residuals`.
    """

    experiment: Experiment
    segment: Segment
    calibration: CalibrationValues
    column_of: NDArray[np.intp]
    references: Mapping[str, str]
    factors: Mapping[Source, float]
    tally: Tally | None
    carried: Carried | None
    narrow: bool
    seen: Seen = field(default_factory=Seen)
    """The motion where the readings before were looked at; is changed."""

    def rows(self, reading: Reading, part: slice) -> Rows:
        """Whitened rows of some samples of one quantity."""
        segment, label = self.segment, self.segment.label(*reading.source)
        sigma: float | Array = reading.sigma * self.factors.get(label, 1.0)
        followed = self._followed(reading, part, sigma)
        terms = self._terms(reading.source[0])
        asked = None
        if self.narrow:
            every = {**terms, **self._beside}.items()
            asked = frozenset(key for key, place in every if has_column(self.column_of, place))
        times, local, motion, linear = self._looked_at(reading, part, followed, asked)
        by: Sequence[Array] = [linear[f"by_{each}"] for each in ("pose", "rate", "acceleration")]
        # A channel without a number is no sample of it.
        there = np.isfinite(linear["residual"])
        found = linear["residual"] + segment.disturbance_of(reading.source, local)
        border = Border(self.column_of, *found.shape)
        by_processes: Array | None = None
        if followed is not None:
            slope, tensions = linear["by_tension"], followed.about
            changes = slope @ tensions.by_state
            by_processes = changes[:, :, POSE:]
            further = (tensions.by_rate, tensions.by_acceleration)
            changes_by = [changes[:, :, :POSE], *(slope @ each for each in further)]
            by = [own + more for own, more in zip(by, changes_by, strict=True)]
            border.extend(tensions.columns, slope @ tensions.by_border)
            sigma = followed.deviation(slope)
        residual, late = np.where(there, found, 0.0) / sigma, None
        if reading.late is not None and followed is None:
            late = _lateness_whitener(np.where(there, reading.late[part] / sigma, 0.0))
            residual = np.einsum("nij,nj->ni", late, residual)
        instrument = self.experiment.instruments[reading.source[0]]
        nothing = without_effect(instrument, reading.source[1], self.experiment.robot, asked)
        told = {key: each for key, each in linear.items() if key not in nothing}
        for place, derivative in chain(
            _by_terms(told, terms, asked),
            self._by_clocks(reading, local, by, motion),
            self._by_robot(told, asked),
        ):
            border.put(place, derivative)
        by_errors, columns = border.collected()
        # A clock that has moved may carry samples out of the segment.
        inside = there if segment.static else there & segment.holds(times)[:, None]
        weight = self._weight(reading, residual, inside)
        by_state = self._by_state(reading, by[0], by_processes)
        root, deviation = np.sqrt(weight), np.broadcast_to(sigma, residual.shape)[:, :, None]

        def whitened(jacobian: Array) -> Array:
            by_noise = jacobian / deviation
            return np.asarray(root[:, :, None] * (by_noise if late is None else late @ by_noise))

        return Rows(
            local.first,
            root * residual,
            spread(local, *(whitened(each) for each in (by_state, *by[1:])), block=segment.block),
            whitened(by_errors),
            columns,
            label,
        )

    def _followed(
        self, reading: Reading, part: slice, sigma: float | Array
    ) -> CorrectedTensions | None:
        """Tensions that the readings follow; None: they follow none, or those that are read."""
        if self.carried is None or not reading.follows:
            return None
        if reading.late is not None:
            sigma = np.hypot(sigma, reading.late[part])
        name, run = reading.source[0], self.segment.run
        pulling = stretching(self.carried, self.calibration, name, run, self.column_of)
        return CorrectedTensions(pulling, sigma)

    def _terms(self, name: str) -> Mapping[str, slice]:
        """Systematic errors of an instrument -> where they stand."""
        parameters = self.calibration.calibration_parameters
        return parameters.places_of(name, self.experiment.instruments[name], self.segment.run)

    @cached_property
    def _beside(self) -> Mapping[str, slice]:
        """What readings follow beside the terms of their instrument -> where it stands."""
        every = self.calibration.calibration_parameters.places
        keys = {key: (ROBOT, own, None) for key, own in _BESIDE.items()}
        return {key: every[own] for key, own in keys.items() if own in every}

    def _looked_at(
        self,
        reading: Reading,
        part: slice,
        followed: CorrectedTensions | None,
        asked: frozenset[str] | None,
    ) -> tuple[Array, Basis, tuple[Array, Array, Array, Array], Mapping[str, Array]]:
        """See :func:`looked_at`; lengths about tensions that go with them, as forces are about
        theirs.
        """
        look = partial(
            looked_at,
            self.experiment,
            self.segment,
            reading,
            part,
            self.calibration,
            self.references,
            followed,
            self.seen,
            asked,
        )
        times, local, motion, linear = look()
        if followed is not None and followed.correct(linear):
            *_, linear = look()
            linear = followed.as_carried(linear)
        return times, local, motion, linear

    def _by_robot(self, linear: Mapping[str, Array], asked: frozenset[str] | None) -> ByParameters:
        """By gravity and the geometry of the robot; arguments as of :func:`_by_terms`."""
        for key, place in self._beside.items():
            if (asked is None or key in asked) and f"by_{key}" in linear:
                yield place, linear[f"by_{key}"]

    def _by_clocks(
        self, reading: Reading, local: Basis, by: Sequence[Array], motion: Sequence[Array]
    ) -> ByParameters:
        """By delays of clocks and by the latency.

        Args:
            reading: Which.
            local: Spline functions at its times.
            by: Derivatives by pose, rate and acceleration, shape (n, k, 7) each.
            motion: See :func:`.rate_along`.
        """
        segment, name = self.segment, reading.source[0]
        parameters = self.calibration.calibration_parameters
        own = clock_of(self.experiment, name)
        reference = self.references.get(own, own)
        latency = parameters.place_of_latency(name)
        if latency is not None and not has_column(self.column_of, latency):
            latency = None
        if segment.static or (reference == own and latency is None):
            return
        # A later clock looks at an earlier instant of the motion.
        by_delay = -rate_along(by, motion)
        by_delay = by_delay - segment.disturbance_of(reading.source, local, 1)
        by_delay = by_delay[:, :, None]
        if reference != own:
            yield parameters.place(own, "delay", segment.run), by_delay
            yield parameters.place(reference, "delay", segment.run), -by_delay
        if latency is not None:
            yield latency, by_delay

    def _weight(self, reading: Reading, residual: Array, inside: NDArray[np.bool_]) -> Array:
        """Of each number, or of each sample of which a spike takes all, shape (n, k) or (n, 1);
        counted.

        Args:
            reading: Which.
            residual: White, shape (n, k).
            inside: Whether each number counts, shape (n, k).
        """
        if reading.values.ndim == 3:
            size, each = np.sqrt(np.sum(residual**2, axis=1, keepdims=True)), residual.shape[1]
            weight = inside[:, :1] * robust_weight(size, each)
        else:
            # A spike in one channel leaves the others as they are.
            size, each = np.abs(residual), 1
            weight = inside * robust_weight(size, each)
        if self.tally is not None:
            self.tally.add(self.segment.label(*reading.source), size, weight, each)
        return weight

    def _by_state(self, reading: Reading, by_pose: Array, by_processes: Array | None) -> Array:
        """Derivative by the pose and by all processes, shape (n, k, block), or (n, k, 7) where
        these are of no account.

        Args:
            reading: Which.
            by_pose: Shape (n, k, 7).
            by_processes: Through tensions, shape (n, k, block - 7); None: none.
        """
        block = self.segment.block
        if processes := self.segment.processes_of(reading.source):
            by_pose = _with_processes(by_pose, processes, block)
        if by_processes is None or not by_processes.shape[2]:
            return by_pose
        whole = np.zeros((*by_pose.shape[:2], block))
        whole[:, :, : by_pose.shape[2]] = by_pose
        whole[:, :, POSE:] += by_processes
        return whole


def _by_terms(
    linear: Mapping[str, Array], terms: Mapping[str, slice], asked: frozenset[str] | None
) -> ByParameters:
    """By the systematic errors of an instrument.

    Args:
        linear: The linearised difference of readings, without derivatives that are nothing.
        terms: Where these errors stand.
        asked: By what there are derivatives; None: by all.
    """
    if "by_errors" not in linear:
        return
    column = 0
    for key, place in terms.items():
        if asked is not None and key not in asked:
            continue
        size = place.stop - place.start
        yield place, linear["by_errors"][:, :, column : column + size]
        column += size


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
    """Derivative by the pose and by processes that are added to the reading, shape (n, k,
    block).
    """
    n, k, _ = by_pose.shape
    found = np.zeros((n, k, block))
    found[:, :, :POSE] = by_pose
    for process, place in processes:
        found[:, :, place] = np.diag(process.sizes)
    return found
