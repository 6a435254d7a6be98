"""What the motion instruments say along a segment, linearised and whitened: one statement for
kinematics, estimator and bound.

A segment is a stretch of a run with one motion, a spline in time, or a set of poses at rest. Its
smoothness, where it has one, is a proper prior: the third derivative is white noise of an intensity
that the data tell [Wahba1978]_, so that a spline of many knots is no freer than the motion is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.estimates.quantiles import chi2_quantile, chi2_tail, poisson_tail
from steelyard.experiment.model import Experiment
from steelyard.identification.banded import banded_product
from steelyard.identification.model.calibration_parameters import (
    ROBOT,
    CalibrationParameters,
    CalibrationValues,
    clock_of,
)
from steelyard.identification.model.processes import Process, embedded
from steelyard.identification.model.processes import places as places_of
from steelyard.identification.model.segment import (
    POSE,
    Basis,
    NormalEquations,
    Rows,
    accumulate,
    at_rest,
    basis,
    motion_at,
    quadrature,
    spread,
    values_at,
)
from steelyard.identification.model.sources import Source
from steelyard.instruments.base import TIME_CONSTANT
from steelyard.instruments.equations import linearised, without_effect
from steelyard.smoothing import DEGREE

PARTS = {"position": slice(0, 3), "rotation": slice(3, POSE)}
"""Parts of a pose that have a smoothness of their own."""
AT_REST = " at rest"
"""What the name of a quantity ends with where poses at rest are meant."""
_UNIT = 0.01
"""How loosely the length of the quaternion is held near one; nothing depends on it."""
_PLACE, _SPEED = 100.0, 10.0
"""1-sigma of where a platform may be [m] and how fast it may move [m/s], where no instrument tells:
it does not fly away."""
_FAR = 1e-4
"""Probability of a number that counts no more than noise may reach [Huber1964]_."""
_SURELY = 1e-3
"""Probability below which what stands far is not the end of the noise."""
_JERK_NODES = 3
"""Of the quadrature between two knots: exact for squares of what is quadratic there."""
AT_ONCE = 16384
"""Samples whose rows are held at once."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Samples of one quantity of one instrument within a segment."""

    source: Source
    time: Array
    """By the instrument's clock, moved to the common event: common time plus delay [s]; of poses at
    rest their number; shape (n,)."""
    values: Array
    sigma: float
    """1-sigma per sample and axis."""
    tension: Array | None = None
    """Of the cables [N], for instruments that look at these too, shape (n, m)."""
    late: Array | None = None
    """1-sigma that time stamps which scatter add to each number, shape (n, k); None: none."""
    follows: bool = False
    """Whether these tensions are those of :class:`CarriedTensions` wherever forces are fitted, so
    that all which is uncertain about them is in the lengths too."""


@dataclass(frozen=True, eq=False)
class CarriedTensions:
    """Tensions of the cables at n times, as corrected force readings and the moving body have them,
    and how they follow all that is fitted.
    """

    values: Array
    """[N], shape (n, m)."""
    by_state: Array
    """Derivative by pose and processes, shape (n, m, block)."""
    by_rate: Array
    """Shape (n, m, 7)."""
    by_acceleration: Array
    """Shape (n, m, 7)."""
    by_border: Array
    """Derivative by some border parameters, shape (n, m, c)."""
    columns: NDArray[np.intp]
    """Which these are, shape (c,)."""
    variance: Array
    """What noise of the force readings leaves of them [N^2], shape (n, m)."""


Carried = Callable[[Array], CarriedTensions]
"""From times within a segment [s], shape (n,)."""


@dataclass(frozen=True, eq=False)
class Segment:
    """A stretch of a run with one spline, or its poses at rest."""

    run: str
    knots: Array
    """Of the spline [s]; of poses at rest their numbers."""
    readings: tuple[Reading, ...]
    coefficients: Array
    """Of the pose, and of processes beside it, shape (f, 7) or (f, block)."""
    smoothness: Mapping[str, float] | None = None
    """Part of the pose (see :data:`PARTS`) -> intensity of the white noise in its third derivative
    [m^2/s^5], [1/s^5], of the parts that are held smooth; None: no prior."""
    looser: Mapping[str, float] = field(default_factory=dict)
    """Part of the pose -> by how much that intensity exceeds the likeliest; 1 where nothing is
    said, see :mod:`.smoothness`."""
    static: bool = False
    placed: bool = True
    """Whether an instrument tells the place; else accelerations alone tell the translation."""
    reference: str | None = None
    """Clock in whose time the motion is told; None: one of those that recorded it, see
    :func:`reference_clocks`."""
    jerks: Mapping[str, Array] = field(default_factory=dict)
    """Part of the pose -> :func:`jerk_matrices` of its knots, where it has a smoothness."""
    processes: tuple[Process, ...] = ()
    """Disturbances along it, whose coefficients stand behind those of the pose."""

    def label(self, name: str, quantity: str) -> Source:
        """Under which the noise of a quantity is kept: at rest instruments are quieter than in
        motion.
        """
        return (name, quantity + AT_REST) if self.static else (name, quantity)

    @property
    def width(self) -> int:
        """Coefficients that one instant depends on."""
        return self.block if self.static else self.block * (DEGREE + 1)

    @property
    def block(self) -> int:
        """Coefficients of one spline function."""
        return int(self.coefficients.shape[1])

    @cached_property
    def process_places(self) -> Mapping[Source, slice]:
        """What the processes disturb -> where its coefficients stand in those of a function."""
        return places_of(self.processes)

    def processes_of(self, source: Source) -> list[tuple[Process, slice]]:
        """The processes that disturb a quantity, and where their coefficients stand in those of a
        function.
        """
        return [
            (each, self.process_places[each.source])
            for each in self.processes
            if each.disturbs == source
        ]

    def disturbance_of(self, source: Source, local: Basis, order: int = 0) -> Array | float:
        """By how much a quantity is disturbed, or a derivative of that by time, in SI units, shape
        (n, p); 0 where nothing does.

        Args:
            source: Owner and quantity.
            local: Spline functions at n times.
            order: Of the derivative.
        """
        return sum(
            (self.disturbance(each, local, order) for each, _ in self.processes_of(source)),
            start=0.0,
        )

    @property
    def span(self) -> tuple[float, float]:
        """Where its spline begins and ends [s]."""
        return float(self.knots[DEGREE]), float(self.knots[-DEGREE - 1])

    def disturbance(self, process: Process, local: Basis, order: int = 0) -> Array:
        """One of its processes, or a derivative of it by time, in SI units, shape (n, p).

        Args:
            process: One of them.
            local: Spline functions at n times.
            order: Of the derivative.
        """
        own = self.coefficients[:, self.process_places[process.source]]
        return np.asarray(process.sizes * values_at(local, own, order))

    def disturbed(self, processes: tuple[Process, ...]) -> Segment:
        """The same motion with these processes beside it; those that it has not had are nothing yet."""
        count = sum(each.components for each in processes)
        coefficients = np.zeros((len(self.coefficients), POSE + count))
        coefficients[:, :POSE] = self.coefficients[:, :POSE]
        for source, place in places_of(processes).items():
            if source in self.process_places:
                coefficients[:, place] = self.coefficients[:, self.process_places[source]]
        jerks = self.jerks
        if jerks and POSE + count != self.block:
            jerks = jerk_matrices(self.knots, POSE + count)
        return replace(self, coefficients=coefficients, jerks=jerks, processes=processes)

    def equations(self, border: int, rows: Iterable[Rows]) -> NormalEquations:
        """Normal equations of rows along it.

        Args:
            border: Number of border parameters.
            rows: All there are.
        """
        functions = len(self.coefficients)
        return accumulate(functions, border, rows, width=self.width, block=self.block)

    def basis(self, times: Array) -> Basis:
        """Spline functions at times, those beyond the ends taken as at the ends."""
        if self.static:
            return at_rest(np.searchsorted(self.knots, times))
        return basis(self.knots, np.clip(times, self.knots[0], self.knots[-1]))

    def holds(self, times: Array) -> NDArray[np.bool_]:
        """Which times are within it."""
        return np.asarray((times >= self.knots[0]) & (times <= self.knots[-1]))

    def smooth(self, equations: NormalEquations) -> NormalEquations:
        """Normal equations of the readings with what is known of the motion's smoothness, and of the
        processes.
        """
        smoothness = {} if self.smoothness is None or self.static else self.smoothness
        bands = [self.jerks[part] / intensity for part, intensity in smoothness.items()]
        for each in self.processes:
            own = self.process_places[each.source]
            bands += [embedded(each.precision, i, self.block) for i in range(own.start, own.stop)]
        return equations.stiffened(bands, self.coefficients) if bands else equations

    @property
    def prior_cost(self) -> float:
        """Cost of the motion by its smoothness, and of the processes by their levels."""
        smoothness = {} if self.smoothness is None or self.static else self.smoothness
        motion = sum(self.roughness[part] / intensity for part, intensity in smoothness.items())
        return motion + sum(
            each.roughness(self.coefficients[:, self.process_places[each.source]])
            for each in self.processes
        )

    @property
    def wandering(self) -> Segment:
        """The same with a translation that is not held smooth where nothing tells the place.

        Accelerations alone do not tell a translation from a rotation about a point far away: what a
        smooth translation says about a lever arm is a guess that no reading confirms.
        """
        if self.placed or self.smoothness is None:
            return self
        held = {part: each for part, each in self.smoothness.items() if part != "position"}
        return replace(self, smoothness=held)

    @property
    def roughness(self) -> Mapping[str, float]:
        """Part of the pose -> integral of its squared third derivative [m^2/s^5], [1/s^5]."""
        return {
            part: float(self.coefficients.ravel() @ banded_product(m, self.coefficients.ravel()))
            for part, m in self.jerks.items()
        }


def jerk_matrices(grid: Array, block: int = POSE) -> dict[str, Array]:
    """Part of the pose -> matrix of the integral of its squared third derivative, lower banded
    form, shape (42, N).

    Args:
        grid: Knots of the spline [s].
        block: Coefficients of one function.
    """
    local, weight = quadrature(grid, _JERK_NODES)
    root = np.sqrt(weight)
    found = {}
    for part, place in PARTS.items():
        n, k = len(root), place.stop - place.start
        by_jerk = np.zeros((n, k, POSE))
        by_jerk[:, :, place] = np.eye(k) * root[:, None, None]
        nothing = np.zeros_like(by_jerk)
        rows = Rows(
            local.first,
            np.zeros((n, k)),
            spread(local, nothing, nothing, nothing, by_jerk, block=block),
            np.zeros((n, k, 0)),
        )
        functions, width = len(grid) - DEGREE - 1, block * (DEGREE + 1)
        found[part] = accumulate(functions, 0, [rows], width=width, block=block).band
    return found


@dataclass
class Tally:
    """Sums over the residuals of rows, by what they are readings of."""

    square: dict[Source, float] = field(default_factory=dict)
    """Of whitened residuals, without those that stand far, which tell no noise."""
    count: dict[Source, float] = field(default_factory=dict)
    """Numbers in it."""
    far: dict[Source, int] = field(default_factory=dict)
    """Numbers that stand far."""
    rarest: dict[Source, float] = field(default_factory=dict)
    """Probability with which noise alone takes one number as far as the farthest."""
    held: dict[Source, tuple[float, float]] = field(default_factory=dict)
    """The same sum with those that stand far, which count as at the limit [Huber1964]_, and how
    many numbers it is of: noise of long tails."""
    cost: float = 0.0
    """Of all numbers, those that stand far counted as Huber does."""

    def include(self, other: Tally) -> None:
        """Add what another has counted."""
        for own, further in (
            (self.square, other.square),
            (self.count, other.count),
            (self.far, other.far),
        ):
            for label, value in further.items():
                own[label] = own.get(label, 0) + value  # type: ignore[assignment]
        for label, probability in other.rarest.items():
            self.see(label, probability)
        for label, (square, numbers) in other.held.items():
            whole, count = self.held.get(label, (0.0, 0.0))
            self.held[label] = (whole + square, count + numbers)
        self.cost += other.cost

    def see(self, label: Source, probability: float) -> None:
        """Keep the smallest probability of a number of some readings."""
        self.rarest[label] = min(self.rarest.get(label, 1.0), probability)

    def is_beyond_noise(self, label: Source) -> bool:
        """Whether more numbers stand far than noise alone would have put there, or one farther."""
        numbers, far = self.count.get(label, 0.0), self.far.get(label, 0)
        if not far:
            return False
        return (
            self.rarest.get(label, 0.0) * (numbers + far) < _SURELY
            or float(poisson_tail(far, _FAR * (numbers + far))) < _SURELY
        )

    def add(self, label: Source, size: Array, weight: Array, each: int) -> None:
        """Count residuals.

        Args:
            label: What they are of.
            size: Length of each, in its 1-sigma.
            weight: Huber's.
            each: Numbers in each.
        """
        # Where most are large, none is the exception.
        usual = median(size) / _usual(each) if size.size else 1.0
        near = (weight > 0) & (size <= limit(each) * max(1.0, usual))
        self.square[label] = self.square.get(label, 0.0) + float(np.sum(size[near] ** 2))
        self.count[label] = self.count.get(label, 0.0) + each * int(np.sum(near))
        self.far[label] = self.far.get(label, 0) + int(np.sum(~near & (weight > 0)))
        farthest = float(np.max(size, where=weight > 0, initial=0.0)) / max(1.0, usual)
        self.see(label, float(chi2_tail(farthest**2, each)))
        whole, numbers = self.held.get(label, (0.0, 0.0))
        self.held[label] = (
            whole + float(np.sum((size * weight) ** 2)),
            numbers + each * int(np.sum(weight > 0)),
        )
        # Of weights c / size: 2 c size - c^2 beyond c.
        self.cost += float(np.sum(size**2 * weight * (2 - weight)))


def median(values: Array) -> float:
    """Of all numbers, of which there must be one; of few it is found sooner than by NumPy's, which is
    made for many axes.
    """
    flat = values.ravel()
    middle = (flat.size - 1) // 2, flat.size // 2
    parted = np.partition(flat, middle)
    return float((parted[middle[0]] + parted[middle[1]]) / 2)


@cache
def _usual(k: int) -> float:
    """Median length of a whitened residual of k numbers."""
    return float(np.sqrt(chi2_quantile(0.5, k)))


@cache
def limit(k: int) -> float:
    """Length of a whitened residual of k numbers beyond which it stands far."""
    return float(np.sqrt(chi2_quantile(1 - _FAR, k)))


def robust_weight(size: Array, k: int) -> Array:
    """Huber's weights of whitened residuals of k numbers each."""
    return np.asarray(np.minimum(1.0, limit(k) / np.maximum(size, 1e-300)))


def motion_residuals(
    experiment: Experiment,
    segment: Segment,
    calibration: CalibrationValues,
    column_of: NDArray[np.intp],
    factors: Mapping[Source, float],
    tally: Tally,
    carried: Carried | None = None,
) -> Iterator[Rows]:
    """Whitened readings of a segment, then what holds the motion where no instrument does.

    Args:
        experiment: With its instruments.
        segment: With readings and present motion.
        calibration: Present values of the systematic errors.
        column_of: Column of each systematic error in the border; -1: not there; shape (u,).
        factors: Quantity -> by how much its noise exceeds what the reading says.
        tally: Is added to.
        carried: Tensions of the cables as all that is fitted has them, for readings that follow
            these; None: they are those of the readings, taken as known.
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
            )
    held = holding_rows(segment)
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
    if filtered is not None:
        # A filtered force says what was a while ago.
        delay = delay + calibration.values[filtered]
    return time - delay[0], clock, origin


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
        columns, values = np.concatenate(self._columns), np.concatenate(self._values, axis=2)
        unique, place = np.unique(columns, return_inverse=True)
        if len(unique) == len(columns):
            return values, columns
        # Few stand there twice: delays of two clocks that are one.
        order = np.argsort(place, kind="stable")
        begins = np.searchsorted(place[order], np.arange(len(unique)))
        return np.add.reduceat(values[:, :, order], begins, axis=2), unique


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
    tally: Tally,
    carried: Carried | None,
    seen: Seen,
) -> Rows:
    """Whitened rows of some samples of one quantity."""
    calibration_parameters = calibration.calibration_parameters
    name, _ = reading.source
    instrument = experiment.instruments[name]
    label = segment.label(*reading.source)
    sigma: float | Array = reading.sigma * factors.get(label, 1.0)
    if reading.late is not None:
        sigma = np.hypot(sigma, reading.late[part])
    followed: _CorrectedTensions | None = None
    if carried is not None and reading.follows:
        followed = _CorrectedTensions(carried, sigma)
    times, local, motion, linear = looked_at(
        experiment, segment, reading, part, calibration, references, followed, seen
    )
    if followed is not None and followed.correct(linear):
        # Linearised about tensions that go with the lengths, as the forces are about theirs.
        *_, linear = looked_at(
            experiment, segment, reading, part, calibration, references, followed, seen
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
        slope, tensions = linear["by_tension"], followed.carried
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
    nothing = without_effect(instrument, reading.source[1], experiment.robot)
    column = 0
    if "by_errors" not in nothing:
        places = calibration_parameters.places_of(name, instrument, segment.run)
        for place in places.values():
            size = place.stop - place.start
            border.put(place, linear["by_errors"][:, :, column : column + size])
            column += size
    own = clock_of(experiment, name)
    if not segment.static and (reference := references.get(own, own)) != own:
        clock, origin = (
            calibration_parameters.place(each, "delay", segment.run) for each in (own, reference)
        )
        # A later clock looks at an earlier instant of the motion.
        by_delay = -rate_along(by, motion)
        by_delay = by_delay - segment.disturbance_of(reading.source, local, 1)
        by_delay = by_delay[:, :, None]
        border.put(clock, by_delay)
        border.put(origin, -by_delay)
    for key, derivative in (
        ("gravity", "by_gravity"),
        ("anchor", "by_anchors"),
        ("attachment", "by_attachments"),
    ):
        if derivative not in nothing:
            border.put(calibration_parameters.places[ROBOT, key, None], linear[derivative])
    by_errors, columns = border.collected()
    # A clock that has moved may carry samples out of the segment.
    inside = there if segment.static else there & segment.holds(times)[:, None]
    if reading.values.ndim == 3:
        size = np.sqrt(np.sum(residual**2, axis=1, keepdims=True))
        weight = inside[:, :1] * robust_weight(size, k)
        tally.add(label, size, weight, k)
    else:
        # A spike in one channel leaves the others as they are.
        weight = inside * robust_weight(np.abs(residual), 1)
        tally.add(label, np.abs(residual), weight, 1)
    by_state = by
    if processes:
        by_state = _with_processes(by[0], processes, segment.block), *by[1:]
    if by_processes is not None and by_processes.shape[2]:
        whole = np.zeros((n, k, segment.block))
        whole[:, :, : by_state[0].shape[2]] = by_state[0]
        whole[:, :, POSE:] += by_processes
        by_state = whole, *by[1:]
    root = np.sqrt(weight)
    scale = (np.broadcast_to(root, residual.shape) / sigma)[:, :, None]
    return Rows(
        local.first,
        root * residual,
        spread(local, *(j * scale for j in by_state), block=segment.block),
        by_errors * scale,
        columns,
        label,
    )


class _CorrectedTensions:
    """Tensions that lengths follow: as the forces carry the body, then less the noise that the lengths
    themselves show, so that it does not meet itself in the derivatives [Helmert1872]_.
    """

    carried: CarriedTensions

    def __init__(self, at: Carried, sigma: float | Array) -> None:
        self._at, self._sigma = at, sigma
        self._off: Array | None = None

    def __call__(self, times: Array) -> CarriedTensions:
        """Tensions about which is linearised."""
        if self._off is None:
            self.carried = self._at(times)
            return self.carried
        return replace(self.carried, values=self.carried.values - self._off)

    def deviation(self, slope: Array) -> Array:
        """1-sigma of the residuals by noise of the lengths and of the tensions, shape (n, k).

        Args:
            slope: Derivative of the residuals by the tensions, shape (n, k, m).
        """
        own = np.einsum("nkm,nm->nk", slope**2, self.carried.variance)
        return np.asarray(np.sqrt(np.square(self._sigma) + own))

    def correct(self, linear: Mapping[str, Array]) -> bool:
        """Take off the noise that the residuals show, no more than noise may do; whether there is
        any.
        """
        slope, variance = linear["by_tension"], self.carried.variance
        sigma = self.deviation(slope)
        far = limit(1) * sigma
        residual = np.clip(np.nan_to_num(linear["residual"]), -far, far)
        # No cable is pulled slack by noise.
        most = 0.5 * np.abs(self.carried.values)
        off = variance * np.einsum("nkm,nk->nm", slope, residual / sigma**2)
        self._off = np.clip(off, -most, most)
        return bool(self._off.any())

    def as_carried(self, linear: Mapping[str, Array]) -> Mapping[str, Array]:
        """The linearised difference at the carried tensions, by derivatives about the others."""
        assert self._off is not None
        further = np.einsum("nkm,nm->nk", linear["by_tension"], self._off)
        return {**linear, "residual": linear["residual"] + further}


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


def holding_rows(segment: Segment) -> Rows:
    """Length of the quaternion near one; place and speed of a platform within a hall."""
    if segment.static:
        local = at_rest(np.arange(len(segment.coefficients)))
    else:
        inner = segment.knots[DEGREE : len(segment.knots) - DEGREE]
        # At the knots too: the first and the last coefficient hardly show anywhere else.
        local = basis(segment.knots, np.sort(np.concatenate([inner, (inner[1:] + inner[:-1]) / 2])))
    pose, rate, *_ = motion_at(local, segment.coefficients)
    n = len(pose)
    by_pose, by_rate = np.zeros((n, 7, POSE)), np.zeros((n, 7, POSE))
    by_pose[:, 0, 3:] = 2 * pose[:, 3:] / _UNIT
    by_pose[:, 1:4, :3] = np.eye(3) / _PLACE
    by_rate[:, 4:7, :3] = np.eye(3) / _SPEED
    residual = np.hstack(
        [
            (np.sum(pose[:, 3:] ** 2, axis=1, keepdims=True) - 1) / _UNIT,
            pose[:, :3] / _PLACE,
            rate[:, :3] / _SPEED,
        ]
    )
    return Rows(
        local.first,
        residual,
        spread(local, by_pose, by_rate, block=segment.block),
        np.zeros((n, 7, 0)),
        np.zeros(0, dtype=np.intp),
    )
