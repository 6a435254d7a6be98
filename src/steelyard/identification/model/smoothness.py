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

from steelyard.identification.banded import banded_trace
from steelyard.identification.model.motion_segment import PARTS, Segment
from steelyard.identification.model.segment import NormalEquations
from steelyard.identification.model.settings import MOTION, MotionSettings


@dataclass(frozen=True)
class _Intensities:
    level: Mapping[str, float]
    evidence: float
    """Log marginal likelihood but for a constant."""


def smoothness(
    segments: Sequence[Segment],
    equations: Sequence[NormalEquations],
    *,
    anew: bool = False,
    settings: MotionSettings = MOTION,
) -> tuple[dict[str, float], bool]:
    """Intensities that the readings ask for, as much above the likeliest as the segments want it,
    and whether they had them already.

    Args:
        segments: With present motion; those with a smoothness share it.
        equations: Of their readings alone.
        anew: Whether to search from a stiffer motion too, and take what is likelier.
        settings: Of the search.
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
    found = _search(moving, present, settings)
    if anew:
        least = settings.least_intensity
        stiffer = {
            part: max(value * settings.stiffer, least[part]) for part, value in present.items()
        }
        found = max(found, _search(moving, stiffer, settings), key=lambda each: each.evidence)
    changes = [abs(np.log(found.level[part] / present[part])) for part in present]
    return (
        {part: value * looser[part] for part, value in found.level.items()},
        all(change < settings.smoothness_settled for change in changes),
    )


@dataclass(frozen=True)
class SmoothedMotion:
    """A motion that has settled where readings and an intensity want it. Its roughness over the
    freedom that the readings have used of it is the intensity that they ask for [MacKay1992]_.
    """

    rough: Mapping[str, float]
    """Part of the pose -> roughness [m^2/s^5], [1/s^5]."""
    used: Mapping[str, float]
    """Part of the pose -> freedom that the readings have used of it."""
    evidence: float
    """Log marginal likelihood but for a constant."""

    @classmethod
    def of(
        cls, segment: Segment, equations: NormalEquations, level: Mapping[str, float]
    ) -> SmoothedMotion:
        """From readings as they are linearised.

        Args:
            segment: With present motion.
            equations: Of its readings alone.
            level: Part of the pose -> intensity [m^2/s^5], [1/s^5].

        Raises:
            numpy.linalg.LinAlgError: The motion is not determined.
        """
        bent = replace(segment, smoothness=level)
        whole = bent.smooth(equations)
        inverse, functions = whole.inverse, len(segment.coefficients)
        evidence = 0.5 * (float(whole.motion_gradient @ whole.settled) - whole.log_determinant)
        evidence -= 0.5 * sum(bent.roughness[part] / each for part, each in level.items())
        there = segment.coefficients + whole.settled.reshape(-1, segment.block)
        rested = replace(bent, coefficients=there).roughness
        used = {}
        for part, each in level.items():
            rank = (PARTS[part].stop - PARTS[part].start) * (functions - 3)
            used[part] = rank - banded_trace(segment.jerks[part], inverse) / each
            evidence -= 0.5 * rank * float(np.log(each))
        return cls({part: rested[part] for part in level}, used, evidence)


def _search(
    moving: Sequence[tuple[Segment, NormalEquations]],
    start: Mapping[str, float],
    settings: MotionSettings,
) -> _Intensities:
    """Fixed point of intensity = roughness over the freedom that the readings have used of it, by
    secants.
    """
    level, last = dict(start), dict[str, tuple[float, float]]()
    evidence = -np.inf
    least, longest = settings.least_intensity, settings.smoothness_step
    for _ in range(settings.smoothness_iterations):
        rough, used = dict.fromkeys(level, 0.0), dict.fromkeys(level, 0.0)
        evidence = 0.0
        for segment, each in moving:
            try:
                found = SmoothedMotion.of(segment, each, level)
            except np.linalg.LinAlgError:
                return _Intensities(level, -np.inf)
            evidence += found.evidence
            for part in level:
                rough[part] += found.rough[part]
                used[part] += found.used[part]
        off = {}
        for part in level:
            wanted = rough[part] / max(used[part], settings.least_used_freedom)
            off[part] = float(np.log(max(wanted, least[part]) / level[part]))
        if all(abs(each) < settings.smoothness_settled for each in off.values()):
            break
        for part, ratio in off.items():
            at, slope = float(np.log(level[part])), -1.0
            if part in last and abs(at - last[part][0]) > 1e-3:
                secant = (ratio - last[part][1]) / (at - last[part][0])
                slope = float(np.clip(secant, *settings.smoothness_slopes))
            last[part] = at, ratio
            step = np.clip(-ratio / slope, -longest, longest)
            level[part] = max(float(np.exp(at + step)), least[part])
    return _Intensities(level, evidence)
