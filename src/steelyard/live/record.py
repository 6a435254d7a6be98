"""What is known at an instant, as one line of JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.estimate import identifiable_parameters, named, plain
from steelyard.inertia import BODY_PARAMETERS, TEN, symmetric


@dataclass(frozen=True, eq=False)
class Record:
    """What is known at an instant."""

    time: float
    """On the clock of the forces [s]."""
    load: str
    """What the platform carries."""
    value: Array
    """The ten of :data:`steelyard.inertia.BODY_PARAMETERS`, NaN where the data do not tell it, shape
    (10,)."""
    deviation: Array
    """1-sigma of these, shape (10,)."""
    accepted: bool | None
    """Whether all that was seen so far can be relied on; None: not asked yet."""
    reasons: tuple[str, ...] = ()
    """Why it is not accepted."""
    events: tuple[dict[str, Any], ...] = ()
    """What has happened since the last record."""

    @classmethod
    def of(
        cls,
        time: float,
        load: str,
        value: Array,
        covariance: Array,
        size: float,
        accepted: bool | None,
        reasons: Sequence[str] = (),
        events: Sequence[dict[str, Any]] = (),
    ) -> Record:
        """Without numbers of what the data do not tell.

        Args:
            time: On the clock of the forces [s].
            load: What the platform carries.
            value: The ten, shape (10,).
            covariance: Shape (10, 10).
            size: Plausible radius of the body [m].
            accepted: See :attr:`accepted`.
            reasons: See :attr:`reasons`.
            events: See :attr:`events`.
        """
        told = identifiable_parameters(float(value[0]), covariance, size)
        deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        return cls(
            time,
            load,
            np.where(told, value, np.nan),
            np.where(told, deviation, np.nan),
            accepted,
            tuple(reasons),
            tuple(events),
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values, null where the data do not tell a number."""
        return {
            "t": round(self.time, 6),
            "load": self.load,
            "mass": plain(self.value[0]),
            "center_of_gravity": plain(self.value[1:4]),
            "inertia": plain(symmetric(self.value[4:])),
            "standard_deviation": named(self.deviation),
            "accepted": self.accepted,
            "reasons": list(self.reasons),
            "events": list(self.events),
        }


def table_of(records: Sequence[Record]) -> dict[str, Array]:
    """Columns of a table: ``t``, the ten and their 1-sigma (``sigma_mass`` and so on), shape (n,)
    each.
    """
    values = np.array([each.value for each in records]).reshape(-1, TEN)
    sigmas = np.array([each.deviation for each in records]).reshape(-1, TEN)
    found = {"t": np.array([each.time for each in records])}
    found |= dict(zip(BODY_PARAMETERS, values.T, strict=True))
    found |= {f"sigma_{name}": own for name, own in zip(BODY_PARAMETERS, sigmas.T, strict=True)}
    return found
