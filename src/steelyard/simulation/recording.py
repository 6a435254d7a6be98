"""A virtual recording: systematic errors, noise and clocks on what instruments would read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.arrays import Array
from steelyard.errors import InputError
from steelyard.experiment.recording import Stream
from steelyard.instruments import Instrument
from steelyard.instruments.base import TIME_CONSTANT, Term, is_absent
from steelyard.instruments.equations import predict
from steelyard.instruments.length import CABLE_DAMPING
from steelyard.instruments.tension import rolled_along
from steelyard.motion.state import State
from steelyard.robot.kinematics import attachments_at
from steelyard.robot.model import Robot
from steelyard.simulation.disturbances import disturbed
from steelyard.simulation.response import Response

_PAST = 4
"""Instants that stand for the past of a filtered reading."""
_STEP = 0.002
"""At which the rollers, and the lengths of cables that damp, are followed [s]."""
_LATEST_START = 5.0
"""Clocks show an arbitrary time at the common event, up to this [s]."""


@dataclass(frozen=True)
class Errors:
    """Systematic errors drawn for one instrument in one run."""

    calibration: Mapping[str, Array]
    """Term -> value."""
    delay: float
    """[s]"""


def draw_errors(
    instruments: Mapping[str, Instrument], m: int, runs: list[str], rng: np.random.Generator
) -> dict[str, dict[str, Errors]]:
    """Draw every systematic error with its prior.

    Returns:
        Run -> instrument -> its errors.
    """
    constant = {name: _drawn_terms(each, m, rng) for name, each in instruments.items()}
    drawn: dict[str, dict[str, Errors]] = {}
    for run in runs:
        delays: dict[str, float] = {}
        drawn[run] = {}
        for name, instrument in instruments.items():
            own = dict(constant[name])
            for term in instrument.terms(m):
                if term.prior.per == "run":
                    own[term.key] = _drawn_term(term, rng)
            delay = instrument.calibration.delay
            value = 0.0
            if delay:
                mean, deviation = _scalar(delay.value), _scalar(delay.sigma)
                value = float(_drawn(np.array(mean), np.array(deviation), rng))
            # One clock has one error, whatever reads it.
            value = delays.setdefault(instrument.clock or f"instrument {name}", value)
            drawn[run][name] = Errors(own, value)
    return drawn


def _drawn_terms(instrument: Instrument, m: int, rng: np.random.Generator) -> dict[str, Array]:
    """Every systematic error of an instrument, drawn with its prior."""
    return {
        # What good devices do not have takes no part in the draw.
        term.key: term.mean if is_absent(term) else _drawn_term(term, rng)
        for term in instrument.terms(m)
    }


def _drawn_term(term: Term, rng: np.random.Generator) -> Array:
    drawn = _drawn(term.mean, term.deviation, rng)
    return np.abs(drawn) if term.positive else drawn


def _drawn(mean: Array, deviation: Array | None, rng: np.random.Generator) -> Array:
    """Of a normal distribution."""
    normal = rng.standard_normal(mean.shape)
    return mean + normal * (0.0 if deviation is None else deviation)


def _scalar(value: float | tuple[float, ...] | None) -> float:
    return 0.0 if value is None else float(np.mean(value))


def record(
    response: Response,
    instruments: Mapping[str, Instrument],
    errors: Mapping[str, Errors],
    robot: Robot,
    command: Response,
    rng: np.random.Generator,
) -> tuple[dict[str, Stream], dict[str, float]]:
    """Record one run.

    Args:
        response: What the platform did; time 0 is the common event.
        instruments: With their rates.
        errors: Drawn for this run.
        robot: Its cables.
        command: The motion that the platform should have made.
        rng: Of noise and of the clocks.

    Returns:
        Instrument -> stream, and instrument -> time of the common event on its clock [s].
    """
    streams = {}
    sync = {}
    clocks: dict[str, tuple[float, float]] = {}
    for name, instrument in instruments.items():
        rate = instrument.rate or 0.0
        clock = instrument.clock or f"instrument {name}"
        origin, phase = clocks.setdefault(clock, (rng.uniform(0, _LATEST_START), rng.uniform()))
        times = np.arange(phase / rate, response.duration, 1 / rate)
        if len(times) < 2:
            raise InputError(
                f"instrument '{name}': expected a rate of at least two samples in"
                f" {response.duration:g} s, found {rate:g} Hz; raise it"
            )
        source = command if instrument.commanded else response
        readings = _filtered(instrument, robot, source, times, errors[name].calibration)
        quantities = {q.name: q for q in instrument.quantities(robot.m)}
        values = {}
        for key, value in readings.items():
            for each in quantities[key].disturbed:
                value = disturbed(value, each, times, source, rng)
            values[key] = _noisy(value, quantities[key].noise or 0.0, rng)
        stamps = times + errors[name].delay + origin
        streams[name] = Stream(_late(stamps, instrument.calibration.jitter, rng), values, name)
        sync[name] = origin
    return streams, sync


def _filtered(
    instrument: Instrument,
    robot: Robot,
    source: Response,
    times: Array,
    calibration: Mapping[str, Array],
) -> dict[str, Array]:
    """Readings behind the filter of an amplifier, where the instrument has one.

    A first-order filter is the mean over the past with exponential weights, which for what changes
    smoothly within it is a sum over a few instants (Gauss and Laguerre).
    """
    constant = float(np.squeeze(calibration.get(TIME_CONSTANT, 0.0)))
    if instrument.remembers:
        source = _Remembering(source, robot, calibration)
    damping = calibration.get(CABLE_DAMPING, np.zeros(2))
    if np.any(damping):
        source = _Damping(source, robot, damping)
    if not constant:
        return dict(predict(instrument, robot, source.at(times), calibration))
    found: dict[str, Array] = {}
    for earlier, weight in _past(times, constant, source.duration):
        for key, value in predict(instrument, robot, source.at(earlier), calibration).items():
            found[key] = found.get(key, 0.0) + weight * value
    return found


def _past(times: Array, constant: float, duration: float) -> Iterator[tuple[Array, float]]:
    """Instants before times that stand for the past of a first-order filter [s], and their
    weights.
    """
    for node, weight in zip(*np.polynomial.laguerre.laggauss(_PAST), strict=True):
        yield np.clip(times - constant * node, 0.0, duration), float(weight)


@dataclass(frozen=True)
class _Damping:
    """A response whose cables stretch as a first-order filter of their tensions, as a spring and a
    damper beside each other do, and less where they are fed.
    """

    response: Response
    robot: Robot
    lags: Array
    """See :class:`.LengthCalibration` [s], shape (2,)."""

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self.response.duration

    def at(self, times: Array) -> State:
        """See :class:`.Response`."""
        state = self.response.at(times)
        if state.tension is None:
            return state
        stretching = np.zeros_like(state.tension)
        for earlier, weight in _past(times, self.lags[0], self.duration):
            past = self.response.at(earlier)
            stretching += weight * (past.tension if past.stretching is None else past.stretching)
        before, after = (
            self._reach(np.clip(times + step, 0.0, self.duration)) for step in (-_STEP, _STEP)
        )
        fed = (after - before) / (after + before) / _STEP
        return replace(state, stretching=stretching * (1 - self.lags[1] * fed))

    def _reach(self, times: Array) -> Array:
        """From the anchors to the platform [m], shape (n, m)."""
        state = self.response.at(times)
        points = attachments_at(state.position, state.rotation, self.robot)
        return np.asarray(np.linalg.norm(self.robot.anchors - points, axis=-1))


@dataclass(frozen=True)
class _Remembering:
    """A response whose states say how far the friction of the rollers has built up."""

    response: Response
    robot: Robot
    errors: Mapping[str, Array]
    """Of the sensors behind them."""

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self.response.duration

    @cached_property
    def _rolled(self) -> tuple[Array, Array]:
        """Times [s], shape (k,), and what the rollers remember then, shape (k, m)."""
        times = np.arange(0.0, self.duration + _STEP, _STEP)
        state = self.response.at(times)
        along = rolled_along(self.robot, state.position, state.rotation, self.errors)
        return times, along.value

    def at(self, times: Array) -> State:
        """See :class:`.Response`."""
        known, values = self._rolled
        rolling = np.column_stack([np.interp(times, known, column) for column in values.T])
        return replace(self.response.at(times), rolling=rolling)


def _late(stamps: Array, jitter: float | None, rng: np.random.Generator) -> Array:
    """Time stamps that are late by the absolute value of a normal number, in the order in which
    they were taken.
    """
    if not jitter:
        return stamps
    late = stamps + np.abs(rng.normal(0.0, jitter, len(stamps)))
    return np.asarray(np.maximum.accumulate(late))


def _noisy(value: Array, sigma: float, rng: np.random.Generator) -> Array:
    """Readings with noise; rotations of shape (n, 3, 3) are turned by it."""
    if not sigma:
        return value
    if value.ndim == 3:
        turned = Rotation.from_rotvec(rng.normal(0.0, sigma, (len(value), 3)))
        return np.asarray(value @ turned.as_matrix())
    return value + rng.normal(0.0, sigma, value.shape)
