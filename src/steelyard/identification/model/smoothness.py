"""How smooth a motion is, as its readings tell: the intensity of the noise in its third derivative
by marginal likelihood.

The readings stay as they are linearised; only the motion follows. The motion is integrated out,
which for a banded matrix is a determinant, and the derivative of the likelihood is a trace of what
the inverse has in the band [MacKay1992]_.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.identification.model.motion_residuals import PARTS, Segment
from steelyard.identification.model.segment import NormalEquations, banded_trace

_SETTLED = 0.3
"""Largest logarithm of the ratio at which the intensity has settled: what passes follows it with a
sixth of that."""
_TURNS = 12
_LONGEST_STEP = 4.0
"""Of the logarithm of an intensity."""
_SLOPES = -1.5, -0.15
"""Of the logarithm of the ratio by that of the intensity, as far as a secant is believed."""
_STIFFER = 1e-3
"""Second beginning of a search, as a part of the first: there may be two answers, one of them a
motion that follows the noise."""
_LEAST = {"position": 1e-4, "rotation": 1e-5}
"""Intensity that no motion is stiffer than [m^2/s^5], [1/s^5]: within a second its acceleration may
always change by a centimetre per second squared. Where nothing seems to move, the readings would
else ask for none at all."""


@dataclass(frozen=True)
class _Intensities:
    level: Mapping[str, float]
    evidence: float
    """Log marginal likelihood but for a constant."""


def smoothness(
    segments: Sequence[Segment], equations: Sequence[NormalEquations], *, anew: bool = False
) -> tuple[dict[str, float], bool]:
    """Intensities that the readings ask for, as much above the likeliest as the segments want it, and
    whether they had them already.

    Args:
        segments: With present motion; those with a smoothness share it.
        equations: Of their readings alone.
        anew: Whether to search from a stiffer motion too, and take what is likelier.
    """
    moving = [
        (segment, each)
        for segment, each in zip(segments, equations, strict=True)
        if segment.smoothness is not None
    ]
    looser = {part: moving[0][0].looser.get(part, 1.0) for part in PARTS}
    present = {
        part: value / looser[part] for part, value in (moving[0][0].smoothness or {}).items()
    }
    found = _search(moving, present)
    if anew:
        stiffer = _search(
            moving, {part: max(value * _STIFFER, _LEAST[part]) for part, value in present.items()}
        )
        found = max(found, stiffer, key=lambda each: each.evidence)
    return (
        {part: value * looser[part] for part, value in found.level.items()},
        all(abs(np.log(found.level[part] / present[part])) < _SETTLED for part in present),
    )


def _search(
    moving: Sequence[tuple[Segment, NormalEquations]], start: Mapping[str, float]
) -> _Intensities:
    """Fixed point of intensity = roughness over the freedom that the readings have used of it, by
    secants.
    """
    level, last = dict(start), dict[str, tuple[float, float]]()
    evidence = -np.inf
    for _ in range(_TURNS):
        rough, used = dict.fromkeys(level, 0.0), dict.fromkeys(level, 0.0)
        evidence = 0.0
        for segment, each in moving:
            bent = replace(segment, smoothness=level)
            try:
                whole = bent.smooth(each)
                inverse = whole.inverse
            except np.linalg.LinAlgError:
                return _Intensities(level, -np.inf)
            functions = len(segment.coefficients)
            evidence += 0.5 * (float(whole.motion_gradient @ whole.settled) - whole.log_determinant)
            evidence -= 0.5 * sum(bent.roughness[part] / each for part, each in level.items())
            rested = replace(
                bent, coefficients=segment.coefficients + whole.settled.reshape(-1, segment.block)
            )
            for part in level:
                rank = (PARTS[part].stop - PARTS[part].start) * (functions - 3)
                rough[part] += rested.roughness[part]
                used[part] += rank - banded_trace(segment.jerks[part], inverse) / level[part]
                evidence -= 0.5 * rank * float(np.log(level[part]))
        off = {
            part: float(np.log(max(rough[part] / max(used[part], 0.1), _LEAST[part]) / level[part]))
            for part in level
        }
        if all(abs(each) < _SETTLED for each in off.values()):
            break
        for part, ratio in off.items():
            at, slope = float(np.log(level[part])), -1.0
            if part in last and abs(at - last[part][0]) > 1e-3:
                slope = float(np.clip((ratio - last[part][1]) / (at - last[part][0]), *_SLOPES))
            last[part] = at, ratio
            level[part] = max(
                float(np.exp(at + np.clip(-ratio / slope, -_LONGEST_STEP, _LONGEST_STEP))),
                _LEAST[part],
            )
    return _Intensities(level, evidence)
