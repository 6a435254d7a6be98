"""Methods whose models were tested and that do not come to the same verdict: it is said beside the
result, which is one of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from steelyard.estimates.estimate import Estimate, Verdict


def with_disagreement(estimates: Mapping[str, Estimate], result: str) -> dict[str, Estimate]:
    """Estimates, of which the result says where another method contradicts its verdict.

    A baseline has no verdict that could be contradicted, and a method without numbers says nothing
    against one that has some.

    Args:
        estimates: By method.
        result: Name of the one that is the result.
    """
    told = {name: each for name, each in estimates.items() if np.isfinite(each.value).any()}
    if result not in told:
        return dict(estimates)
    of_result = told[result]
    if of_result.loads is None:
        verdicts = {name: each.verdict for name, each in told.items() if each.loads is None}
        said = replace(of_result, verdict=_contradicted(result, verdicts))
        return {**estimates, result: said}
    loads = {}
    for load, each in of_result.loads.estimates.items():
        verdicts = {
            name: other.loads.estimates[load].verdict
            for name, other in told.items()
            if other.loads is not None and load in other.loads.estimates
        }
        loads[load] = replace(each, verdict=_contradicted(result, verdicts))
    first = next(iter(loads.values()))
    said = replace(
        of_result,
        verdict=first.verdict,
        loads=replace(of_result.loads, estimates=loads),
    )
    return {**estimates, result: said}


def _contradicted(result: str, verdicts: Mapping[str, Verdict]) -> Verdict:
    """The verdict on the result, with what contradicts it."""
    own = verdicts[result]
    others = {
        name: each
        for name, each in verdicts.items()
        if own.accepted is not None and each.accepted is (not own.accepted)
    }
    if not others:
        return own
    against = "; ".join(_said(name, each) for name, each in others.items())
    return replace(own, disagreement=f"the methods disagree: {_said(result, own)}, but {against}")


def _said(name: str, verdict: Verdict) -> str:
    """A verdict with its reasons, as a part of a sentence."""
    if verdict.accepted:
        return f"{name} is accepted (no test of its residuals and estimates finds anything wrong)"
    return f"{name} is not accepted ({'; '.join(verdict.reasons) or 'no reason given'})"
