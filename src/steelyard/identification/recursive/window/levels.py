"""Levels that are followed while the motion goes on: how lively it is, and how noisy readings are.

How lively: the roughness of what has passed over the freedom that its readings have used of it
[MacKay1992]_, forgotten with time, so that a motion that begins to shake is not held as stiff as it
was before; a chunk in which the readings resolve nothing of it says nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from steelyard.identification.model.motion_segment import PARTS, Segment
from steelyard.identification.model.segment import NormalEquations
from steelyard.identification.model.settings import MOTION
from steelyard.identification.model.smoothness import SmoothedMotion
from steelyard.smoothing import DEGREE


@dataclass(frozen=True)
class Liveliness:
    """How lively the motion is."""

    rough: Mapping[str, float]
    """Part of the pose -> expected roughness, the last seconds weighing most [m^2/s^5], [1/s^5]
    times the freedom."""
    freedom: Mapping[str, float]
    """Part of the pose -> freedom that it has."""
    looser: Mapping[str, float]
    """See :attr:`.Segment.looser`."""

    @classmethod
    def of(cls, segment: Segment, intervals: float) -> Liveliness:
        """As a segment has it.

        Args:
            segment: With its smoothness.
            intervals: Of its knots that this counts for.
        """
        smoothness = segment.smoothness or {}
        looser = {part: segment.looser.get(part, 1.0) for part in smoothness}
        freedom = {part: intervals * _components(part) for part in smoothness}
        rough = {part: freedom[part] * smoothness[part] / looser[part] for part in smoothness}
        return cls(rough, freedom, looser)

    @property
    def smoothness(self) -> dict[str, float]:
        """See :attr:`.Segment.smoothness`."""
        return {
            part: self.looser[part] * self.rough[part] / self.freedom[part] for part in self.rough
        }

    def followed(self, segment: Segment, readings: NormalEquations, forgets: float) -> Liveliness:
        """With a chunk that passes.

        Args:
            segment: The chunk.
            readings: Equations of its readings alone.
            forgets: Time over which it forgets [s].
        """
        if not self.rough:
            return self
        usual = {part: self.rough[part] / self.freedom[part] for part in self.rough}
        try:
            found = SmoothedMotion.of(segment, readings, usual)
        except np.linalg.LinAlgError:
            # By itself the chunk says nothing of it.
            return self
        start, end = segment.span
        kept = float(np.exp(-(end - start) / forgets))
        # At its ends a chunk is as free as nothing but its neighbours would see.
        functions = len(segment.coefficients)
        seen = (functions - DEGREE) / (functions - 3)
        freedom = {part: kept * self.freedom[part] + seen * found.used[part] for part in usual}
        return replace(
            self,
            rough={
                part: max(
                    kept * self.rough[part] + found.rough[part],
                    MOTION.least_intensity[part] * freedom[part],
                )
                for part in usual
            },
            freedom=freedom,
        )

    def at_least(self, segment: Segment, intervals: int) -> Segment:
        """A chunk no stiffer than its own motion is: it may have begun to shake.

        Args:
            segment: The chunk.
            intervals: Of its knots.
        """
        if not self.rough:
            return segment
        own = {
            part: value / (intervals * _components(part))
            for part, value in segment.roughness.items()
            if part in self.rough
        }
        usual = self.smoothness
        return replace(segment, smoothness={part: max(usual[part], own[part]) for part in usual})


def _components(part: str) -> int:
    """Numbers of a part of the pose."""
    return PARTS[part].stop - PARTS[part].start
