"""A stretch of a run with one motion, a spline in time, or a set of poses at rest; the readings in
it.

Its smoothness, where it has one, is a proper prior: the third derivative is white noise of an
intensity that the data tell [Wahba1978]_, so that a spline of many knots is no freer than the
motion is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.banded import banded_product
from steelyard.identification.model.accumulation import accumulate
from steelyard.identification.model.processes import Process, embedded
from steelyard.identification.model.processes import places as places_of
from steelyard.identification.model.segment import (
    POSE,
    Basis,
    NormalEquations,
    Rows,
    at_rest,
    basis,
    motion_at,
    quadrature,
    spread,
    values_at,
)
from steelyard.identification.model.sources import Source
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
_JERK_NODES = 3
"""Of the quadrature between two knots: exact for squares of what is quadratic there."""


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
    """What one 1-sigma of time stamps that scatter makes of each number, the same stamp of all
    channels, shape (n, k); None: nothing."""
    follows: bool = False
    """Whether these tensions are those of :class:`CarriedTensions` wherever forces are fitted, so
    that all which is uncertain about them is in the lengths too."""
    still: bool = False
    """Whether it stands still to its last digit, so that nothing in it tells when it was read."""


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
    noise: Array
    """What each of p noises of the force readings leaves of them, as one 1-sigma [N], shape (n, m,
    p)."""
    kept: Array
    """What of a change of the measured tensions the correction that carries the body leaves, shape
    (n, m, m)."""
    by_gain: Array
    """Derivative of the measured tensions by gains, of a newton of each, shape (n, m, g)."""
    gains: NDArray[np.intp]
    """Which border parameters these are, shape (g,)."""
    rate: Array
    """How fast they change [N/s], shape (n, m)."""
    bend: Array
    """How fast that changes [N/s^2], shape (n, m)."""
    feed: Array
    """How fast tensions would change by what is fed if that left the stretch as it is [N/s], shape
    (n, m)."""

    @property
    def variance(self) -> Array:
        """What noise of the force readings leaves of them [N^2], shape (n, m)."""
        return np.asarray(np.sum(self.noise**2, axis=2))

    def without(self, off: Array) -> CarriedTensions:
        """With other tensions, and what follows from their size.

        A scale that the readings, the body and the stretch of the cables share changes nothing that
        is read. That must be so in the derivatives, too, or noise that is taken off some of them
        would pull at the scale.

        Args:
            off: What is taken off [N], in directions in which tensions carry nothing, shape (n, m).
        """
        by_border = self.by_border.copy()
        further = self.kept @ (off[:, :, None] * self.by_gain)
        _, own, from_gains = np.intersect1d(self.columns, self.gains, return_indices=True)
        by_border[:, :, own] -= further[:, :, from_gains]
        return replace(self, values=self.values - off, by_border=by_border)

    def behind(self, lags: Array, columns: NDArray[np.intp]) -> CarriedTensions:
        """Those by which cables stretch that damp: a first-order filter of the tensions, which
        change slowly within its time constant.

        How the rates follow the motion is of no account: by a hundredth of what the tensions do.

        Args:
            lags: See :class:`.LengthCalibration` [s], shape (2,).
            columns: Which border parameters these are, shape (2,); -1: none.
        """
        own, fed = lags
        by_lags = np.stack([2 * own * self.bend - self.rate, -self.feed], axis=2)
        use = columns >= 0
        return replace(
            self,
            values=self.values - own * self.rate + own**2 * self.bend - fed * self.feed,
            by_border=np.concatenate([self.by_border, by_lags[:, :, use]], axis=2),
            columns=np.concatenate([self.columns, columns[use]]),
        )


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

    @property
    def spacing(self) -> float:
        """Of its knots [s]."""
        return float(self.knots[DEGREE + 1] - self.knots[DEGREE])

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
        """The same motion with these processes beside it; those that it has not had are nothing
        yet.
        """
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
        """Normal equations of the readings with what is known of the motion's smoothness, and of
        the processes.
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
