"""An experiment as an immutable value: raw streams, each on its own clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from steelyard import tables
from steelyard.arrays import Array
from steelyard.display import printable
from steelyard.errors import InputError
from steelyard.experiment.columns import stream_columns
from steelyard.experiment.observations import DeadWeights, SeenFrequencies
from steelyard.experiment.recording import Run
from steelyard.experiment.surroundings import Surroundings
from steelyard.inertia import Inertia
from steelyard.instruments import Instrument
from steelyard.instruments.base import DEFAULT_DELAY, Prior, exact, sigma
from steelyard.robot.model import Robot

if TYPE_CHECKING:
    import pandas as pd
    import polars as pl

ClockChoice = Literal["own", "common"]
"""Whose times a table has."""
_MOST_SHOWN = 12
"""Runs that are shown one by one."""


@dataclass(frozen=True, eq=False)
class Load:
    """A body that the platform carried in some of the runs, itself included."""

    name: str
    known: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Body parameter (:data:`steelyard.inertia.BODY_PARAMETERS`) -> value and 1-sigma, where known
    beforehand."""
    nominal: Inertia | None = None
    """As it was drawn; None: nobody says."""
    rigid: bool = True
    """Whether nothing moves in it."""
    added: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """The same as ``known``, of what it has more than the first load: ``mass``, ``cx``, ``cy``,
    ``cz`` of a weighed body that was added."""


@dataclass(frozen=True)
class Datum:
    """What the world frame is, for the calibration of a robot: one of these."""

    anchors: tuple[int, ...] = ()
    """Numbers of anchors, from 1: it is the frame in which they are nearest to those drawn."""
    pose: str | None = None
    """Run of poses at rest, whose first pose is as its command or instruments say."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """One robot, the instruments on it, and the runs recorded with them."""

    name: str
    robot: Robot
    instruments: Mapping[str, Instrument]
    runs: tuple[Run, ...]
    known: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Body parameter (:data:`steelyard.inertia.BODY_PARAMETERS`) -> value and 1-sigma, where known
    beforehand."""
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    """1-sigma of the robot file's ``anchor`` and ``attachment`` [m] and ``gravity`` [m/s^2], per
    coordinate."""
    source: str = ""
    """File that it was read from."""
    surroundings: Surroundings = field(default_factory=Surroundings)
    """What acts on the platform beside its cables."""
    frequencies: tuple[SeenFrequencies, ...] = ()
    """Observations that belong to no motion."""
    weights: tuple[DeadWeights, ...] = ()
    """What is known of force sensors by dead weights."""
    datum: Datum | None = None
    """What the world frame is, where it is stated: its calibration looks at it."""
    loads: tuple[Load, ...] = ()
    """Bodies that the runs carried, where there are several; ``known`` and the nominal platform of
    the robot are those of the first."""
    mass_assumed: bool = False
    """Whether the mass under ``known`` is an assumption, since nothing weighs the platform: first
    moment and inertia are told in multiples of it."""
    length_noise: float | None = None
    """1-sigma by which unstrained lengths are off a constant while winches are locked [m]; None:
    that they are constant is not used."""
    mass_walk: float = 0.0
    """Density of the random walk of the mass, where something runs out or in, at the centre of
    gravity [kg/sqrt(s)]; what is known of the mass is that at the beginning. 0: it stays."""
    origin: Array = field(default_factory=lambda: np.zeros(3))
    """Where the origin of the platform frame is in which all was stated, in the one in which it is
    told here [m], shape (3,)."""

    @classmethod
    def from_frames(
        cls,
        robot: Robot | str | Path,
        instruments: Mapping[str, Instrument | Mapping[str, Any]],
        runs: Mapping[str, Mapping[str, Any]],
        *,
        sync: Literal["auto"] | Mapping[str, float] | None = None,
        clocks: Mapping[str, str] | None = None,
        name: str | None = None,
        known: Mapping[str, Any] | None = None,
        loads: Mapping[str, Any] | None = None,
        uncertainty: Mapping[str, Any] | None = None,
        attached: Sequence[Mapping[str, Any]] | None = None,
        drag: Mapping[str, Any] | None = None,
        bending: Mapping[str, Any] | float | None = None,
        datum: Mapping[str, Any] | None = None,
        weighed: bool = True,
    ) -> Experiment:
        """An experiment of what is in memory; it is checked as a file is.

        Every stream is a frame of Polars or pandas, a mapping of names to arrays, or a structured
        array of NumPy, with the columns of its kind; an array of several columns may stand under
        the name of its quantity (``tension``, shape (n, m); ``position``, shape (n, 3);
        ``orientation``, shape (n, 3, 3) or (n, 4)). Where names or units differ,
        :class:`steelyard.RecordedFrame` says so.

        Args:
            robot: A robot, the name of a bundled one, or the path of its file.
            instruments: Name -> instrument, such as ``steelyard.Tension(noise=5)``, or its keys.
            runs: Name -> instrument -> stream; beside the streams the keys of a run: ``static``,
                ``window``, ``load``, ``winches``, ``sync``.
            sync: ``auto``: how far the clocks are apart is found from the data; instrument -> time
                of one common event on its clock [s]; None: the clocks agree within their ``delay``.
            clocks: Instrument -> name of its clock. Instruments of one clock share its times and
                its error; so do those that read one and the same frame. Any other has a clock of
                its own.
            name: Of the experiment.
            known: As in an experiment file.
            loads: The same.
            uncertainty: The same.
            attached: The same.
            drag: The same.
            bending: The same.
            datum: The same.
            weighed: Whether a body is to be told by forces; else it is for a calibration.

        Raises:
            InputError: Anything that does not fit the contract.
        """
        # What reads an experiment needs this class.
        assemble = import_module("steelyard.experiment.memory.from_frames").experiment_from_frames
        experiment = assemble(
            robot,
            instruments,
            runs,
            sync=sync,
            clocks=clocks,
            weighed=weighed,
            name=name,
            known=known,
            loads=loads,
            uncertainty=uncertainty,
            attached=attached,
            drag=drag,
            bending=bending,
            datum=datum,
        )
        assert isinstance(experiment, cls)
        return experiment

    def __repr__(self) -> str:
        instruments = ", ".join(
            f"{printable(name)} ({each.kind})" for name, each in self.instruments.items()
        )
        runs = [f"  {run!r}" for run in self.runs[:_MOST_SHOWN]]
        if len(self.runs) > _MOST_SHOWN:
            runs.append(f"  and {len(self.runs) - _MOST_SHOWN} more runs")
        return "\n".join(
            [f"Experiment '{printable(self.name)}' on {self.robot!r}", f"  {instruments}", *runs]
        )

    def run(self, name: str) -> Run:
        """A run by its name.

        Raises:
            InputError: There is none of that name.
        """
        for run in self.runs:
            if run.name == name:
                return run
        names = ", ".join(run.name for run in self.runs)
        raise InputError(f"run: expected one of {names}, found '{name}'; choose one of these")

    def load_of(self, run: str) -> Load | None:
        """What the platform carried in a run; None: there are no loads, it is one body throughout.

        Args:
            run: Its name.
        """
        if not self.loads:
            return None
        own = self.run(run).load
        return next((each for each in self.loads if each.name == own), self.loads[0])

    def moves_within(self, run: str) -> bool:
        """Whether something moved in what the platform carried while it moved.

        Args:
            run: Its name.
        """
        load = self.load_of(run)
        return load is not None and not load.rigid and not self.run(run).static

    def of_load(self, load: Load) -> Experiment:
        """The same runs, with what is known of one of the loads.

        Args:
            load: One of them.
        """
        robot = self.robot
        if load.nominal is not robot.platform:
            robot = replace(robot, platform=load.nominal)
        return replace(self, robot=robot, known=load.known)

    def alone(self, load: Load) -> Experiment:
        """An experiment of the runs that carried one of the loads.

        Args:
            load: One of them.
        """
        runs = tuple(run for run in self.runs if self.load_of(run.name) is load)
        return replace(self.of_load(load), runs=runs, loads=())

    def without(self, *instruments: str) -> Experiment:
        """The experiment without what some instruments have recorded.

        Args:
            *instruments: Names; not that of the forces of a run.

        Raises:
            InputError: There is no such instrument, or a run would be without forces.
        """
        known = dict.fromkeys(name for run in self.runs for name in run.streams)
        for name in instruments:
            if name not in known:
                raise InputError(
                    f"--without: expected one of {', '.join(known)}, found '{name}'; choose one of"
                    " these"
                )
            if self.is_force(name):
                raise InputError(
                    f"--without: expected an instrument that measures the motion, found '{name}',"
                    " which measures the forces; choose another"
                )
        runs = tuple(
            replace(run, streams={k: v for k, v in run.streams.items() if k not in instruments})
            for run in self.runs
        )
        return replace(self, runs=runs)

    def columns(self, run: str, instrument: str, *, clock: ClockChoice = "own") -> dict[str, Array]:
        """What an instrument recorded in a run, as the columns of the contract in SI; shape (n,)
        each.

        Args:
            run: Its name.
            instrument: Its name.
            clock: Of ``t``: the instrument's ``own``, or ``common`` for all of a run, see
                :meth:`common_time`.

        Raises:
            InputError: There is none of that name.
        """
        recorded = self.run(run)
        if instrument not in recorded.streams:
            names = ", ".join(recorded.streams)
            raise InputError(
                f"run '{run}': expected one of {names}, found '{instrument}'; choose one of these"
            )
        stream = recorded.streams[instrument]
        time = self.common_time(recorded, instrument) if clock == "common" else stream.time
        columns = stream_columns(
            None if recorded.static else time,
            stream.values,
            self.instruments[instrument],
            self.robot.m,
        )
        return {name: values for name, (values, _) in columns.items()}

    def digests(self) -> dict[str, str]:
        """Run -> what tells its readings from all others, whatever their clocks: the beginning of
        the SHA-256 of its forces, or of all that was measured where nobody reads forces.
        """
        found = {}
        for run in self.runs:
            force = self.force_instrument(run)
            names = [n for n in run.streams if self.instruments[n].is_measurement]
            if force is not None and not self.instruments[force].stands_in(self.robot.m):
                names = [force]
            digest = sha256()
            for name in sorted(names):
                for values in run.streams[name].values.values():
                    digest.update(np.ascontiguousarray(values).tobytes())
            found[run.name] = digest.hexdigest()[:16]
        return found

    def to_polars(self, run: str, instrument: str, *, clock: ClockChoice = "own") -> pl.DataFrame:
        """The same as a frame of Polars, null where there is no sample."""
        return tables.to_polars(self.columns(run, instrument, clock=clock))

    def to_pandas(self, run: str, instrument: str, *, clock: ClockChoice = "own") -> pd.DataFrame:
        """The same as a frame of pandas, NaN where there is no sample.

        Raises:
            SteelyardError: pandas is not installed.
        """
        return tables.to_pandas(self.columns(run, instrument, clock=clock))

    def force_instrument(self, run: Run) -> str | None:
        """The instrument whose clock defines the time of a run: its first tension or wrench
        stream.
        """
        return next((n for n in self.instruments if n in run.streams and self.is_force(n)), None)

    def is_force(self, name: str) -> bool:
        """Whether an instrument measures the forces on the platform."""
        return self.instruments[name].is_force

    def delay(self, run: Run, name: str) -> Prior:
        """Prior of the clock error of an instrument in a run [s]: as stated, else 0 for the clock
        that defines the time.
        """
        instrument = self.instruments[name]
        reference = self.force_instrument(run)
        stated = instrument.calibration.delay
        if run.found and stated is not None and name != reference:
            widest = max(DEFAULT_DELAY, float(np.max(stated.sigma or 0.0)))
            return stated.model_copy(update={"sigma": widest})
        if stated is not None:
            return stated
        if reference is None:
            return sigma(DEFAULT_DELAY)
        same_clock = (instrument.clock or name) == (self.instruments[reference].clock or reference)
        return exact() if same_clock else sigma(DEFAULT_DELAY)

    def common_time(self, run: Run, name: str, delay: float | None = None) -> Array:
        """Times of a stream on the common clock [s], shape (n,): 0 is the common event, or the
        first force sample.

        Args:
            run: One of the runs.
            name: Instrument.
            delay: Of its clock [s]; None: as known beforehand.
        """
        if run.static:
            return run.streams[name].time
        late = self._mean_delay(run, name) if delay is None else delay
        return run.streams[name].time - self.event_times(run)[name] - late

    def event_times(self, run: Run) -> Mapping[str, float]:
        """Instrument -> time on its clock from which a run in motion is counted [s]: that of the
        common event, or of the first force sample. A run whose samples are others has to be given
        it.
        """
        if run.sync:
            return run.sync
        reference = self.force_instrument(run)
        origin = float(run.streams[reference].time[0]) if reference else 0.0
        return dict.fromkeys(run.streams, origin)

    def _mean_delay(self, run: Run, name: str) -> float:
        """Delay of an instrument's clock as known beforehand [s]."""
        value = self.delay(run, name).value
        return 0.0 if value is None else float(np.mean(value))
