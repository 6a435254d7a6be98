"""Where an instrument seems to sit, by a fit of everything that contradicts where it is said to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.experiment.model import Experiment
from steelyard.inspection.mistakes.settings import PLACES, PlaceSettings


@dataclass(frozen=True, eq=False)
class Misplaced:
    """An instrument that sits elsewhere on the platform than stated."""

    instrument: str
    key: str
    """Under which its place is stated."""
    place: Array
    """Where it seems to sit [m], shape (3,)."""
    off: float
    """Distance from where it was said to [m]."""
    sigma: float
    """1-sigma that its place may be stated with [m]."""

    @property
    def keys(self) -> tuple[str, str]:
        """What to write under the instrument: its place, and the 1-sigma of that."""
        place = ", ".join(f"{value:.3f}" for value in self.place)
        return f"{self.key}: [{place}]", f"calibration: {{{self.key}: {self.sigma:.2f}}}"

    @property
    def remark(self) -> str:
        """In one sentence, with what to change."""
        place, prior = self.keys
        return (
            f"{self.instrument} seems to sit elsewhere on the platform than stated, by"
            f" {self.off:.2f} m: instruments: {{{self.instrument}: {{{place}, {prior}}}}}"
        )

    @property
    def amendment(self) -> str:
        """YAML to merge into the experiment file."""
        return "\n".join(
            ["instruments:", f"  {self.instrument}:", *(f"    {key}" for key in self.keys)]
        )


def misplaced(
    experiment: Experiment,
    tests: Sequence[Mapping[str, Any]],
    settings: PlaceSettings = PLACES,
) -> Misplaced | None:
    """The instrument whose place a fit contradicts most of all numbers of the description; None
    where it is another number that it contradicts, or none.

    Args:
        experiment: That was fitted.
        tests: Directed tests, the largest first, with ``name``, ``z``, ``size`` and ``sigma`` each.
        settings: By how much a place must be wrong.
    """
    if not tests:
        return None
    owner, _, key = str(tests[0]["name"]).partition(" ")[0].partition(".")
    instrument = experiment.instruments.get(owner)
    if instrument is None or instrument.mounting.point_key != key:
        return None
    stated = np.array(instrument.mounting.point or (0.0, 0.0, 0.0), dtype=np.float64)
    moved, sigma = np.zeros(3), 0.0
    for test in tests:
        name, _, axis = str(test["name"]).partition(" ")
        if name == f"{owner}.{key}" and axis in {*"xyz"} and abs(test["z"]) > settings.clear:
            moved["xyz".index(axis)] = test["size"]
            sigma = max(sigma, float(test["sigma"]))
    off = float(np.linalg.norm(moved))
    if off < settings.least:
        return None
    # One number was tested at a time: the others of its place may have moved with it.
    return Misplaced(owner, key, stated + moved, off, max(settings.least, 3 * sigma))
