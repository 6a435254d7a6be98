"""Resident memory and CPU time of `watch` over a long replay: a recording again and again with shifted times, as
fast as the machine can; a line after every five minutes of it.

A row takes from the look at which its last samples were handed over until it is there to be published. What does
not hold it up is done at the next look: the oldest chunk leaves the window, and every five seconds all is judged.
All of it is in the speed.

    python benchmarks/live_memory.py EXPERIMENT RUN --duration 3600
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from steelyard.experiment.model import Experiment
from steelyard.experiment.read import read_experiment
from steelyard.experiment.recording import Run, Stream
from steelyard.identification.synchronisation import synchronise
from steelyard.live.message import Arrival
from steelyard.live.sources.source import Received
from steelyard.live.watch import watch

EVERY = 300.0
"""Of recorded time between two lines [s]."""
STEP = 0.1
"""Of recorded time that is handed over at once [s]."""


class Repeated:
    """A run again and again on one clock; it should end where it began."""

    def __init__(self, experiment: Experiment, run: Run, duration: float) -> None:
        self._streams = run.streams
        self._times = {name: experiment.common_time(run, name) for name in run.streams}
        self._first = max(float(t[0]) for t in self._times.values())
        self._length = min(float(t[-1]) for t in self._times.values()) - self._first
        self._end, self.now = duration, 0.0

    def receive(self, seconds: float) -> Received:
        """The next step, in whatever part of whatever turn it is."""
        turn = int(self.now // self._length)
        start = self.now - turn * self._length
        end = min(start + STEP, self._length)
        arrivals = []
        for name, times in self._times.items():
            a, b = (int(i) for i in np.searchsorted(times - self._first, [start, end]))
            if b > a:
                part = self._streams[name].at_rows(slice(a, b))
                shifted = times[a:b] - self._first + turn * self._length
                arrivals.append(Arrival(name, Stream(shifted, part.values, part.source)))
        self.now = turn * self._length + end + (1e-9 if end >= self._length else 0.0)
        return Received(tuple(arrivals), ended=self.now > self._end)

    def close(self) -> None:
        """Nothing to end."""


def resident() -> float:
    """Of this process [MiB]."""
    text = Path("/proc/self/status").read_text()
    return int(text.partition("VmRSS:")[2].split()[0]) / 1024


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("experiment", type=Path)
    arguments.add_argument("run")
    arguments.add_argument("--duration", type=float, default=3600.0, help="[s] of recorded time")
    arguments.add_argument("--every", type=float, default=EVERY, help="[s] of recorded time")
    given = arguments.parse_args()
    experiment = synchronise(read_experiment(given.experiment)).experiment
    source = Repeated(experiment, experiment.run(given.run), given.duration)
    began, shown, updates, behind = time.process_time(), 0.0, list[float](), list[float]()
    cpu = time.process_time()
    last = None
    for each in watch(replace(experiment, runs=()), source):
        took, cpu = time.process_time() - cpu, time.process_time()
        if each.records:
            updates.append(took / len(each.records))
            last = each.records[-1]
        elif last is not None:
            behind.append(took)
        if source.now - shown >= given.every:
            shown = source.now
            speed = source.now / (time.process_time() - began)
            told = (
                "nothing told yet"
                if last is None
                else f"mass {last.value[0]:.3f} kg at {last.time:.0f} s"
            )
            worst = f"{1e3 * np.quantile(updates, 0.99):.0f} ms" if updates else "-"
            typical = f"{1e3 * np.median(updates):.0f} ms" if updates else "-"
            print(
                f"{source.now:7.0f} s: {resident():7.1f} MiB, {speed:5.1f} s a second of CPU,"
                f" rows {typical}, 99 % of them within {worst}, looks between them within"
                f" {1e3 * max(behind, default=0.0):.0f} ms, {told}",
                flush=True,
            )
            updates, behind = updates[-10_000:], []


if __name__ == "__main__":
    main()
