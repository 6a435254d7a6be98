"""The balance linearised about where everything stands: how it follows the motion, the body and
every calibration parameter.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.dynamics import platform_regressor
from steelyard.experiment.model import Experiment
from steelyard.identification.model.balance import (
    UNMODELLED_PARTS,
    Balance,
    Forces,
    balance_at,
    moving_at,
)
from steelyard.identification.model.balance.asked import derivatives_asked, pulling
from steelyard.identification.model.balance.behind_filter import functions_behind
from steelyard.identification.model.balance.bending import bending_along
from steelyard.identification.model.balance.equations import derivatives_of_balance
from steelyard.identification.model.balance.units_of_rest import (
    by_attachments,
    by_mass,
    by_readings,
    in_units,
)
from steelyard.identification.model.border import Border, ByParameters, has_column
from steelyard.identification.model.calibration_parameters import (
    BENDING_KEYS,
    ROBOT,
    CalibrationValues,
)
from steelyard.identification.model.motion_segment import Segment
from steelyard.identification.model.processes import Process
from steelyard.identification.model.segment import (
    POSE,
    Basis,
    motion_at,
    spread,
)
from steelyard.identification.model.sources import Source
from steelyard.inertia import TEN
from steelyard.instruments.base import Instrument
from steelyard.instruments.equations import following, sensitivity
from steelyard.instruments.tension import GAINS, PRESLIDING, PRESLIDING_START
from steelyard.robot.model import DIRECTIONS


@dataclass(frozen=True, eq=False)
class BalancePoint:
    """Where the balance is linearised, and how it follows what it depends on."""

    experiment: Experiment
    segment: Segment
    force_samples: Forces
    calibration: CalibrationValues
    at: Balance
    local: Basis
    """Spline functions at its times."""
    motion: tuple[Array, Array, Array, Array]
    """Pose and its first three time derivatives, shape (n, 7) each."""
    constant: float
    """See :class:`.MovingAt`."""
    derivatives: Mapping[str, Array]
    """See :func:`.derivatives_of_balance`; those by what has no column may not be there."""
    column_of: NDArray[np.intp] | None = None
    """Column of each systematic error in the border; -1: not there, and nothing is asked of it;
    shape (u,). None: all are asked for."""

    @property
    def instrument(self) -> Instrument:
        """Of the forces."""
        return self.experiment.instruments[self.force_samples.name]

    def asks(self, place: slice) -> bool:
        """Whether the border has any of some systematic errors."""
        return self.column_of is None or has_column(self.column_of, place)

    @property
    def errors(self) -> dict[str, Array]:
        """Values of its systematic errors."""
        return self.calibration.of(self.force_samples.name, self.instrument, self.segment.run)

    @cached_property
    def asked(self) -> Array:
        """Tensions or wrench that the body asks for, as derivatives of the balance take them, shape
        (n, k).
        """
        return self.at.calmed(self.at.asked)

    def by_body(self, parameters: Array) -> Array:
        """Derivative of the balance by the ten parameters, shape (n, 6, 10); see
        :mod:`.units_of_rest`.
        """
        found = self.derivatives["by_parameters"]
        if not self.force_samples.guessed.all():
            return found
        return in_units(found, self.at.left_over, by_mass(parameters))

    def by_motion(self) -> tuple[Array, Array, Array]:
        """Derivatives of the balance by pose, rate and acceleration, shape (n, 6, 7) each.

        How the rate and the weight of a cable change with an error of the geometry is of no
        account.
        """
        names = ("by_pose", "by_rate", "by_acceleration")
        by_pose, by_rate, by_acceleration = (self.derivatives[name] for name in names)
        moved, structure = self.followed_by_readings(), self.at.structure
        if moved is not None and structure is not None:
            by_pose = by_pose + structure @ moved[0]
            by_rate = by_rate + structure @ moved[1]
        return by_pose, by_rate, by_acceleration

    def followed_by_readings(self) -> tuple[Array, Array] | None:
        """How tensions or wrench follow pose and rate for the same readings, shape (n, k, 7) each;
        None: they do not.
        """
        at, pose, rate = self.at, *self.motion[:2]
        return following(
            at.measured.quantity,
            self.instrument,
            self.experiment.robot,
            tuple(self.force_samples.readings),
            (pose, rate),
            at.carried,
            self.errors,
            at.motion.get("rolling"),
        )

    def by_state(self, by_pose: Array) -> Array:
        """Derivative of the balance by the pose and by the processes beside it, shape (n, 6,
        block).
        """
        segment = self.segment
        found = np.zeros((*by_pose.shape[:2], segment.block))
        found[:, :, :POSE] = by_pose
        for each in segment.processes:
            part = UNMODELLED_PARTS.get(each.source)
            if part is not None:
                place = segment.process_places[each.source]
                along = self.at.measured.unmodelled.wrench[:, :, part]
                if each.upright:
                    along = along @ np.swapaxes(self.at.motion["rotation"], 1, 2)
                found[:, :, place] = -along * each.sizes
        for each, place, own in self.of_readings():
            found[:, :, place] = -self.at.by_reading[:, :, own] * each.sizes
        return found

    def by_coefficients(
        self, by: tuple[Array, Array, Array], *, wide: bool
    ) -> tuple[NDArray[np.intp], Array]:
        """First function of each row, shape (n,), and derivatives of the balance by the
        coefficients of these functions, shape (n, 6, w).

        Args:
            by: See :meth:`by_motion`.
            wide: Whether a row may have more than six functions.
        """
        by_state, block = self.by_state(by[0]), self.segment.block
        if self.constant <= 0:
            return self.local.first, spread(self.local, by_state, *by[1:], block=block)
        behind, plain = functions_behind(self.segment, self.at.time, self.constant, wide=wide)
        alone, filtered = (spread(each, by_state, *by[1:], block=block) for each in (plain, behind))
        found = self.at.measured.behind_filter(alone, filtered)
        # What processes add is not behind the filter.
        own, other = (each.reshape(*each.shape[:2], -1, block) for each in (found, alone))
        own[..., POSE:] = other[..., POSE:]
        return behind.first, found

    def of_readings(self) -> Iterator[tuple[Process, slice, slice]]:
        """Processes that are added to the readings, where their coefficients stand, and which
        readings these are.
        """
        for quantity, own in self.force_samples.places.items():
            for each, place in self.segment.processes_of((self.force_samples.name, quantity)):
                yield each, place, own

    def by_terms(self) -> ByParameters:
        """Derivatives of the balance by the systematic errors of the readings."""
        at = self.at
        changes = self.terms_of_readings(self.asked)
        if at.structure is None or at.structure.shape[2] >= DIRECTIONS:
            for place, change in changes:
                yield place, at.measured.changes_of_wrench(change)
            return
        # See units_of_rest.
        unit = np.diagonal(at.measured.by_reading, axis1=1, axis2=2)
        further = self.terms_of_readings(self.asked + unit)
        for (place, change), (_, more) in zip(changes, further, strict=True):
            by_term = at.measured.changes_of_wrench(change)
            yield place, in_units(by_term, at.uncarried, by_readings(change, more))

    def terms_of_readings(self, values: Array) -> ByParameters:
        """Derivatives of tensions or wrench by the systematic errors of the readings, shape (n, k,
        c).

        Args:
            values: Tensions or wrench, shape (n, k).
        """
        at, instrument, run = self.at, self.instrument, self.segment.run
        if not instrument.terms(self.experiment.robot.m):
            # Cables that nobody reads have no errors.
            return
        name, robot = self.force_samples.name, self.experiment.robot
        parameters = self.calibration.calibration_parameters
        places = parameters.places_of(name, instrument, run)
        asked = {key: place for key, place in places.items() if self.asks(place)}
        if not asked:
            return
        unknown = at.measured.quantity
        _, by_terms, by_rolling = sensitivity(
            unknown,
            instrument,
            robot,
            tuple(self.force_samples.readings),
            {**at.motion, unknown: values},
            self.errors,
            None if self.column_of is None else frozenset(asked),
        )
        by_terms = np.broadcast_to(by_terms, (len(at.time), *by_terms.shape[1:]))
        yield from _in_turn(asked.values(), by_terms)
        rolled = at.rolled
        if by_rolling is None or rolled is None or self.segment.static:
            return
        if PRESLIDING in asked:
            yield (
                asked[PRESLIDING],
                np.einsum("nkm,nm->nk", by_rolling, rolled.by_travel)[..., None],
            )
        if PRESLIDING_START in asked:
            yield asked[PRESLIDING_START], by_rolling * rolled.by_start[:, None]

    def by_gains(self, terms: Sequence[tuple[slice, Array]]) -> ByParameters:
        """Derivative of tensions by gains, of a newton of each, shape (n, m, g).

        Args:
            terms: See :meth:`terms_of_readings`, of the tensions that the body asks for.
        """
        places = self.calibration.calibration_parameters.places_of(
            self.force_samples.name, self.instrument, self.segment.run
        )
        gains = [places[key] for key in GAINS if key in places and self.asks(places[key])]
        if not gains:
            return
        more = self.terms_of_readings(self.at.asked + 1.0)
        for (place, change), (_, changed) in zip(terms, more, strict=True):
            if place in gains:
                yield place, changed - change

    def by_robot(self) -> ByParameters:
        """Derivatives of the balance by gravity, by the geometry of the cables, by what is carried
        more than the first load and by what else pulls at the platform.
        """
        parameters = self.calibration.calibration_parameters
        places = parameters.places
        keys = ("gravity", "anchor", "attachment") if self.experiment.robot.m else ("gravity",)
        for key in keys:
            place = places[ROBOT, key, None]
            if self.asks(place):
                by_key = self.derivatives[f"by_{key}"]
                yield place, self._in_arms(by_key) if key == "attachment" else by_key
        load = parameters.place_of_load(self.segment.run)
        if load is not None and self.asks(load):
            yield load, self.derivatives["by_parameters"]
        moves = parameters.place_of_apparent(self.segment.run)
        if moves is not None and self.asks(moves):
            answered = self.derivatives["by_parameters"].copy()
            answered[:, :, 0] -= self.derivatives["by_weight"].reshape(len(answered), -1)
            yield moves, answered
        yield from self.by_bending()
        for name, own in pulling(self.experiment, self.calibration, self.segment.run).items():
            if f"by_{name}" in self.derivatives:
                yield from _in_turn(own, self.derivatives[f"by_{name}"])

    def by_bending(self) -> ByParameters:
        """Derivatives of the balance by what parts of the platform do that bend."""
        places = self.calibration.calibration_parameters.places
        own = [places[key] for key in BENDING_KEYS if key in places]
        if any(self.asks(place) for place in own):
            yield from _in_turn(own, -bending_along(self.segment, self.at.time, self.calibration))

    def _in_arms(self, by_attachment: Array) -> Array:
        """Derivative of the balance by the attachments, shape (n, 6, 3 m); see
        :mod:`.units_of_rest`.
        """
        if self.experiment.robot.m >= DIRECTIONS:
            return by_attachment
        torque = self.at.measured.unmodelled.usual[:, None] * self.at.uncarried
        torque[:, :3] = 0.0
        arms = self.calibration.geometry["attachments"].reshape(-1, 3)
        return in_units(by_attachment, torque, by_attachments(arms))


def _in_turn(places: Iterable[slice], columns: Array) -> ByParameters:
    """Columns that stand side by side, shape (n, k, c), by where each of several parameters
    stands.
    """
    first = 0
    for place in places:
        last = first + place.stop - place.start
        yield place, columns[:, :, first:last]
        first = last


def point_of(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    parameters: Array,
    factors: Mapping[Source, float],
    column_of: NDArray[np.intp] | None = None,
) -> BalancePoint:
    """The balance linearised about where everything stands; arguments as of :func:`.balance_of`,
    and the last as in :class:`BalancePoint`.
    """
    asked = None
    if column_of is not None:
        asked = frozenset(derivatives_asked(experiment, calibration, segment.run, column_of))
    moving = moving_at(experiment, segment, force_samples, calibration, parameters)
    at = balance_at(moving, experiment, segment, force_samples, calibration, factors)
    cables = (
        {} if at.structure is None else {"tension": at.calmed(at.carried), **calibration.geometry}
    )
    derivatives = dict(
        derivatives_of_balance(experiment.robot, *calibration.pulling, asked)(
            **moving.inputs, **cables
        )
    )
    if at.behind is not None and moving.constant > 0:
        derivatives["by_parameters"] = at.measured.behind_filter(
            derivatives["by_parameters"], -at.behind.regressor
        )
    return BalancePoint(
        experiment,
        segment,
        force_samples,
        calibration,
        at,
        moving.local,
        motion_at(moving.local, segment.coefficients),
        moving.constant,
        derivatives,
        column_of,
    )


def by_body_and_readings(
    experiment: Experiment,
    segment: Segment,
    force_samples: Forces,
    calibration: CalibrationValues,
    parameters: Array,
    at: Balance,
    column_of: NDArray[np.intp],
) -> tuple[Array, NDArray[np.intp]]:
    """Derivatives of the balance by what noise of the motion is seen in: by the bodies that are
    carried, what bends of them and the systematic errors of the readings; shape (n, 6, c), and
    their columns, shape (c,).

    Args:
        experiment: With robot and instruments.
        segment: With its motion.
        force_samples: Force readings within it.
        calibration: Present values of the systematic errors.
        parameters: The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS`, shape (10,).
        at: The balance there.
        column_of: Column of each systematic error in the border; -1: not there; shape (u,).
    """
    regressor = -platform_regressor(*(at.motion[k] for k in ("specific_force", "omega", "alpha")))
    local = segment.basis(at.time)
    motion = motion_at(local, segment.coefficients)
    by_body = {"by_parameters": regressor}
    point = BalancePoint(
        experiment, segment, force_samples, calibration, at, local, motion, 0.0, by_body, column_of
    )
    border = Border(column_of, len(at.time), DIRECTIONS)
    border.extend(np.arange(TEN), point.by_body(parameters))
    for place, derivative in chain(point.by_terms(), point.by_bending()):
        border.put(place, derivative)
    load = calibration.calibration_parameters.place_of_load(segment.run)
    if load is not None:
        border.put(load, regressor)
    apparent = calibration.calibration_parameters.place_of_apparent(segment.run)
    if apparent is not None:
        own = regressor.copy()
        down = np.einsum("nji,j->ni", at.motion["rotation"], calibration.gravity)
        own[:, :3, 0] -= down
        border.put(apparent, own)
    return border.collected()
