"""Methods by their names, and those that are taken where none is named."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from steelyard.errors import InputError
from steelyard.experiment.model import Experiment
from steelyard.experiment.unread import is_unread
from steelyard.identification.methods.consistent import Consistent
from steelyard.identification.methods.force_free import ForceFree
from steelyard.identification.methods.instrumental_variables import InstrumentalVariables
from steelyard.identification.methods.least_squares import LeastSquares
from steelyard.identification.methods.maximum_likelihood import MaximumLikelihood
from steelyard.identification.methods.method import Method
from steelyard.identification.methods.recursive import Recursive
from steelyard.identification.methods.two_step import TwoStep

AVAILABLE: dict[str, Callable[[], Method]] = {
    "two-step": TwoStep,
    "force-free": ForceFree,
    "least-squares": LeastSquares,
    "instrumental-variables": InstrumentalVariables,
    "consistent": Consistent,
    "recursive": Recursive,
    "maximum-likelihood": MaximumLikelihood,
}
"""Methods of this version by name, with their default settings."""
ALL = "all"
"""Stands for every one of them."""


def default_methods(experiment: Experiment) -> tuple[str, ...]:
    """The best there is, with the usual regression beside it: the two steps of the paper, or
    without forces that on what the cables cannot carry.
    """
    if not experiment.runs:
        return (MaximumLikelihood.name,)
    if experiment.mass_walk:
        return (Recursive.name,)
    baseline = ForceFree.name if is_unread(experiment) else TwoStep.name
    return (baseline, MaximumLikelihood.name)


def chosen_methods(
    methods: Sequence[Method | str], ready: Mapping[str, Method] | None = None
) -> list[Method]:
    """Estimators, each once where it is named.

    Args:
        methods: Estimators or their names; ``all`` stands for every one; none: the best there is,
            with the two steps of the paper beside it.
        ready: Name -> estimator to take in place of the one with default settings.

    Raises:
        InputError: There is none of a name.
    """
    own = ready or {}
    if not isinstance(methods, Sequence):
        raise InputError(
            "--method: expected names of methods or estimators, found"
            f" {type(methods).__name__}; give a list of them"
        )
    chosen: dict[str | int, Method] = {}
    for i, method in enumerate(methods or (TwoStep.name, MaximumLikelihood.name)):
        if callable(method):
            chosen[i] = method
            continue
        if method != ALL and method not in AVAILABLE:
            raise InputError(
                f"--method: expected one of {', '.join(AVAILABLE)}, or all, found '{method}';"
                " choose one of these"
            )
        for name in AVAILABLE if method == ALL else (method,):
            chosen[name] = own[name] if name in own else AVAILABLE[name]()
    return list(chosen.values())
