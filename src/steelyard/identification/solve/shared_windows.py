"""Windows of a long recording, one after the other or by several processes: given what a part of
the recording tells, none of them waits for another.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import islice

import numpy as np

from steelyard.errors import InfeasibleError, InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.recording import Run
from steelyard.identification.solve.fitted import Fitted, FittedStretch
from steelyard.processes.heap import give_back
from steelyard.processes.references import packed, unpacked
from steelyard.processes.workers import result_of, worker_processes

About = Callable[[Fitted, Experiment, Run], Sequence[FittedStretch]]
"""Fits a window about what a part tells; a function of a module."""
Attempt = Sequence[FittedStretch] | InputError | InfeasibleError | np.linalg.LinAlgError
"""What a window tells, or why it tells nothing."""
_AHEAD = 2
"""Windows that each process is given, so that it need not wait for the next."""


def attempts(
    about: About, part: Fitted, experiment: Experiment, runs: Sequence[Run], jobs: int
) -> Iterator[Attempt]:
    """What each window tells, in their order; the same whatever the number of processes.

    Args:
        about: Fits one of them.
        part: The fit of a part, about which they are fitted.
        experiment: With all of the recording.
        runs: The windows.
        jobs: Processes that work at a time.

    Raises:
        InputError: One of them was killed.
    """
    jobs = min(jobs, len(runs))
    if jobs <= 1:
        yield from (_attempt(about, part, experiment, run) for run in runs)
        return
    # A window has its own part of the streams, and its body is held, whatever is known of it.
    outline = replace(experiment, runs=tuple(map(_outlined, experiment.runs)))
    task = replace(part.task, experiment=outline, force_samples=(), known=None)
    part = replace(part, task=task, force_samples=())
    given = packed((about, part, outline))
    waiting = iter(runs)
    with worker_processes(jobs) as pool:
        asked = deque(
            pool.submit(_packed_attempt, given, run) for run in islice(waiting, _AHEAD * jobs)
        )
        while asked:
            found = unpacked(result_of(asked.popleft()), _known(part, experiment))
            asked.extend(pool.submit(_packed_attempt, given, run) for run in islice(waiting, 1))
            yield found


def _attempt(about: About, part: Fitted, experiment: Experiment, run: Run) -> Attempt:
    """Of one window."""
    # What stays of each is made between large matrices.
    give_back()
    try:
        return about(part, experiment, run)
    except (InputError, InfeasibleError, np.linalg.LinAlgError) as error:
        return error


def _packed_attempt(given: bytes, run: Run) -> bytes:
    """The same in another process."""
    about, part, outline = _given(given)
    return packed(_attempt(about, part, outline, run), _known(part, outline))


@lru_cache(maxsize=1)
def _given(given: bytes) -> tuple[About, Fitted, Experiment]:
    """What every window is given: the same objects for all of them, as functions are kept by
    these.
    """
    found: tuple[About, Fitted, Experiment] = unpacked(given)
    return found


def _outlined(run: Run) -> Run:
    """A run with two samples of each stream, which say what there is."""
    streams = {name: each.at_rows(np.arange(len(each)) < 2) for name, each in run.streams.items()}
    return replace(run, streams=streams)


def _known(part: Fitted, experiment: Experiment) -> Sequence[object]:
    """What windows have in common, which stays where it is."""
    calibration = part.fit.state.calibration
    parameters = calibration.calibration_parameters
    return (experiment, experiment.robot, part.motion.state, calibration, parameters)
