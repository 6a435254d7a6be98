"""``replay:RUN[@SPEED|@max]``: a recorded run, paced by its time stamps."""

from __future__ import annotations

import time

import numpy as np

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.live.message import Arrival
from steelyard.live.sources.source import Received

_STEP = 0.1
"""Of recorded time that is handed over at once where nobody waits [s]."""


class ReplayedRun:
    """A run whose samples arrive again."""

    def __init__(self, experiment: Experiment, run: Run, speed: float) -> None:
        self._run, self._speed = run, speed
        self._times = {name: experiment.common_time(run, name) for name in run.streams}
        self._first = min(float(each[0]) for each in self._times.values())
        self._last = max(float(each[-1]) for each in self._times.values())
        self._started: float | None = None
        self._now = self._first

    def receive(self, seconds: float) -> Received:
        """See :meth:`.SampleSource.receive`."""
        if self._started is None:
            self._started = time.monotonic()
        if np.isinf(self._speed):
            until = self._now + _STEP
        else:
            time.sleep(seconds)
            until = self._first + (time.monotonic() - self._started) * self._speed
        arrivals = []
        for name, times in self._times.items():
            first, last = (int(i) for i in np.searchsorted(times, [self._now, until]))
            if last > first:
                stream = self._run.streams[name].at_rows(slice(first, last))
                arrivals.append(Arrival(name, stream))
        self._now = until
        return Received(tuple(arrivals), ended=until > self._last)

    def close(self) -> None:
        """See :meth:`.SampleSource.close`."""


def asked_for(url: str) -> tuple[str, float]:
    """Run and speed of an address.

    Raises:
        InputError: It is no such address.
    """
    name, at, speed = url.removeprefix("replay:").rpartition("@")
    if not at:
        return speed, 1.0
    if speed == "max":
        return name, np.inf
    try:
        factor = float(speed)
    except ValueError:
        factor = 0.0
    if not 0 < factor < np.inf:
        raise InputError(
            f"--source: expected replay:RUN@SPEED with a positive number or 'max', found '{url}';"
            " leave it out for the speed of the recording"
        )
    return name, factor
