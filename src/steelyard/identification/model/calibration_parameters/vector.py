"""The systematic errors of an experiment as one vector: what each is, what is known of it
beforehand, and where it stands.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.identification.model.calibration_parameters.keys import (
    APPARENT,
    BENDING_KEYS,
    LOAD,
    ROBOT,
    element_of,
)
from steelyard.identification.weighing.tables import WeighedCells
from steelyard.instruments import Instrument
from steelyard.instruments.base import LATENCY
from steelyard.instruments.length import ROLLER, ROLLER_AXIS
from steelyard.instruments.tension import CROSSTALK
from steelyard.robot.covariance import POINTS

FRAME = 1e-6
"""1-sigma of frames that a calibration has defined [m]."""
_AXES = "xyz"
_OF_LOADS = (
    "mass",
    *(f"first moment {axis}" for axis in _AXES),
    *(f"inertia {axes} about the origin" for axes in ("xx", "yy", "zz", "yz", "xz", "xy")),
)
"""What a load is more than the first, as people would say it."""
_PER_CABLE = frozenset({"offset", "gain", "friction", "presliding_start", ROLLER})
_NEGLIGIBLE = 0.1
"""Part of the 1-sigma of devices that have an error at all, below which it is another's doing."""


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
    instead: bool = False
    """Whether it is looked at only in the place of another for which they ask."""

    @property
    def full_key(self) -> Key:
        """Owner, key and run."""
        return self.owner, self.key, self.run

    @property
    def is_absent(self) -> bool:
        """Whether it is taken as none unless the readings ask for it."""
        return self.suspected is not None and not self.deviation.any()

    @property
    def is_load(self) -> bool:
        """Whether it is no error at all, but a part of a body: what a further load is more than the
        first, or what moves in one.
        """
        return self.owner == ROBOT and self.key.startswith((f"{LOAD}.", f"{APPARENT}."))

    @property
    def bends(self) -> bool:
        """Whether it is a part of the matrix by which the platform bends."""
        return self.full_key in BENDING_KEYS

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
        if self.key == ROLLER_AXIS:
            return [f"{where} {i % 2 + 1} of cable {i // 2 + 1}" for i in range(size)]
        if self.key == CROSSTALK:
            pairs = [(i, j) for i in range(m) for j in range(m) if i != j]
            return [f"{where} of cable {i + 1} from cable {j + 1}" for i, j in pairs]
        if self.is_load:
            what, _, load = self.key.partition(".")
            of = f"of what load '{load}' has more"
            if what == APPARENT:
                of = f"of what moves in load '{load}'"
            return [f"{each} {of}" for each in _OF_LOADS]
        if self.bends:
            elements = (element_of(self.key, i) for i in range(size))
            return [f"{where} {_AXES[i % 3]}{_AXES[j % 3]}" for i, j in elements]
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
    apparent: Mapping[str, str] = field(default_factory=dict)
    """Run in motion -> key of how a load in which something moves answers accelerations there; runs
    of rigid bodies are not there."""
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
            u.full_key: slice(int(end) - len(u.mean), int(end))
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
        """Key of each of an instrument's terms -> where it stands as it acts in a run, in their
        order.

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
        """Where it stands by how much the body of a run differs from the first load; None: it is
        the first load.
        """
        key = self.carried.get(run)
        return None if key is None else self.places[ROBOT, key, None]

    def place_of_apparent(self, run: str) -> slice | None:
        """Where it stands how what a run carried answers accelerations beside what it weighs; None:
        it is rigid, or at rest.
        """
        key = self.apparent.get(run)
        return None if key is None else self.places[ROBOT, key, None]

    def place_of_latency(self, name: str) -> slice | None:
        """Where it stands by how much an instrument is later than its clock says; None: it shares
        none.
        """
        return self.places.get((name, LATENCY, None))

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
            found[np.ix_(use, use)] = np.linalg.inv(self.geometry + FRAME**2 * np.eye(len(use)))
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

    @cached_property
    def absent(self) -> Mapping[Key, CalibrationParameter]:
        """Errors that are taken as none unless the readings ask for them, as they are then."""
        return {each.full_key: each for each in self.entries if each.is_absent}

    def believed_since(self, before: CalibrationParameters) -> dict[Key, CalibrationParameter]:
        """Errors for which the readings have asked, as they are when they are none.

        Args:
            before: The same before anything was asked for.
        """
        return {key: none for key, none in before.absent.items() if key not in self.absent}

    def believed(self, asked: Collection[Key]) -> CalibrationParameters:
        """The same with the errors that the readings ask for."""
        return replace(
            self,
            entries=tuple(
                replace(u, deviation=np.full_like(u.deviation, u.suspected), suspected=None)
                if u.full_key in asked
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
                replace(u, deviation=deviation[self.places[u.full_key]]) for u in self.entries
            ),
        )

    def components(self) -> Iterator[tuple[int, CalibrationParameter, int]]:
        """Place in the vector, the error and the component of it, one after the other."""
        place = 0
        for unknown in self.entries:
            for component in range(len(unknown.mean)):
                yield place, unknown, component
                place += 1


def columns_of(active: NDArray[np.bool_], first: int) -> NDArray[np.intp]:
    """Column of each calibration parameter in the border; -1: not there; shape (u,).

    Args:
        active: Those that are estimated, shape (u,).
        first: Columns before them.
    """
    return np.where(active, first + np.cumsum(active) - 1, -1)
