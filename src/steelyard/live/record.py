"""What is known at an instant, as one line of JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.estimates.estimate import identifiable_parameters, named, plain
from steelyard.inertia import BODY_PARAMETERS, symmetric

FORMAT = "steelyard-watch/1"
"""Of a line."""
TABLE_FORMAT = "steelyard-records/1"
"""Of a table of them."""


@dataclass(frozen=True, eq=False)
class Record:
    """What is known at an instant."""

    time: float
    """On the clock of the forces [s]."""
    load: str
    """What the platform carries."""
    value: Array
    """The ten of :data:`steelyard.inertia.BODY_PARAMETERS`, NaN where the data do not tell it,
    shape (10,)."""
    deviation: Array
    """1-sigma of these, shape (10,)."""
    accepted: bool | None
    """Whether all that was seen so far can be relied on; None: not asked yet."""
    reasons: tuple[str, ...] = ()
    """Why it is not accepted."""
    events: tuple[dict[str, Any], ...] = ()
    """What has happened since the last record."""
    unmodelled: Array | None = None
    """Wrench that nothing explains, about the platform origin, in platform axes [N], [N m], shape
    (6,); None: not known."""
    until: Mapping[str, float | None] = field(default_factory=dict)
    """Body parameter -> how long this motion must go on until it is known as well as is wanted [s];
    None: not with this motion."""

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
        unmodelled: Array | None = None,
        until: Mapping[str, float | None] | None = None,
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
            unmodelled: See :attr:`unmodelled`.
            until: See :attr:`until`.
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
            unmodelled=unmodelled,
            until=until or {},
        )

    @cached_property
    def line(self) -> str:
        """As one line of JSON."""
        return json.dumps(self.to_dict(), allow_nan=False)

    def numbers(self) -> dict[str, float]:
        """Every number by a name of its own: ``t``, the ten of
        :data:`steelyard.inertia.BODY_PARAMETERS`, ``sigma_...`` of each; NaN where the data do not
        tell it.
        """
        values = dict(zip(BODY_PARAMETERS, self.value.tolist(), strict=True))
        sigmas = zip(BODY_PARAMETERS, self.deviation.tolist(), strict=True)
        return {"t": self.time, **values, **{f"sigma_{name}": own for name, own in sigmas}}

    def to_dict(self) -> dict[str, Any]:
        """Plain values, null where the data do not tell a number."""
        return {
            "format": FORMAT,
            "t": round(self.time, 6),
            "load": self.load,
            "mass": plain(self.value[0]),
            "center_of_gravity": plain(self.value[1:4]),
            "inertia": plain(symmetric(self.value[4:])),
            "standard_deviation": named(self.deviation),
            "accepted": self.accepted,
            "reasons": list(self.reasons),
            "events": list(self.events),
            "unmodelled": None if self.unmodelled is None else plain(self.unmodelled),
            **({"seconds_until": dict(self.until)} if self.until else {}),
        }


def table_of(records: Sequence[Record]) -> dict[str, Array]:
    """Columns of a table, those of :meth:`Record.numbers`, shape (n,) each."""
    rows = [each.numbers() for each in records]
    names = ["t", *BODY_PARAMETERS, *(f"sigma_{name}" for name in BODY_PARAMETERS)]
    return {name: np.array([row[name] for row in rows], dtype=float) for name in names}
