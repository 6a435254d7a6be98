"""What the numbers of a comparison rest on, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

from steelyard.estimates.named_estimate import NamedEstimate, same_source
from steelyard.inertia import BODY_PARAMETERS

INDEPENDENT_NOTE = (
    "estimates of different recordings are taken as independent: errors that they share (force"
    " gain, robot file, places of the sensors) cancel in part, so that sigmas which contain them"
    " are too large here; errors that the sigmas do not contain are missing"
)
JOINT_NOTE = (
    "two loads of one fit; errors that they share (force gains, robot file, places of the sensors)"
    " cancel by their joint covariance"
)
NESTED_NOTE = (
    "the same recordings; the uncertainty of the difference is the worse method's covariance less"
    " the better's, which holds if the better one makes the best of the data"
)
BOUND_NOTE = (
    "the same recordings, so they err alike in part; the uncertainty of the difference is that of"
    " independent estimates, an upper bound, and differences in sigmas may be larger than shown"
)
SINGULAR_NOTE = (
    "combinations of parameters to which the estimates give no uncertainty are left out of a"
    " chi-square; where their covariance comes from few pieces of data, the rest of it is too small"
    " as well and the chi-square too large"
)
_ONE_NAME_NOTE = (
    "experiments of one name ('{}'), taken as independent; if they are the same recordings, the"
    " uncertainty of the difference is an upper bound"
)
_PRIOR_NOTE = "prior knowledge determines {}, so that their agreement says nothing about the data"
_DIAGONAL_NOTE = (
    "the file has no covariance; parameters are taken as uncorrelated, so that the chi-square is"
    " approximate"
)


def doubts(estimates: Sequence[NamedEstimate]) -> list[str]:
    """What about single estimates makes a comparison less sure."""
    about: dict[str, list[str]] = {}
    for a, b in combinations(estimates, 2):
        for note in _of_pair(a, b):
            about.setdefault(note, []).append(f"{a.name} and {b.name}")
    for each in estimates:
        if not each.correlated:
            about.setdefault(_DIAGONAL_NOTE, []).append(each.name)
        for note in each.estimate.notes:
            about.setdefault(note, []).append(each.name)
    return [f"{'; '.join(names)}: {note}" for note, names in about.items()]


def _of_pair(a: NamedEstimate, b: NamedEstimate) -> Iterator[str]:
    """What two estimates may share beside their recordings."""
    two_files = bool(a.source) and bool(b.source) and not same_source(a, b)
    if two_files and a.experiment and a.experiment == b.experiment:
        yield _ONE_NAME_NOTE.format(a.experiment)
    labels = a.estimate.verdict.parameters, b.estimate.verdict.parameters
    shared = [name for name in BODY_PARAMETERS if all(each.get(name) == "prior" for each in labels)]
    if shared:
        yield _PRIOR_NOTE.format(", ".join(shared))
