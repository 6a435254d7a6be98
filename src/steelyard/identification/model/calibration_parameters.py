"""The systematic errors of an experiment as one vector: every instrument's terms, the clocks, and
the robot file itself.

Estimators, bounds and tests speak of the same errors by the same places; their priors are those of
the contract.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.estimates.estimate import plausible_radius
from steelyard.experiment.model import Experiment, Load, Run
from steelyard.experiment.unread import is_unread
from steelyard.identification.weighed_cells import WeighedCells, weighed_cells
from steelyard.inertia import TEN
from steelyard.instruments import Instrument
from steelyard.instruments.base import TIME_CONSTANT, Term
from steelyard.instruments.length import CABLE_DAMPING, DAMPED, ROLLER, STRETCH
from steelyard.instruments.tension import CROSSTALK
from steelyard.instruments.unread_cables import UnreadCables
from steelyard.robot.covariance import POINTS
from steelyard.robot.surroundings import HOSE

ROBOT = "robot"
"""Owner of the errors of the robot file."""
DRAG = "cable_inertia"
"""Key of how far the platform feels the inertia of its cables: 1 as theory has it, 0 where they
follow without any."""
_DRAGGED = 0.5
"""Its mean and its 1-sigma: cables that swing, creep over rollers or are simulated without inertia
feel less than theory says."""
ATTACHED = (
    ("attached.force", 3),
    ("attached.stiffness", 1),
    ("attached.moments", 9),
    ("attached.stiffness_moment", 3),
)
"""Keys and sizes of what a hose does, see :func:`steelyard.robot.surroundings.attached_wrench`."""
_HOSE = "hose"
"""First part of the keys of hoses that are stated."""
DAMPING = (("damping.moving", 1), ("damping.turning", 1))
"""The same of what decays swings, see :func:`steelyard.robot.surroundings.damping_wrench`."""
AIR = (("drag.area", 1), ("drag.turning", 1), *DAMPING)
"""And of the air, see :func:`steelyard.robot.surroundings.air_wrench`."""
SWIVEL = "swivel.friction"
"""Key of the friction where cables turn about their anchors, see
:func:`steelyard.robot.surroundings.swivel_wrench`."""
_FRAME = 1e-6
"""1-sigma of frames that a calibration has defined [m]."""
LOAD = "load"
"""First part of the keys of what further loads are more than the first: ten linear parameters."""
_ANY_LOAD = 10.0
"""1-sigma of that, in plausible sizes of a body: none that the data tell is hardly moved by it."""
_EXACT_PART = 1e-6
"""Part of its size to which what was added is known at best."""
_DECAY = 0.2
"""1-sigma of the rate at which swings decay where no force is read [1/s]: two per cent of critical
damping at a hertz."""
_RUBBING = 0.005
"""1-sigma of the torque of dry friction at an anchor over the tension of its cable [m]: plain bearings
of some centimetres, stiff ropes."""
_PULL = 0.004
"""1-sigma of the force of a hose, as a part of all tensions; of its stiffness the same over a metre."""
_BLUFF = 3.0
"""1-sigma of drag coefficients times area, and of turning, in units of the platform's size squared
and to the fifth power: frames and sheets."""
_AXES = "xyz"
_OF_LOADS = (
    "mass",
    *(f"first moment {axis}" for axis in _AXES),
    *(f"inertia {axes} about the origin" for axes in ("xx", "yy", "zz", "yz", "xz", "xy")),
)
"""What a load is more than the first, as people would say it."""
_PER_CABLE = frozenset({"offset", "gain", "friction", ROLLER})
_NEGLIGIBLE = 0.1
"""Part of the 1-sigma of devices that have an error at all, below which it is another's doing."""
_STRETCHED = 0.1
"""1-sigma of the stretch of cables over that by the axial stiffness of the robot file: ropes of one
make differ by so much, and grow stiffer in use. Taken as exact it would weigh the platform."""
_OFFSET_SHARE = 0.01
"""Default 1-sigma of the offset of a force sensor, as a part of the median tension."""


@dataclass(frozen=True, eq=False)
class CalibrationParameter:
    """One systematic error, a constant vector."""

    owner: str
    """Instrument, or :data:`ROBOT`; of a delay the clock."""
    key: str
    """Term of the instrument (nested keys with a dot), ``delay``, or ``anchor``, ``attachment``,
    ``gravity`` of the robot."""
    run: str | None
    """Run in which it holds; None: in all of them."""
    unit: str
    mean: Array
    """Value known beforehand, shape (k,)."""
    deviation: Array
    """1-sigma, shape (k,); 0 is exact."""
    suspected: float | None = None
    """1-sigma where the readings ask for it, see :class:`.Term`."""

    @property
    def is_absent(self) -> bool:
        """Whether it is taken as none unless the readings ask for it."""
        return self.suspected is not None and not self.deviation.any()

    @property
    def is_load(self) -> bool:
        """Whether it is no error at all, but what a further load is more than the first."""
        return self.owner == ROBOT and self.key.startswith(f"{LOAD}.")

    @property
    def negligible(self) -> float:
        """Size that an error that is taken as none has not to be believed: it would be smaller than
        that of any device, so that something else imitates it.
        """
        return _NEGLIGIBLE * (self.suspected or 0.0) if self.is_absent else 0.0

    def names(self, m: int) -> list[str]:
        """A name for every component, as people would say it."""
        size = len(self.mean)
        where = f"{self.owner}.{self.key}" + (f" of run '{self.run}'" if self.run else "")
        if self.key in {"anchor", "attachment"}:
            return [f"{self.key} {i // 3 + 1} {_AXES[i % 3]}" for i in range(size)]
        # A robot of three cables has vectors that are no axes.
        if size == m and size > 1 and self.key in _PER_CABLE:
            return [f"{where} of cable {i + 1}" for i in range(size)]
        if self.key == CROSSTALK:
            pairs = [(i, j) for i in range(m) for j in range(m) if i != j]
            return [f"{where} of cable {i + 1} from cable {j + 1}" for i, j in pairs]
        if self.is_load:
            load = self.key.removeprefix(f"{LOAD}.")
            return [f"{each} of what load '{load}' has more" for each in _OF_LOADS]
        if size == 3:
            return [f"{where} {axis}" for axis in _AXES]
        return [where] if size == 1 else [f"{where} {i + 1}" for i in range(size)]


Key = tuple[str, str, str | None]
"""Owner, key and run of an :class:`CalibrationParameter`."""


@dataclass(frozen=True, eq=False)
class CalibrationParameters:
    """All systematic errors of an experiment, and where each stands in the vector of them."""

    entries: tuple[CalibrationParameter, ...]
    m: int
    """Number of cables."""
    geometry: Array | None = None
    """Covariance of anchors, then attachments, where a calibration has left one [m^2], shape (6 m,
    6 m)."""
    carried: Mapping[str, str] = field(default_factory=dict)
    """Run -> key of what it carried more than the first load; runs of the first are not there."""
    weighed: WeighedCells | None = None
    """What dead weights tell of gains, offsets and gravity: values and 1-sigma of these are theirs;
    None: there are none."""
    continued: Mapping[str, str] = field(default_factory=dict)
    """Run -> the one that went on as it when the load changed, whose errors it has."""

    @cached_property
    def places(self) -> Mapping[Key, slice]:
        """Where each stands."""
        ends = np.cumsum([len(u.mean) for u in self.entries])
        return {
            (u.owner, u.key, u.run): slice(int(end) - len(u.mean), int(end))
            for u, end in zip(self.entries, ends, strict=True)
        }

    def __len__(self) -> int:
        return sum(len(u.mean) for u in self.entries)

    def place(self, owner: str, key: str, run: str) -> slice:
        """Where an error stands that acts in a run.

        Raises:
            KeyError: There is none.
        """
        places, run = self.places, self.continued.get(run, run)
        return places[owner, key, run] if (owner, key, run) in places else places[owner, key, None]

    @cached_property
    def _found(self) -> dict[tuple[str, str], tuple[Instrument, Mapping[str, slice]]]:
        """Instrument and run -> what :meth:`places_of` has said of them."""
        return {}

    def places_of(self, name: str, instrument: Instrument, run: str) -> Mapping[str, slice]:
        """Key of each of an instrument's terms -> where it stands as it acts in a run, in their order.

        Args:
            name: Of the instrument.
            instrument: Itself.
            run: Name of the run.
        """
        # Asked for at every linearisation, and longer to say than to use.
        known = self._found.get((name, run))
        if known is not None and known[0] is instrument:
            return known[1]
        found = {term.key: self.place(name, term.key, run) for term in instrument.terms(self.m)}
        self._found[name, run] = instrument, found
        return found

    def place_of_load(self, run: str) -> slice | None:
        """Where it stands by how much the body of a run differs from the first load; None: it is the
        first load.
        """
        key = self.carried.get(run)
        return None if key is None else self.places[ROBOT, key, None]

    @cached_property
    def mean(self) -> Array:
        """Values known beforehand, shape (u,)."""
        return np.concatenate([u.mean for u in self.entries])

    @cached_property
    def deviation(self) -> Array:
        """1-sigma, shape (u,)."""
        return np.concatenate([u.deviation for u in self.entries])

    @property
    def of_geometry(self) -> NDArray[np.intp]:
        """Places of anchors, then attachments, shape (6 m,)."""
        places = [self.places[ROBOT, key, None] for key in POINTS]
        return np.concatenate([np.arange(p.start, p.stop) for p in places], dtype=np.intp)

    @property
    def of_weighed(self) -> NDArray[np.intp]:
        """Places of all that dead weights tell of; empty: there are none."""
        if self.weighed is None:
            return np.zeros(0, dtype=np.intp)
        places = [self.places[each] for each in self.weighed.places]
        return np.concatenate([np.arange(p.start, p.stop) for p in places], dtype=np.intp)

    @cached_property
    def precision(self) -> Array:
        """Inverse of the covariance beforehand, zero for exact ones, shape (u, u)."""
        free = self.deviation > 0
        found = np.diag(np.where(free, 1 / np.where(free, self.deviation, 1.0) ** 2, 0.0))
        if self.geometry is not None:
            use = self.of_geometry
            found[np.ix_(use, use)] = np.linalg.inv(self.geometry + _FRAME**2 * np.eye(len(use)))
        if self.weighed is not None:
            use = self.of_weighed
            sigma, told = self.deviation[use], self.deviation[use] > 0
            scale, use = sigma[told], use[told]
            spread = self.weighed.covariance[np.ix_(told, told)] / np.outer(scale, scale)
            found[np.ix_(use, use)] = np.linalg.inv(spread) / np.outer(scale, scale)
        return found

    @cached_property
    def names(self) -> tuple[str, ...]:
        """A name for every component, shape (u,)."""
        return tuple(name for u in self.entries for name in u.names(self.m))

    def believed(self, asked: Collection[Key]) -> CalibrationParameters:
        """The same with the errors that the readings ask for."""
        return replace(
            self,
            entries=tuple(
                replace(u, deviation=np.full_like(u.deviation, u.suspected), suspected=None)
                if (u.owner, u.key, u.run) in asked
                else u
                for u in self.entries
            ),
        )

    def widened(self, deviation: Array) -> CalibrationParameters:
        """The same with other 1-sigma, shape (u,), each by itself."""
        return replace(
            self,
            geometry=None,
            weighed=None,
            entries=tuple(
                replace(u, deviation=deviation[self.places[u.owner, u.key, u.run]])
                for u in self.entries
            ),
        )

    def with_last_load(self, experiment: Experiment) -> CalibrationParameters:
        """The same with what the last load of an experiment is more than the first, at the end, and
        for the last run, which goes on with that load.

        Args:
            experiment: With a further load and a run that continues another one.
        """
        *_, entry = _further_loads(experiment)
        last = experiment.runs[-1]
        assert last.continues is not None
        return replace(
            self,
            entries=(*self.entries, entry),
            carried={**self.carried, last.name: entry.key},
            continued={**self.continued, last.name: last.continues},
        )

    def components(self) -> Iterator[tuple[int, CalibrationParameter, int]]:
        """Place in the vector, the error and the component of it, one after the other."""
        place = 0
        for unknown in self.entries:
            for component in range(len(unknown.mean)):
                yield place, unknown, component
                place += 1


@dataclass(frozen=True, eq=False)
class CalibrationValues:
    """Values of all systematic errors, and what each run needs of them."""

    calibration_parameters: CalibrationParameters
    values: Array
    """Shape (u,)."""

    def of(self, name: str, instrument: Instrument, run: str) -> dict[str, Array]:
        """Values of an instrument's terms in a run."""
        places = self.calibration_parameters.places_of(name, instrument, run)
        return {key: self.values[place] for key, place in places.items()}

    def body(self, first: Array, run: str) -> Array:
        """The ten of :data:`steelyard.inertia.LINEAR_PARAMETERS` of what a run carried, shape (10,).

        Args:
            first: Those of the first load, shape (10,).
            run: Its name.
        """
        place = self.calibration_parameters.place_of_load(run)
        return first if place is None else first + self.values[place]

    def delay(self, clock: str, run: str) -> float:
        """Of a clock in a run [s]."""
        return float(self.values[self.calibration_parameters.place(clock, "delay", run)][0])

    @property
    def drag(self) -> float:
        """How far the platform feels the inertia of its cables."""
        return float(self.values[self.calibration_parameters.places[ROBOT, DRAG, None]][0])

    @property
    def hoses(self) -> Array:
        """Of all hoses that are stated, one after the other, see
        :data:`steelyard.robot.surroundings.HOSE`, shape (9 h,).
        """
        parts = hose_keys(self.calibration_parameters)
        return self.of_robot(*parts) if parts else np.zeros(0)

    def of_robot(self, *parts: tuple[str, int], run: str | None = None) -> Array:
        """Values of several parameters of the robot, one after the other; zero where they are not
        there.

        Args:
            *parts: Key and size of each.
            run: In which they act, where some have values of their own in runs; None: in all.
        """
        places = self.calibration_parameters.places
        found = []
        for key, size in parts:
            place = places.get((ROBOT, key, run), places.get((ROBOT, key, None)))
            found.append(np.zeros(size) if place is None else self.values[place])
        return np.concatenate(found)

    def swivel(self, run: str | None = None) -> Array:
        """Friction where cables turn about their anchors [N m], shape (m,); (0,) where forces are
        read, beside which it is of no account.

        Args:
            run: In which it acts; None: in those of the first load.
        """
        there = (ROBOT, SWIVEL, None) in self.calibration_parameters.places
        m = self.calibration_parameters.m
        return self.of_robot((SWIVEL, m), run=run) if there else np.zeros(0)

    @property
    def pulling(self) -> tuple[int, int]:
        """Number of hoses that are stated, and of anchors at which cables rub."""
        return len(self.hoses) // sum(size for _, size in HOSE), len(self.swivel())

    @property
    def gravity(self) -> Array:
        """World frame [m/s^2], shape (3,)."""
        return self.values[self.calibration_parameters.places[ROBOT, "gravity", None]]

    @property
    def geometry(self) -> dict[str, Array]:
        """Anchors [m] in the world and attachments [m] in the platform frame, three numbers a cable,
        shape (3 m,) each.
        """
        places = self.calibration_parameters.places
        return {
            f"{key}s": self.values[places[ROBOT, key, None]] for key in ("anchor", "attachment")
        }


def clock_of(experiment: Experiment, name: str) -> str:
    """The clock of an instrument; one without a name has one of its own."""
    return experiment.instruments[name].clock or name


def gather(experiment: Experiment) -> CalibrationParameters:
    """Every systematic error that the description of an experiment allows for, exact ones too."""
    entries: list[CalibrationParameter] = []
    used = dict.fromkeys(name for run in experiment.runs for name in run.streams)
    weighed = dict.fromkeys(each.of for each in experiment.weights)
    beforehand: dict[Key, tuple[Array, Array]] = {}
    for name in [*used, *(each for each in weighed if each not in used)]:
        instrument = experiment.instruments[name]
        for term in instrument.terms(experiment.robot.m):
            deviation = (
                term.deviation if term.deviation is not None else _from_data(experiment, name, term)
            )
            if term.key == STRETCH and _may_stretch(experiment, instrument):
                deviation = np.full(term.size, _STRETCHED)
            if term.key == CABLE_DAMPING and _may_damp(experiment, name):
                deviation = np.full(term.size, DAMPED)
            if name in weighed:
                own = [w.run for w in experiment.weights if w.of == name]
                for place in own if term.prior.per == "run" else [None]:
                    beforehand[name, term.key, place] = term.mean, deviation
            runs: Sequence[Run | None] = (
                [r for r in experiment.runs if name in r.streams]
                if term.prior.per == "run"
                else [None]
            )
            entries += [
                CalibrationParameter(
                    name,
                    term.key,
                    run.name if run else None,
                    term.unit,
                    term.mean,
                    deviation,
                    None
                    if _is_of_clock(experiment, name, term)
                    else _suspected(experiment, name, term),
                )
                for run in runs
            ]
    for run in experiment.runs:
        if run.static:
            continue
        clocks: dict[str, CalibrationParameter] = {}
        for name in run.streams:
            prior, clock = experiment.delay(run, name), clock_of(experiment, name)
            mean, sigma = (
                np.atleast_1d(np.asarray(v or 0.0, dtype=np.float64))
                for v in (prior.value, prior.sigma)
            )
            # Instruments of one clock share its error: what is known of one is known of all.
            if clock not in clocks or sigma[0] < clocks[clock].deviation[0]:
                clocks[clock] = CalibrationParameter(clock, "delay", run.name, "s", mean, sigma)
        entries += clocks.values()
    robot, uncertainty = experiment.robot, experiment.uncertainty
    deviations = {
        key: np.full(size, uncertainty.get(key, 0.0))
        for key, size in (("anchor", 3 * robot.m), ("attachment", 3 * robot.m), ("gravity", 3))
    }
    if robot.covariance is not None:
        calibrated = np.sqrt(np.maximum(np.diag(robot.covariance), 0.0) + _FRAME**2)
        deviations |= zip(POINTS, np.split(calibrated, 2), strict=True)
    for key, unit, value in (
        ("anchor", "m", robot.anchors.ravel()),
        ("attachment", "m", robot.attachments.ravel()),
        ("gravity", "m/s^2", robot.gravity),
    ):
        entries.append(
            CalibrationParameter(ROBOT, key, None, unit, np.array(value), deviations[key])
        )
    drags = robot.m > 0 and bool(robot.cable.linear_density)
    share = np.full(1, _DRAGGED if drags else 0.0)
    entries.append(CalibrationParameter(ROBOT, DRAG, None, "1", share, share))
    entries += _surroundings(experiment)
    entries += _further_loads(experiment)
    keys = {load.name: _load_key(load) for load in experiment.loads[1:]}
    carried = {
        run.name: keys[load.name]
        for run in experiment.runs
        if (load := experiment.load_of(run.name)) is not None and load.name in keys
    }
    found = CalibrationParameters(tuple(entries), robot.m, robot.covariance, carried)
    if not weighed:
        return found
    gravity = (ROBOT, "gravity", None)
    beforehand[gravity] = robot.gravity, deviations["gravity"]
    return _with_weighed(found, weighed_cells(experiment, gravity, beforehand))


def _with_weighed(found: CalibrationParameters, weighed: WeighedCells) -> CalibrationParameters:
    """The same with what dead weights tell in place of what was known before; an offset that was
    another in each run is of no use in others.
    """
    told = weighed.of([place for place in weighed.places if place in found.places])
    values = told.each
    entries = tuple(
        replace(u, mean=values[key][0], deviation=values[key][1])
        if (key := (u.owner, u.key, u.run)) in values
        else u
        for u in found.entries
    )
    return replace(found, entries=entries, weighed=told)


def load_place(parameters: CalibrationParameters, load: Load) -> slice:
    """Where it stands by how much a further load differs from the first."""
    return parameters.places[ROBOT, _load_key(load), None]


def _load_key(load: Load) -> str:
    """Under which it stands by how much a further load differs from the first."""
    return f"{LOAD}.{load.name}"


def _further_loads(experiment: Experiment) -> Iterator[CalibrationParameter]:
    """By how much they differ from the first, and what is known of that."""
    if len(experiment.loads) < 2:
        return
    known = [load.known["mass"][0] for load in experiment.loads if "mass" in load.known]
    known += [load.added["mass"][0] for load in experiment.loads if "mass" in load.added]
    drawn = [load.nominal.mass for load in experiment.loads if load.nominal is not None]
    weighs = _usual_forces(experiment) / float(np.linalg.norm(experiment.robot.gravity))
    mass, size = max([*known, *drawn, weighs, 1e-9]), plausible_radius(experiment.robot)
    wide = _ANY_LOAD * np.array([mass, *[mass * size] * 3, *[mass * size**2] * 6])
    for load in experiment.loads[1:]:
        mean, deviation = _of_added(load, wide)
        yield CalibrationParameter(ROBOT, _load_key(load), None, "", mean, deviation)


def _of_added(load: Load, wide: Array) -> tuple[Array, Array]:
    """What is known of the ten linear parameters of what was added to the first load, and 1-sigma,
    shape (10,) each.

    Args:
        load: With it.
        wide: 1-sigma of those of which nothing is known, shape (10,).
    """
    mean, deviation = np.zeros(TEN), wide.copy()
    if "mass" in load.added:
        # As exact as a body of which all is known may be.
        mean[0], sigma = load.added["mass"]
        deviation[0] = max(sigma, _EXACT_PART * mean[0])
        for i, axis in enumerate(_AXES, start=1):
            if f"c{axis}" in load.added:
                place, off = load.added[f"c{axis}"]
                mean[i] = mean[0] * place
                # The first moment of a mass at a place: both may be off.
                by_mass, by_place = deviation[0] * place, mean[0] * off
                deviation[i] = max(float(np.hypot(by_mass, by_place)), _EXACT_PART * wide[i])
    return mean, deviation


def _surroundings(experiment: Experiment) -> Iterator[CalibrationParameter]:
    """What may pull at a platform on cables beside them; none, unless the readings ask for it."""
    yield from _hoses(experiment)
    if not experiment.robot.m:
        return
    size, pull = experiment.robot.size, _PULL * _usual_tensions(experiment)
    units = ("N", "N/m", "N m", "N", "m^2", "m^5", "N s/m", "N m s")
    bluff = (_BLUFF * size**2, _BLUFF * size**5)
    sizes = (pull, pull, pull * size, pull * size, *bluff, None, None)
    air = experiment.surroundings.drag
    stated: dict[str, tuple[float, float]] = {}
    if air is not None:
        # Of turning nothing is said but what that area may do at its size.
        turning = (air.value + air.sigma) * size**3
        stated = {AIR[0][0]: (air.value, air.sigma), AIR[1][0]: (0.0, turning)}
    if is_unread(experiment):
        # All that moves the platform is its weight: what decays its swings matters.
        stated |= _decay(experiment.known["mass"][0], size)
        yield _rubbing(experiment)
        # Ropes and bearings that bear another load damp and rub otherwise.
        further = [load for load in experiment.loads[1:] if "mass" in load.known]
        for load in further:
            decay = _decay(load.known["mass"][0], size)
            for run in experiment.alone(load).runs:
                yield _rubbing(experiment, run.name)
                for (key, count), unit in zip(DAMPING, units[-2:], strict=True):
                    mean, sigma = (np.full(count, value) for value in decay[key])
                    yield CalibrationParameter(ROBOT, key, run.name, unit, mean, sigma)
    for (key, count), unit, suspected in zip((*ATTACHED, *AIR), units, sizes, strict=True):
        if key in stated:
            mean, sigma = (np.full(count, value) for value in stated[key])
            yield CalibrationParameter(ROBOT, key, None, unit, mean, sigma)
        else:
            none = np.zeros(count)
            yield CalibrationParameter(ROBOT, key, None, unit, none, none, suspected)


def _decay(mass: float, size: float) -> dict[str, tuple[float, float]]:
    """What damps swings where no force is read: key -> mean and 1-sigma.

    Args:
        mass: That swings [kg].
        size: Of the robot [m].
    """
    damping = _DECAY * mass
    return {
        key: (0.0, damping * arm) for (key, _), arm in zip(DAMPING, (1.0, size**2), strict=True)
    }


def _rubbing(experiment: Experiment, run: str | None = None) -> CalibrationParameter:
    """Friction where cables turn about their anchors, in a run or in all."""
    m = experiment.robot.m
    rubs = np.full(m, _RUBBING * _usual_tensions(experiment) / m)
    return CalibrationParameter(ROBOT, SWIVEL, run, "N m", np.zeros(m), rubs)


def _hoses(experiment: Experiment) -> Iterator[CalibrationParameter]:
    """Those that are stated."""
    units = {"force": "N", "stiffness": "N/m"}
    for i, each in enumerate(experiment.surroundings.attached):
        for part, _ in HOSE:
            stated = getattr(each, part)
            numbers = stated if isinstance(stated, tuple) else (stated,)
            yield CalibrationParameter(
                ROBOT,
                f"{_HOSE}.{i + 1}.{part}",
                None,
                units.get(part, "m"),
                np.array([number.value for number in numbers]),
                np.array([number.sigma for number in numbers]),
            )


def hose_keys(parameters: CalibrationParameters) -> list[tuple[str, int]]:
    """Keys and sizes of all that is stated of hoses."""
    return [
        (each.key, len(each.mean))
        for each in parameters.entries
        if each.owner == ROBOT and each.key.startswith(f"{_HOSE}.")
    ]


def _usual_tensions(experiment: Experiment) -> float:
    """Sum of the median tensions of the first run that has any [N]; 1 where there are none."""
    for run in experiment.runs:
        force = experiment.force_instrument(run)
        values = None if force is None else run.streams[force].values.get("tension")
        if values is not None and np.any(np.abs(values) > 0):
            return float(np.nanmedian(np.abs(values))) * values.shape[1] or 1.0
    return 1.0


def _usual_forces(experiment: Experiment) -> float:
    """What the largest load weighs at most, roughly [N]: tensions that pull aside are in it."""
    if experiment.robot.m:
        return _usual_tensions(experiment)
    forces = [
        np.linalg.norm(run.streams[name].values["force"], axis=1)
        for run in experiment.runs
        if (name := experiment.force_instrument(run)) is not None
        and "force" in run.streams[name].values
    ]
    return float(np.nanmedian(np.concatenate(forces))) if forces else 1.0


def columns_of(active: NDArray[np.bool_], first: int) -> NDArray[np.intp]:
    """Column of each calibration parameter in the border; -1: not there; shape (u,).

    Args:
        active: Those that are estimated, shape (u,).
        first: Columns before them.
    """
    return np.where(active, first + np.cumsum(active) - 1, -1)


def _is_of_clock(experiment: Experiment, name: str, term: Term) -> bool:
    """Whether it is a time constant that nothing tells from an error of the clock, since no motion
    is read by it.
    """
    clock = clock_of(experiment, name)
    return term.key == TIME_CONSTANT and not any(
        clock_of(experiment, other) == clock
        for run in experiment.runs
        for other in run.streams
        if other != name and not experiment.instruments[other].commanded
    )


def _may_stretch(experiment: Experiment, instrument: Instrument) -> bool:
    """Whether nobody has stated how well the stiffness of the cables is known, and tensions tell how
    far they stretch; without these nobody knows.
    """
    return STRETCH not in instrument.calibration.model_fields_set and _stretches(experiment)


def _may_damp(experiment: Experiment, name: str) -> bool:
    """Whether nobody has stated how far the stretch of cables lags behind their tension, and these
    are read in motion.
    """
    if CABLE_DAMPING in experiment.instruments[name].calibration.model_fields_set:
        return False
    moving = any(name in run.streams and not run.static for run in experiment.runs)
    return moving and _stretches(experiment)


def _stretches(experiment: Experiment) -> bool:
    """Whether cables stretch, and tensions tell how far."""
    forces = [experiment.force_instrument(run) for run in experiment.runs]
    read = any(
        name is not None and not isinstance(experiment.instruments[name], UnreadCables)
        for name in forces
    )
    return bool(experiment.robot.cable.axial_stiffness) and read


def _from_data(experiment: Experiment, name: str, term: Term) -> Array:
    """Default 1-sigma that the contract takes from the readings, shape (k,)."""
    quantity = {"offset.force": "force", "offset.torque": "torque"}.get(term.key, "tension")
    sizes = _sizes(experiment, name, quantity)
    scale = _OFFSET_SHARE * np.nanmedian(sizes) if quantity == "tension" else np.nanmax(sizes)
    return np.full(term.size, float(scale))


def _suspected(experiment: Experiment, name: str, term: Term) -> float | None:
    """1-sigma of an error that is taken as none until the readings ask for it, in its unit."""
    if term.suspected is None or not term.of_reading:
        return term.suspected
    sizes = _sizes(experiment, name, term.of_reading)
    # What nothing has been read of is under no suspicion.
    return term.suspected * float(np.nanmedian(sizes)) if np.isfinite(sizes).any() else None


def _sizes(experiment: Experiment, name: str, quantity: str) -> Array:
    """Of all readings of a quantity, and of those under dead weights where there are no others."""
    streams = [run.streams[name] for run in experiment.runs if name in run.streams]
    readings = [each.values[quantity] for each in streams if quantity in each.values]
    readings = readings or [each.reading for each in experiment.weights if each.of == name]
    return np.asarray(np.abs(np.concatenate([np.zeros(0), *(each.ravel() for each in readings)])))


def as_tree(
    experiment: Experiment,
    calibration_parameters: CalibrationParameters,
    values: Array,
    deviations: Array,
) -> dict[str, Any]:
    """Values with their 1-sigma in the shape of ``calibration`` in ``estimate.json``; errors known
    exactly are left out.
    """
    tree: dict[str, Any] = {}
    for unknown in calibration_parameters.entries:
        place = calibration_parameters.places[unknown.owner, unknown.key, unknown.run]
        if unknown.owner == ROBOT or not unknown.deviation.any():
            continue
        single = len(unknown.mean) == 1
        pair = {
            "value": float(values[place][0]) if single else values[place],
            "standard_deviation": float(deviations[place][0]) if single else deviations[place],
        }
        for owner in _instruments_of(experiment, unknown):
            *path, last = unknown.key.split(".")
            entry = tree.setdefault(owner, {})
            for part in path:
                entry = entry.setdefault(part, {})
            if unknown.run is None:
                entry[last] = pair
            else:
                entry.setdefault(last, {})[unknown.run] = pair
    return tree


def _instruments_of(experiment: Experiment, unknown: CalibrationParameter) -> list[str]:
    """The instrument of an error; of a delay all that share the clock."""
    if unknown.key != "delay":
        return [unknown.owner]
    run = next(run for run in experiment.runs if run.name == unknown.run)
    return [name for name in run.streams if clock_of(experiment, name) == unknown.owner]
