"""Methods in processes of their own, beside the best one in this process."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from steelyard.errors import InputError
from steelyard.estimates.estimate import BEST_FIRST, Estimate
from steelyard.experiment.model import Experiment
from steelyard.identification.methods.method import Fit, Method, by_processes
from steelyard.identification.solve.beginning.begin import NoBalanceError
from steelyard.identification.solve.posterior import Posterior, Progress
from steelyard.processes.workers import result_of, worker_processes

Failure = InputError | NoBalanceError
"""Why a method has no estimate."""
Estimated = Callable[[Method, Experiment, dict[Fit, Posterior]], Estimate]
"""What a method says of an experiment; posteriors that several draw from are kept."""


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """What has been asked of other processes."""

    methods: dict[int, tuple[Future[list[Estimate | Failure]], int]] = field(default_factory=dict)
    """Number of a method -> where its group is worked on, and its place there."""
    pool: ProcessPoolExecutor | None = None

    def estimate(self, number: int) -> Estimate:
        """Of a method, once it is there.

        Raises:
            InputError: As the method does.
            NoBalanceError: Likewise.
        """
        future, place = self.methods[number]
        found: Estimate | Failure = result_of(future)[place]
        if isinstance(found, Failure):
            raise found
        return found

    def call(
        self, work: Callable[..., Any], *arguments: Any, progress: Progress
    ) -> Callable[[], Any]:
        """The result of something else, once it is there; where there is no other process it is
        made here and now.

        Args:
            work: A function of a module.
            arguments: Of it.
            progress: A further argument, where it is made here.
        """
        if self.pool is None:
            found = work(*arguments, progress)
            return lambda: found
        future = self.pool.submit(work, *arguments)
        return lambda: result_of(future)


@contextmanager
def elsewhere(
    methods: Sequence[Method],
    experiment: Experiment,
    estimated: Estimated,
    *,
    jobs: int,
    further: int = 0,
) -> Iterator[Elsewhere]:
    """Methods that need no fit of the best one, in processes of their own.

    Args:
        methods: All of them.
        experiment: What they look at.
        estimated: How each is asked; a function of a module.
        jobs: Processes that work at a time, this one included.
        further: Other calls to make there.
    """
    groups = _groups(methods) if jobs > 1 else []
    if not groups and (jobs <= 1 or not further):
        yield Elsewhere()
        return
    with worker_processes(min(jobs - 1, len(groups) + further)) as pool:
        asked = Elsewhere(pool=pool)
        for group in groups:
            own = [by_processes(methods[i], 1) for i in group]
            future = pool.submit(_group, estimated, own, experiment)
            asked.methods.update({number: (future, place) for place, number in enumerate(group)})
        yield asked


def _groups(methods: Sequence[Method]) -> list[list[int]]:
    """Numbers of methods that share a fit, without those that share that of the best one, which is
    drawn, and those that no other process can be given.
    """
    best = min(
        range(len(methods)),
        key=lambda i: BEST_FIRST.index(methods[i].name) if methods[i].name in BEST_FIRST else 99,
    )
    groups: dict[object, list[int]] = {}
    for i, method in enumerate(methods):
        shares = method.fit is not None and method.fit == methods[best].fit
        if i != best and not shares and _can_go(method):
            groups.setdefault(i if method.fit is None else method.fit, []).append(i)
    return list(groups.values())


def _can_go(method: Method) -> bool:
    """Whether another process can be given a method."""
    try:
        pickle.dumps(method)
    except (pickle.PicklingError, AttributeError, TypeError):
        return False
    return True


def _group(
    estimated: Estimated, methods: Sequence[Method], experiment: Experiment
) -> list[Estimate | Failure]:
    """Estimates of methods that share a fit, or why there is none."""
    posteriors: dict[Fit, Posterior] = {}
    found: list[Estimate | Failure] = []
    for method in methods:
        try:
            found.append(estimated(method, experiment, posteriors))
        except (InputError, NoBalanceError) as error:
            found.append(error)
    return found
