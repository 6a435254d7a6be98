"""All methods over one experiment, and what `identify` writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.identification.estimate import BEST_FIRST, FORMAT, Estimate
from steelyard.identification.two_step import TwoStep
from steelyard.inertia import Inertia

Method = Callable[[Experiment, Callable[[str, float], None] | None], Estimate]

AVAILABLE: dict[str, type[TwoStep]] = {"two-step": TwoStep}
"""Methods of this version by name."""


@dataclass(frozen=True, eq=False)
class Identification:
    """Estimates of one experiment."""

    experiment: str
    nominal: Inertia | None
    estimates: Mapping[str, Estimate]

    @property
    def result(self) -> str:
        """Name of the best method that ran."""
        return next(name for name in BEST_FIRST if name in self.estimates)

    def to_dict(self) -> dict[str, Any]:
        """Plain values in the shape of ``estimate.json``."""
        return {
            "format": FORMAT,
            "experiment": self.experiment,
            "nominal": self.nominal.to_dict() if self.nominal else None,
            "result": self.result,
            "estimates": {name: estimate.to_dict() for name, estimate in self.estimates.items()},
        }


def identify(
    experiment: Experiment, methods: Sequence[Method] = (), progress: Callable[[str, float], None] | None = None
) -> Identification:
    """Estimate the inertial parameters of the platform.

    Args:
        experiment: With at least one run.
        methods: Estimators; none: the best there is, with the two steps of the paper beside it.
        progress: Is told what is being done and the fraction that is done.

    Raises:
        InputError: A run lacks what a method needs.
    """
    chosen = list(methods) or [TwoStep()]
    estimates = [method(experiment, progress) for method in chosen]
    return Identification(experiment.name, experiment.robot.platform, {e.method: e for e in estimates})


def method_named(name: str) -> type[TwoStep]:
    """Method by its name.

    Raises:
        InputError: There is none of that name.
    """
    if name not in AVAILABLE:
        raise InputError(
            f"--method: expected one of {', '.join(AVAILABLE)}, or all, found '{name}'; choose one of these"
        )
    return AVAILABLE[name]
